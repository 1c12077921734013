"""Choice of the steps of each strike in a batch: finer steps until simulations with two tolerances agree.

The tolerance bounds the error of each step but not its growth over the strike: a whip that is about to crack amplifies
small differences. Each strike is therefore simulated with two tolerances with the ratio RATIO. Their distances differ
by the error with the coarser tolerance; the error with the finer one is estimated as RATIO times smaller. A strike with
too large an estimate is simulated with the next finer tolerance. As the steps of both have bounded errors, two wrong
simulations do not agree by chance, as those with two fixed steps may.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from whiptool.dynamics.structure import Columns
from whiptool.models.parameters import Model

TOLERANCE = 1e-4  # [m]
RATIO = 10.0  # of successive tolerances
COARSEST = 0.7  # the first tolerance of a step's error, in units of that of the distance
RUNGS = 7  # tolerances that are tried at most
OF_A_STEP = COARSEST / RATIO * TOLERANCE  # error of a step [m] at which the distances of most strikes are that true
CERTAINTY = 3.0  # the estimate is so many times the finer rollout's error, if errors are proportional to tolerances


@dataclass(frozen=True)
class Resolved:
    """Outcomes of B strikes, each with steps as fine as it needs.

    Args:
        out: Outcomes in the engine's columns, (B, columns).
        error: Estimated errors of the distances [m], (B,); infinite if no tolerance sufficed.
        tolerance: Tolerance of the error per step that was used [m], (B,).
    """

    out: np.ndarray
    error: np.ndarray
    tolerance: np.ndarray


def resolve(
    roll: Callable[[np.ndarray, np.ndarray], np.ndarray], count: int, tolerance: float, columns: Columns
) -> Resolved:
    """Simulate strikes with finer steps until the estimated errors of their distances are at most a tolerance.

    Args:
        roll: Function that returns the outcomes (n, columns) of strikes with given indices (n,) and tolerances of a
            step's error (n,) [m].
        count: Number of strikes.
        tolerance: Tolerance [m].
        columns: Columns of the outcomes.
    """
    every, coarsest = np.arange(count), COARSEST * tolerance
    both = roll(np.tile(every, 2), np.repeat([coarsest, coarsest / RATIO], count))
    coarse, out = both[:count], both[count:]
    error, taken = _estimate(coarse, out, columns), np.full(count, coarsest / RATIO)
    for _ in range(RUNGS - 2):
        left = np.flatnonzero(~(error <= tolerance))
        left = left[~_both_diverged(coarse[left], out[left], columns)]
        if len(left) == 0:
            break
        finer = taken[left] / RATIO
        coarse[left], out[left] = out[left], roll(left, finer)
        error[left], taken[left] = _estimate(coarse[left], out[left], columns), finer
    error[~(error <= tolerance)] = np.inf
    return Resolved(out, error, taken)


def displacements(model: Model, n: int) -> np.ndarray:
    """Return a scale of the tip's displacement per unit of each of n coordinates, arm then whip [m], (n,).

    For a joint of the whip it is the length from there to the tip, for the arm's joints the whole length, for rods the
    length of the rod.
    """
    lengths, a = model.whip.per_node("l"), model.arm.n
    beyond = np.cumsum(lengths[::-1])[::-1]  # of the whip, from each joint on
    of_whip = lengths if model.whip.joints == "rod" else beyond
    return np.concatenate([np.full(a, beyond[0]), np.repeat(of_whip, (n - a) // len(lengths))])


def _both_diverged(coarse: np.ndarray, fine: np.ndarray, columns: Columns) -> np.ndarray:
    """Return which strikes diverge at both tolerances, (n,): the model does, and not its integration."""
    diverged = columns["diverged"].start
    return (coarse[:, diverged] != 0) & (fine[:, diverged] != 0)


def _estimate(coarse: np.ndarray, fine: np.ndarray, columns: Columns) -> np.ndarray:
    """Return the estimated errors of the finer rollouts' distances [m], (n,); infinite where one of the two diverged.

    The difference of the tips across the tip's velocity counts too, as distances may agree by chance.
    """
    apart, velocity = fine[:, columns["tip"]] - coarse[:, columns["tip"]], fine[:, columns["velocity"]]
    speed2 = (velocity**2).sum(axis=1, keepdims=True)
    along = (apart * velocity).sum(axis=1, keepdims=True) / np.where(speed2 > 0, speed2, 1.0)
    across = np.linalg.norm(apart - along * velocity, axis=1)
    distance = columns["distance"].start
    difference = np.maximum(np.abs(fine[:, distance] - coarse[:, distance]), across)
    diverged = (coarse[:, columns["diverged"].start] != 0) | (fine[:, columns["diverged"].start] != 0)
    return np.where(diverged | np.isnan(difference), np.inf, CERTAINTY / RATIO * difference)
