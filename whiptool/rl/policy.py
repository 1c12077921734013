"""A trained policy: its strikes at targets, its trials to a hit, and its score at held-out goals."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import torch

from whiptool.errors import InputError
from whiptool.goals.goals import Goals
from whiptool.goals.target import Target, as_target
from whiptool.models.numbers import array_of
from whiptool.models.strike import Strike
from whiptool.rl.learner import Learner
from whiptool.rl.task import Judged, StrikeTask

CONVENTIONS = {
    "mean-first": "the mean action first, after a miss samples of the policy",
    "samples": "samples of the policy from the first strike on",
    "mean": "the mean action always",
}


class Policy:
    """A trained policy: a strike for every target of its zone, without a search.

    Args:
        learner: Learner trained on the task's observation; its weights are not changed.
        task: Task on which it was trained, with its zone, hit radius and simulator.
    """

    def __init__(self, learner: Learner, task: StrikeTask) -> None:
        self.learner, self.task = learner, task

    def __repr__(self) -> str:
        return f"Policy({type(self.learner).__name__.lower()}, over {self.task.zone})"

    def predict(
        self,
        observation: np.ndarray | Sequence[float],
        state: None = None,
        episode_start: np.ndarray | None = None,
        deterministic: bool = False,
    ) -> tuple[np.ndarray, None]:
        """Return the action for an observation, with the interface of Stable-Baselines3's models; `WhipEnv.step` takes
        it.

        Args:
            observation: Observation of one environment, (n_obs,), or of B, (B, n_obs), in SI units.
            state, episode_start: Ignored; only recurrent policies use them.
            deterministic: Return the mean action instead of a sample.

        Returns:
            The action in [-1, 1], (n_act,) or (B, n_act), and no state.

        Raises:
            InputError: The observation has a wrong size, or its numbers are not finite.
        """
        rule = f"{self.task.n_obs} finite numbers, or rows of them, as the observation {self.task.observation} has"
        seen = array_of("observation", observation, rule)
        if seen.ndim not in (1, 2) or seen.shape[-1] != self.task.n_obs:
            raise InputError("observation", observation, rule)
        rows = torch.as_tensor(self.task.normalise(np.atleast_2d(seen)), dtype=torch.float32)
        actions = self.learner.act(rows, deterministic=deterministic).numpy()
        return (actions[0] if seen.ndim == 1 else actions), None

    def strike(self, target: Target | Sequence[float]) -> Strike:
        """Return the policy's first strike at a target: its mean action for the observation before any strike.

        A policy that learned one direction for all targets uses it also for targets without direction.

        Raises:
            InputError: The target has a wrong dimension, is outside the zone that the policy learned, or asks for a
                direction or speed that it has not learned.
        """
        target = as_target(target)
        place, zone = target.position, self.task.zone
        if len(place) != zone.dimension:
            raise InputError("target", place, f"{zone.dimension} coordinates, as the model has")
        if not zone.contains(np.array(place)):
            raise InputError("target", place, f"a target in the policy's zone, {zone}", "train with a wider zone")
        goal = self.task.arrival.goal_of(target)
        return Strike.from_vector(first_strikes(self.learner, self.task, goal)[0])


def first_strikes(learner: Learner, task: StrikeTask, goals: Goals) -> np.ndarray:
    """Return a policy's first strikes (B, n_act) at B goals: its mean actions for the observation before any strike."""
    seen = torch.as_tensor(task.normalise(task.first_look(goals)), dtype=torch.float32)
    return task.to_strikes(learner.act(seen, deterministic=True).numpy().astype(float))


