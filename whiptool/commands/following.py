"""Runs that are followed while they go on: what the folder of a long command shows."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from whiptool.commands import run_folders
from whiptool.errors import InputError

if TYPE_CHECKING:
    from whiptool.following.followed import Followed


def followed(folder: Path) -> Followed:
    """Return the run of optimize, train, adapt or map build that a folder holds, to follow it.

    Raises:
        InputError: The folder holds no such run, or its configuration is damaged.
    """
    from whiptool.runs import read_config

    command = read_config(folder).get("command")
    if command not in _FOLLOWED:
        commands = "optimize, train, adapt or map build"
        raise InputError("run folder", str(folder), f"the folder of {commands}", f"this one is of {command}")
    return _FOLLOWED[command](folder)


def write_progress(folder: Path, path: Path) -> None:
    """Write what a run shows now as MCAP, see `whiptool.recording.mcap_file.write_progress_mcap`.

    Raises:
        InputError: As for `followed`.
        OSError: The file cannot be written.
    """
    from whiptool.recording.mcap_file import write_progress_mcap

    run = followed(folder)
    view = run.look()
    assert view is not None  # the first look shows the run as it is
    curves = {f"{chart.full_title} {curve.name}": (curve.x, curve.y) for chart in view.charts for curve in chart.curves}
    motion = None if view.chosen is None else run.motion(view.chosen)
    strike = None if motion is None else (motion.model, motion.trajectory, motion.target.position)
    write_progress_mcap(path, curves, view.points, strike)


def _search(folder: Path) -> Followed:
    from whiptool.commands.optimize import OptimizeOptions
    from whiptool.following.search import FollowedSearch

    options = run_folders.options_of_run(OptimizeOptions, folder, command="optimize")
    model, controller = options.build_model(), options.build_controller()
    return FollowedSearch(
        folder,
        _heading("optimize", "pareto" if options.pareto else options.method, model.name, folder),
        options.build_rollout(model, controller),
        options.build_target(model),
        t_stay=options.t_stay,
        budget=options.max_trials,
    )


def _training(folder: Path) -> Followed:
    from whiptool.following.training import FollowedTraining
    from whiptool.runs import config_of

    config = config_of(folder, "train")
    options = config["options"]
    name = _heading("train", options["method"], config["model"]["name"], folder)
    return FollowedTraining(folder, name, options)


def _adaptation(folder: Path) -> Followed:
    from whiptool.commands.adapt import prior_of
    from whiptool.commands.options.rig_options import AdaptOptions
    from whiptool.following.adaptation import FollowedAdaptation

    options = run_folders.options_of_run(AdaptOptions, folder, command="adapt")
    prior = prior_of(options)
    return FollowedAdaptation(
        folder,
        _heading("adapt", options.port, prior.plant.model.name, folder),
        prior,
        options.build_target(prior.plant.model),
        t_stay=options.t_stay,
        budget=options.max_strikes,
    )


def _map(folder: Path) -> Followed:
    from whiptool.following.map_building import FollowedMap
    from whiptool.runs import config_of
    from whiptool.strike_map.building import building_of

    building = building_of(config_of(folder, "map"))
    return FollowedMap(folder, _heading("map build", None, building.striker.rollout.model.name, folder), building)


_FOLLOWED: dict[Any, Any] = {"optimize": _search, "train": _training, "adapt": _adaptation, "map": _map}


def _heading(command: str, how: str | None, model: str, folder: Path) -> str:
    """Which run it is, in words."""
    return ", ".join(filter(None, (command, how, model, folder.name)))
