"""Input and results of an engine for a batch of strikes, and the division of strikes into time steps."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import ClassVar, Protocol

import numpy as np

from whiptool.dynamics.structure import Columns, outcome_columns, row_columns
from whiptool.dynamics.system import System
from whiptool.models.parameters import Model

_STEP_OF_TOLERANCE = 0.05  # [s per square root of a metre]


@dataclass
class Batch:
    """Input of an engine: B strikes, with a arm joints, n coordinates and P parameters.

    Args:
        p: Parameters, (B, P).
        x0: Initial states, (B, 2 n).
        target: Positions of the targets [m], (B, d), d = 2 in the plane, 3 in space.
        h, h_last, steps, hold: As returned by `time_grid`.
        dp, dx0, dh, dh_last: Direction along which derivatives are taken, in the shapes of p, x0, h, h_last; None: no
            derivatives.
        u, du: Inputs at successive instants and their derivatives, (rows, inputs); a strike needs steps + 2 rows.
        u_row, du_row: First row of each strike in u and du, (B,); a negative du_row: the derivatives are zero.
        rate, samples: Sampling rate [1/s] and number of samples of the tip's path.
        moving: Whether velocities follow the positions of that path.
        by_hand: Whether the hand takes the tip's place in all results.
        with_rows: Whether to return trajectories at every step.
        tolerance: Error per step of each strike [m], (B,), for adaptive steps; `h`, `h_last` and `steps` then define
            the instants of observation. None: they define the steps.
        knot: Time at which the reference of each strike ends [s], (B,).
        weight: Scale of the tip's displacement per unit of each coordinate [m], (n,), see `displacements`.
        period: Time for which a torque is held [s]; 0: it is continuous.
        columns, stride: Observed columns (see `System.step`), (C,), and number of steps between observations.
    """

    p: np.ndarray
    x0: np.ndarray
    target: np.ndarray
    h: np.ndarray
    h_last: np.ndarray
    steps: np.ndarray
    hold: int
    dp: np.ndarray | None = None
    dx0: np.ndarray | None = None
    dh: np.ndarray | None = None
    dh_last: np.ndarray | None = None
    u: np.ndarray | None = None
    du: np.ndarray | None = None
    u_row: np.ndarray | None = None
    du_row: np.ndarray | None = None
    rate: float = 0.0
    samples: int = 0
    moving: bool = False
    by_hand: bool = False
    with_rows: bool = False
    columns: np.ndarray | None = None
    stride: int = 1
    tolerance: np.ndarray | None = None
    knot: np.ndarray | None = None
    weight: np.ndarray | None = None
    period: float = 0.0

    PER_STRIKE: ClassVar = (
        "p", "x0", "target", "h", "h_last", "steps", "dp", "dx0", "dh", "dh_last", "u_row", "du_row",
        "tolerance", "knot",
    )  # fmt: skip

    def take(self, order: np.ndarray) -> Batch:
        """Return the batch with its strikes in another order."""
        arrays = {name: getattr(self, name) for name in self.PER_STRIKE}
        return replace(self, **{k: None if x is None else np.ascontiguousarray(x[order]) for k, x in arrays.items()})

    def in_equal_steps(self) -> Batch:
        """Return the batch for an engine without adaptive steps, with equal steps that meet the tolerances.

        The errors are of second order, so steps are proportional to the square root of the tolerances. The instants of
        observation are unchanged, with a whole number of steps between them; for trajectories they are the steps.
        """
        if self.tolerance is None or self.with_rows:
            return self
        end, longest = (self.steps - 1) * self.h + self.h_last, _STEP_OF_TOLERANCE * np.sqrt(self.tolerance)
        longest, stride = np.minimum(longest, self.h * 2), self.stride
        if self.columns is not None:
            finer = int(np.ceil((self.h / longest).max() - 1e-9))
            hold, h, stride = self.hold * finer, self.h / finer, stride * finer
        elif self.period:
            hold = int(np.ceil(self.period / longest.min()))
            h = np.full(len(end), self.period / hold)
        else:
            hold, h = 1, end / np.ceil(end / longest)
        steps = np.ceil(end / h - 1e-9).astype(np.int64)
        equal = replace(self, h=h, h_last=end - (steps - 1) * h, steps=steps, hold=hold, stride=stride, tolerance=None)
        if self.dh is not None and self.dh_last is not None:
            later = (self.steps - 1) * self.dh + self.dh_last
            equal.dh = np.zeros_like(later) if self.period else later / steps
            equal.dh_last = later - (steps - 1) * equal.dh
        return equal

    @property
    def forward(self) -> bool:
        """Whether derivatives are taken."""
        return self.dp is not None


@dataclass
class Rolled:
    """Results of a batch.

    Args:
        out: Outcome of each strike, in the columns of `outcome_columns`, (B, columns).
        path: Tip positions at equal intervals, (B, samples, d) [m], or with velocities (B, samples, 2 d), followed by
            their derivatives, if there are any; NaN after the strike's end.
        rows: All steps, strike after strike, in the columns of `row_columns`; `first_row` is the first row of each
            strike.
        y, dy: Observed quantities and their derivatives, (rows, C), strike after strike; `y_row` is the first row of
            each strike. NaN after divergence.
    """

    out: np.ndarray
    path: np.ndarray | None = None
    rows: np.ndarray | None = None
    first_row: np.ndarray | None = None
    y: np.ndarray | None = None
    dy: np.ndarray | None = None
    y_row: np.ndarray | None = None

    def observed(self) -> tuple[list[np.ndarray], list[np.ndarray]]:
        """Return the observed quantities of every strike, (S, C) each, and their derivatives (empty if not
        computed)."""
        assert self.y is not None
        assert self.y_row is not None
        changes = [] if self.dy is None else np.split(self.dy, self.y_row[1:])
        return np.split(self.y, self.y_row[1:]), changes


class Engine(Protocol):
    """Simulates batches of strikes of one system of arm and whip, in C++ or by CasADi's interpreter.

    Attributes:
        rung: Name of the engine: `simd`, `scalar` or `interpreter`.
    """

    rung: str

    def __call__(self, batch: Batch, *, threads: int | None = None) -> Rolled:
        """Simulate the batch with up to `threads` threads (None: one a core), and return its results."""
        ...


def empty_results(batch: Batch, system: System) -> Rolled:
    """Return results of a batch whose arrays have the right shapes, for an engine to fill."""
    B, n, a, d = len(batch.p), system.n, system.n_drive, system.dimension
    rolled = Rolled(np.empty((B, outcome_columns(a, d).width)))
    if batch.samples:
        width = d * (1 + batch.moving) * (1 + batch.forward)
        rolled.path = np.full((B, batch.samples, width), np.nan)
    if batch.with_rows:
        rolled.first_row = _firsts(batch.steps + 1)
        rolled.rows = np.empty((int((batch.steps + 1).sum()), row_columns(n, a, d).width))
    if batch.columns is not None:
        samples = batch.steps // batch.stride + 1
        rolled.y_row = _firsts(samples)
        rolled.y = np.full((int(samples.sum()), len(batch.columns)), np.nan)
        rolled.dy = np.full_like(rolled.y, np.nan) if batch.forward else None
    return rolled


def _firsts(counts: np.ndarray) -> np.ndarray:
    """Where each of successive parts begins."""
    return np.concatenate([[0], np.cumsum(counts)[:-1]]).astype(np.int64)


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
