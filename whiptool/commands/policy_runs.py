"""Use of runs of `train` in commands that play strikes: their policies, strikes and targets."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path
from typing import Any, TypeVar

from whiptool.commands import cli
from whiptool.commands.options.option_group import OptionGroup
from whiptool.commands.pictures import StrikeRun
from whiptool.commands.train import TrainOptions
from whiptool.rl.trained import BEST, CHECKPOINT, load_policy
from whiptool.runs import CONFIG, read_config

T = TypeVar("T", bound=OptionGroup)


def folder_of(policy: Path) -> Path:
    """Return the run folder of a policy, given that folder or a policy file in it."""
    return policy.parent if policy.is_file() else policy


def is_policy(path: Path) -> bool:
    """Whether the path is a run of `train` that has saved a policy."""
    folder = folder_of(path)
    holds = any((folder / name).is_file() for name in (BEST, CHECKPOINT))
    return holds and (folder / CONFIG).is_file() and read_config(folder).get("command") == "train"


def usual_for(kind: type[T], policy: Path) -> T:
    """Return options of another command, `kind`; options that `train` has, too, are those of the policy's training.

    A range of arrival angles is left out, and so is the cone without a single angle or a direction.

    Raises:
        InputError: The path is not a policy.
    """
    trained = cli.options_of_run(TrainOptions, folder_of(policy), command="train")
    passing = TrainOptions.named("of_this_call")
    theirs = {f.name for f in fields(trained)} - passing - {"arrival_angle", "cone"}
    mine: dict[str, Any] = {f.name: getattr(trained, f.name) for f in fields(kind) if f.name in theirs}
    angles = trained.arrival_angle or ()
    if len(angles) == 1:
        mine["arrival_angle"] = angles[0]
    if len(angles) == 1 or trained.direction is not None:
        mine["cone"] = trained.cone
    return kind(**mine)


def shown_strike(policy: Path) -> StrikeRun:
    """Return the policy's first strike at the first held-out goal of its training."""
    from whiptool.goals.target import Target
    from whiptool.rl.policy import held_out_goals

    trained = cli.options_of_run(TrainOptions, folder_of(policy), command="train")
    loaded = load_policy(policy)
    task = loaded.task
    target = Target.of(held_out_goals(task, trained.seed), 0)
    strike, model = loaded.strike(target), task.rollout.model
    trajectory = task.rollout.trajectory(strike, t_stay=task.t_stay)
    beyond = task.limits.explain(trajectory, model.arm.joints, strike)
    return StrikeRun(trajectory, model, target, trained.controller_label(), beyond)
