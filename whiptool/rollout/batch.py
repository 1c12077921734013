"""Batches of strikes: what engines are given, and what they give back."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, Protocol

import numpy as np

from whiptool.dynamics.closed_loop import Structure


@dataclass
class Batch:
    """Strikes to roll out, and what comes of them; B strikes, a arm joints, n joints, P parameters.

    Args:
        p: Parameters, (B, P).
        x0: States at the start, (B, 2 n).
        target: (B, 2) [m].
        h, h_last, steps, hold: As `time_grid` gives them.
        dp, dx0, dh, dh_last: Direction of each strike along which derivatives are taken, shaped like what they change;
            None: no derivatives.
        rate, samples: The tip's path is wanted at `samples` times, `rate` times a second.
        with_rows: Trajectories are wanted at every step.
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
    rate: float = 0.0
    samples: int = 0
    with_rows: bool = False

    PER_STRIKE: ClassVar = ("p", "x0", "target", "h", "h_last", "steps", "dp", "dx0", "dh", "dh_last")

    def take(self, order: np.ndarray) -> Batch:
        """The strikes in another order."""
        arrays = {name: getattr(self, name) for name in self.PER_STRIKE}
        return replace(self, **{k: None if x is None else np.ascontiguousarray(x[order]) for k, x in arrays.items()})

    @property
    def forward(self) -> bool:
        """Whether derivatives are taken."""
        return self.dp is not None


@dataclass
class Rolled:
    """What came of a batch.

    Args:
        out: Miss distance, its time, tip velocity x and y, tip x and y, diverged, last step, derivative of the miss
            distance, then largest speed and torque of each arm joint: (B, 9 + 2 a).
        path: Tip at equal times, (B, samples, 2), or with derivatives (B, samples, 4); NaN after the strike's end.
        rows: Time, state, torques at every step, strike after strike; `first_row` says where each begins.
    """

    out: np.ndarray
    path: np.ndarray | None = None
    rows: np.ndarray | None = None
    first_row: np.ndarray | None = None


class Engine(Protocol):
    """Rolls batches of one structure out."""

    rung: str

    def __call__(self, batch: Batch, *, threads: int | None = None) -> Rolled:
        """Roll the batch out."""
        ...


def empty_results(batch: Batch, structure: Structure) -> Rolled:
    """Arrays for the results of a batch."""
    B, columns = len(batch.p), 1 + 2 * structure.n + structure.n_arm
    rolled = Rolled(np.empty((B, 9 + 2 * structure.n_arm)))
    if batch.samples:
        rolled.path = np.full((B, batch.samples, 4 if batch.forward else 2), np.nan)
    if batch.with_rows:
        rolled.first_row = np.concatenate([[0], np.cumsum(batch.steps + 1)[:-1]]).astype(np.int64)
        rolled.rows = np.empty((int((batch.steps + 1).sum()), columns))
    return rolled