def trials_to_hit(
    learner: Learner,
    task: StrikeTask,
    targets: np.ndarray | Goals,
    *,
    cap: int,
    convention: str = "mean-first",
    on_trial: Callable[[int], object] = lambda ended: None,
    on_strikes: Callable[[np.ndarray, Judged], object] = lambda lanes, judged: None,
) -> tuple[np.ndarray, np.ndarray]:
    """Strike at each target until it is hit, with a new observation after every miss.

    If a policy's mean action repeats an earlier action at the same target, all later actions would repeat, too, without
    a hit; simulation then ends.

    Args:
        learner: Learner trained on the task's observation; its weights are not changed, its generator is used.
        task: Task with targets and observations.
        targets: Goals, or positions (B, d) [m] if the task draws no directions.
        cap: Largest number of strikes at each target.
        convention: One of `CONVENTIONS`, which state when strikes are the policy's mean action and when samples of it.
        on_trial: Called after every trial with the number of targets that are finished.
        on_strikes: Called after every trial with the indices (b,) of the targets that are not finished, and the results
            of the strikes at them.

    Returns:
        Trials to the first hit (`cap` without a hit), (B,), and whether there was a hit, (B,).

    Raises:
        InputError: The convention is unknown.
    """
    if convention not in CONVENTIONS:
        raise InputError("convention", convention, ", ".join(CONVENTIONS))
    obs = task.reset(targets)
    trials, hit = np.full(len(obs), cap), np.zeros(len(obs), bool)
    left, made = np.arange(len(obs)), [set() for _ in obs]
    for number in range(1, cap + 1):
        deterministic = convention == "mean" or (convention == "mean-first" and number == 1)
        seen = torch.as_tensor(task.normalise(obs), dtype=torch.float32)
        actions = learner.act(seen, deterministic=deterministic).numpy().astype(float)
        if convention == "mean":
            new = np.array([action.tobytes() not in made[i] for i, action in zip(left, actions, strict=True)])
            left, actions = left[new], actions[new]
            for i, action in zip(left, actions, strict=True):
                made[i].add(action.tobytes())
            task.keep(new)
            if not len(left):
                on_trial(len(hit))
                break
        step = task.step(actions)
        on_strikes(left, step.judged)
        trials[left[step.hit]], hit[left[step.hit]] = number, True
        left, obs = left[~step.hit], step.obs[~step.hit]
        on_trial(len(hit) - len(left) if number < cap else len(hit))
        if not len(left):
            break
        task.keep(~step.hit)
    return trials, hit


EVERY, GOALS = 5, 100  # episodes between two scores; goals of each


@dataclass(frozen=True)
class Score:
    """Result of a policy's first strikes, one at each held-out goal.

    Args:
        share_hit: Fraction of the goals that are hit, 0 to 1.
        mean_cost: Mean cost of the strikes [m], see `Goals.cost`; for goals without direction and speed, the mean miss
            distance.
    """

    share_hit: float
    mean_cost: float

    def better_than(self, other: Score | None) -> bool:
        """Whether this score has more hits than another, or as many with a smaller cost."""
        return other is None or (self.share_hit, -self.mean_cost) > (other.share_hit, -other.mean_cost)


@dataclass(frozen=True)
class Best:
    """The best policy of a training so far.

    Args:
        episode: Episode after which it was found.
        score: Score at the held-out goals.
        actor: State of the actor network.
    """

    episode: int
    score: Score
    actor: dict[str, Any]

    def table(self) -> dict[str, Any]:
        """Return the policy as a dict, in the form in which it is stored in files."""
        return {"episode": self.episode, "score": asdict(self.score), "actor": self.actor}

    @classmethod
    def of_table(cls, table: dict[str, Any]) -> Best:
        """Return the policy from a dict that `table` made."""
        return cls(int(table["episode"]), Score(**table["score"]), table["actor"])


def held_out_goals(task: StrikeTask, seed: int) -> Goals:
    """Return goals in a task's zone, different from those drawn with the same seed for tests."""
    return task.region.draw(GOALS, np.random.default_rng([seed, 1]))


def score(learner: Learner, task: StrikeTask, goals: Goals) -> Score:
    """Return the score of a policy's mean actions at goals; no random numbers are drawn, and the task is not
    changed."""
    judged = task.judge(first_strikes(learner, task, goals), goals)
    return Score(float(judged.hit.mean()), float(judged.cost.mean()))
