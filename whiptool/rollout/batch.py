"""Batches of strikes: what engines are given, and what they give back."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, Protocol

import numpy as np

from whiptool.dynamics.columns import outcome_columns, row_columns
from whiptool.dynamics.system import System

_STEP_OF_TOLERANCE = 0.05  # [s per square root of a metre]


@dataclass
class Batch:
    """Strikes to roll out, and what comes of them; B strikes, a arm joints, n joints, P parameters.

    Args:
        p: Parameters, (B, P).
        x0: States at the start, (B, 2 n).
        target: (B, d) [m], d the dimension: 2 in the plane, 3 in space.
        h, h_last, steps, hold: As `time_grid` gives them.
        dp, dx0, dh, dh_last: Direction of each strike along which derivatives are taken, shaped like what they change;
            None: no derivatives.
        u, du: Inputs at successive instants and their changes, (rows, inputs); a strike needs steps + 2 rows.
        u_row, du_row: First row of each strike's in them, (B,); a negative du_row: its inputs do not change.
        rate, samples: The tip's path is wanted at `samples` times, `rate` times a second.
        with_rows: Trajectories are wanted at every step.
        tolerance: Error of a step that a strike takes [m], (B,); each then chooses its steps, and `h`, `h_last` and
            `steps` are the instants at which it is observed; None: these are the steps.
        knot: When the reference of a strike ends [s], (B,).
        weight: How far each coordinate moves the tip [m], (n,).
        period: For which a torque is held [s]; 0: it is not.
        columns, stride: Columns and stride of what is observed (see `System.step`), to keep every `stride` steps,
            (C,).
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
        """The strikes in another order."""
        arrays = {name: getattr(self, name) for name in self.PER_STRIKE}
        return replace(self, **{k: None if x is None else np.ascontiguousarray(x[order]) for k, x in arrays.items()})

    def in_equal_steps(self) -> Batch:
        """Return the batch for an engine that does not choose steps: as short, all alike, as the tolerances ask for.

        The errors of such steps, and of the segments between them, are of second order at least: steps are as the
        tolerances' square roots. What is observed stays so at the same instants, with a whole number of steps between
        them; of trajectories they are the steps.
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
    """What came of a batch.

    Args:
        out: Outcome of each strike, in the columns of `outcome_columns`, (B, columns).
        path: Tip at equal times, (B, samples, d), or with derivatives (B, samples, 2 d); NaN after the strike's end.
        rows: Every step, strike after strike, in the columns of `row_columns`; `first_row` says where each begins.
        y, dy: What is observed and its derivatives, (rows, C), strike after strike; `y_row` says where each begins.
            NaN from where a strike diverged.
    """

    out: np.ndarray
    path: np.ndarray | None = None
    rows: np.ndarray | None = None
    first_row: np.ndarray | None = None
    y: np.ndarray | None = None
    dy: np.ndarray | None = None
    y_row: np.ndarray | None = None

    def observed(self) -> tuple[list[np.ndarray], list[np.ndarray]]:
        """Return what is observed of every strike, each (S, C), and its derivatives (none: empty)."""
        assert self.y is not None
        assert self.y_row is not None
        changes = [] if self.dy is None else np.split(self.dy, self.y_row[1:])
        return np.split(self.y, self.y_row[1:]), changes


class Engine(Protocol):
    """Rolls batches of one system out."""

    rung: str

    def __call__(self, batch: Batch, *, threads: int | None = None) -> Rolled:
        """Roll the batch out."""
        ...


def empty_results(batch: Batch, system: System) -> Rolled:
    """Return arrays for the results of a batch."""
    B, n, a, d = len(batch.p), system.n, system.n_drive, system.dimension
    rolled = Rolled(np.empty((B, outcome_columns(a, d).width)))
    if batch.samples:
        rolled.path = np.full((B, batch.samples, 2 * d if batch.forward else d), np.nan)
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
