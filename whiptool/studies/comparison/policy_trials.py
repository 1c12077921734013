"""Trials of a trained policy to its first hit, at several hit radii at once."""

from __future__ import annotations

from typing import Any

import numpy as np

from whiptool.rl.learner import Learner
from whiptool.rl.policy import trials_to_hit
from whiptool.rl.task import StrikeTask
from whiptool.rollout.trajectory import Approach


class RecordedTask(StrikeTask):
    """A task that keeps the miss distances of every step."""

    def __init__(self, *args: Any, **options: Any) -> None:
        super().__init__(*args, **options)
        self.distances: list[np.ndarray] = []

    def approach(self, strikes: np.ndarray, targets: np.ndarray) -> tuple[Approach, np.ndarray]:
        """As of any task."""
        approach, distance = super().approach(strikes, targets)
        self.distances.append(distance)
        return approach, distance


def trials_within(
    learner: Learner, task: RecordedTask, targets: np.ndarray, radii: tuple[float, ...], *, cap: int, convention: str
) -> dict[float, tuple[np.ndarray, np.ndarray]]:
    """As `trials_to_hit`, for every radius from the same strikes: no policy sees the radius while it strikes.

    Args:
        learner, targets, cap, convention: As there.
        task: Its hit radius is the least of `radii`.
        radii: [m]

    Returns:
        For each radius trials to the first hit, `cap` where there was none, (B,), and whether there was one, (B,).
    """
    task.distances.clear()
    trials_to_hit(learner, task, targets, cap=cap, convention=convention)
    found = {radius: (np.full(len(targets), cap), np.zeros(len(targets), bool)) for radius in radii}
    left = np.arange(len(targets))
    for number, distance in enumerate(task.distances, start=1):
        for radius, (trials, hit) in found.items():
            new = left[(distance <= radius) & ~hit[left]]
            trials[new], hit[new] = number, True
        left = left[distance > task.hit_radius]
    return found


def misses_of(
    learner: Learner, task: RecordedTask, targets: np.ndarray, *, cap: int, convention: str
) -> list[list[float]]:
    """Miss distances of each target's strikes [m], up to the first within the task's hit radius; arguments as above."""
    task.distances.clear()
    trials_to_hit(learner, task, targets, cap=cap, convention=convention)
    misses: list[list[float]] = [[] for _ in targets]
    left = np.arange(len(targets))
    for distance in task.distances:
        for i, miss in zip(left, distance.tolist(), strict=True):
            misses[i].append(miss)
        left = left[distance > task.hit_radius]
    return misses
