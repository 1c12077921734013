"""Trials of a trained policy to its first hit, at several hit radii at once."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from whiptool.goals.goals import Goals
from whiptool.rl.learner import Learner
from whiptool.rl.policy import trials_to_hit
from whiptool.rl.task import Judged, StrikeTask


def trials_within(
    learner: Learner,
    task: StrikeTask,
    targets: np.ndarray | Goals,
    radii: tuple[float, ...],
    *,
    cap: int,
    convention: str,
) -> dict[float, tuple[np.ndarray, np.ndarray]]:
    """As `trials_to_hit`, for every radius from the same strikes: no policy sees the radius while it strikes.

    Args:
        learner, targets, cap, convention: As there.
        task: Its hit radius is the least of `radii`.
        radii: Radii [m].

    Returns:
        For each radius trials to the first hit, `cap` where there was none, (B,), and whether there was one, (B,).
    """
    goals = replace(task.as_goals(targets), hit_radius=task.hit_radius)
    count = len(goals.positions)
    found = {radius: (np.full(count, cap), np.zeros(count, bool)) for radius in radii}
    made = np.zeros(count, int)  # strikes at each

    def on_strikes(lanes: np.ndarray, judged: Judged) -> None:
        made[lanes] += 1
        for radius, (trials, hit) in found.items():
            within = replace(goals.rows(lanes), hit_radius=radius)
            near = within.hit_by(judged.approach) & ~judged.lost & ~hit[lanes]
            for i in np.flatnonzero(near & ~judged.hit) if task.limits.of_candidates else ():
                near[i] = task.within_limits(judged.strikes[i])  # the task checks whole trajectories of hits only
            new = lanes[near]
            trials[new], hit[new] = made[new], True

    trials_to_hit(learner, task, goals, cap=cap, convention=convention, on_strikes=on_strikes)
    return found


def misses_of(
    learner: Learner, task: StrikeTask, targets: np.ndarray, *, cap: int, convention: str
) -> list[list[float]]:
    """Miss distances of each target's strikes [m], up to the first within the task's hit radius; arguments as above."""
    misses: list[list[float]] = [[] for _ in targets]

    def on_strikes(lanes: np.ndarray, judged: Judged) -> None:
        for i, miss in zip(lanes, judged.distance.tolist(), strict=True):
            misses[i].append(miss)

    trials_to_hit(learner, task, targets, cap=cap, convention=convention, on_strikes=on_strikes)
    return misses
