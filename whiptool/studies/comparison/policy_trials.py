"""Trials of a trained policy to its first hit, at several hit radii at once."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from whiptool.goals import Goals
from whiptool.rl.learner import Learner
from whiptool.rl.policy import trials_to_hit
from whiptool.rl.task import Judged, StrikeTask


class RecordedTask(StrikeTask):
    """A task that keeps what the strikes of every step came to."""

    def __init__(self, *args: Any, **options: Any) -> None:
        super().__init__(*args, **options)
        self.judgements: list[Judged] = []

    def judge(self, strikes: np.ndarray, goals: Goals) -> Judged:
        """As of any task."""
        judged = super().judge(strikes, goals)
        self.judgements.append(judged)
        return judged


def trials_within(
    learner: Learner,
    task: RecordedTask,
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
        radii: [m]

    Returns:
        For each radius trials to the first hit, `cap` where there was none, (B,), and whether there was one, (B,).
    """
    goals = replace(task.as_goals(targets), hit_radius=task.hit_radius)
    task.judgements.clear()
    trials_to_hit(learner, task, goals, cap=cap, convention=convention)
    count = len(goals.positions)
    found = {radius: (np.full(count, cap), np.zeros(count, bool)) for radius in radii}
    left = np.arange(count)
    for number, judged in enumerate(task.judgements, start=1):
        for radius, (trials, hit) in found.items():
            within = replace(goals.rows(left), hit_radius=radius)
            new = left[within.hit_by(judged.approach) & ~hit[left]]
            trials[new], hit[new] = number, True
        left = left[~judged.hit]
    return found


def misses_of(
    learner: Learner, task: RecordedTask, targets: np.ndarray, *, cap: int, convention: str
) -> list[list[float]]:
    """Miss distances of each target's strikes [m], up to the first within the task's hit radius; arguments as above."""
    task.judgements.clear()
    trials_to_hit(learner, task, targets, cap=cap, convention=convention)
    misses: list[list[float]] = [[] for _ in targets]
    left = np.arange(len(targets))
    for judged in task.judgements:
        for i, miss in zip(left, judged.distance.tolist(), strict=True):
            misses[i].append(miss)
        left = left[~judged.hit]
    return misses
