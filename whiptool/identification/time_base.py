"""Faults of a recording's time stamps, found from the residuals of a fit and the velocities of the markers.

A time stamp with error d causes a residual of d times the velocity. A late clock causes residuals proportional to the
velocity, a fast clock to velocity times time, and a lost or repeated frame to the velocity from then on. Each pattern
is the alternative of a Lagrange multiplier (score) test (Rao 1948): the residuals are regressed on it after projection
on the fitted unknowns is removed. The significance of the likeliest is corrected for the number of tests (Bonferroni).

A fit hides much of such a fault in the whip's parameters. If the test is inconclusive, the recordings are fitted again
with a separate clock each, and these clocks are tested.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import stdtr

from whiptool.identification.correlation import Grid, error_correlation, spread
from whiptool.identification.solver import Block

SIGNIFICANCE = 1e-3  # of a fit: how often sound recordings are taken for faulty ones
SHARE = 0.5  # of the unexplained errors that a fault has to explain
LEAST = 0.1  # frames: less is not a fault of stamps
DOUBT = 0.05  # above which a fit with separate clocks is worth its time
CLOCK = ("delay", "clock_rate")  # of a recording's own unknowns
_INSTANTS = 200  # of a recording, at most, at which a jump is tried
_SEEN = 1e-3  # of a fault's square, that the fitted unknowns leave: less cannot be distinguished from them
DELAY, RATE = CLOCK
JUMP = "jump"


@dataclass(frozen=True)
class ClockFault:
    """The error of a recording's time stamps that explains its residuals best."""

    recording: int  # index of the recording
    kind: str  # `delay`: all times are late; `clock_rate`: the clock runs fast; `jump`: times from `at` on are late
    size: float  # size of the error [s]; for `clock_rate` the relative error of the rate
    error: float  # standard error of `size`
    at: float | None  # time of a jump, by the recording's own clock [s]; else None
    frames: float  # largest error of a time stamp, in frame intervals
    p_value: float  # probability that correct recordings would show as large an effect in any of the tests
    share: float  # part of the recording's unexplained squared residuals that it explains; low: an error of the model

    @property
    def plain(self) -> bool:
        """Whether the fault is significant, large enough, and explains most of the residuals left by the fit."""
        return self.p_value <= SIGNIFICANCE and self.frames >= LEAST and self.share >= SHARE


@dataclass(frozen=True)
class FittedReadings:
    """One recording's readings at the end of a fit. For its own `delay` and `clock_rate` that were fitted and are to be
    tested, `clock` has the column of the block's B, and the fitted delay [s] or clock rate minus 1."""

    block: Block  # whitened residuals and derivatives, then the rows that regularise the recording's own unknowns
    channel: np.ndarray  # channel (marker and axis) of each residual, (K,)
    t: np.ndarray  # time of each reading [s], (K,)
    slope: np.ndarray  # whitened derivative of each reading by its time, (K,)
    clock: dict[str, tuple[int, float]]

    def without(self, kind: str) -> FittedReadings:
        """Return the readings as if the clock parameter `kind` had not been fitted."""
        b, column = self.block, self.clock[kind][0]
        return dataclasses.replace(self, block=Block(b.r, b.A, np.delete(b.B, column, axis=1)))


def likeliest_fault(
    readings: Sequence[FittedReadings], prior: np.ndarray | None, *, fitted: Sequence[str] = (), correlated: bool = True
) -> ClockFault | None:
    """Return the most likely fault of a recording's times, with its significance; None if none has an effect.

    If residuals scatter less than the stated errors, the stated errors are used. Kinds of faults that were `fitted` are
    not tested; `prior` (m, G) has the rows of the prior on the shared unknowns. If `correlated`, the autocorrelation of
    the residuals that remain without the fault is accounted for.
    """
    rest = _Rest(readings, prior)
    tried = [(i, *one) for i, r in enumerate(readings) for one in _alternatives(r, fitted)]
    regressions = [rest.regress(i, pattern * readings[i].slope) for i, _, _, pattern in tried]
    count = len(tried) + sum(len(r.clock) for r in readings)

    def judged(rest: _Rest, found: _Regression, size: float, i: int, kind: str, at: float | None) -> ClockFault:
        error, freedom = rest.error(found, correlated=correlated)
        p_value = min(1.0, 2 * count * float(stdtr(freedom, -abs(size) / error)))
        t = readings[i].t
        frame, most = float(np.median(np.diff(np.unique(t)))), np.abs(t).max() if kind == RATE else 1.0
        fall = size**2 * found.information
        squares = float((readings[i].block.r[: len(t)] ** 2).sum()) + (fall if kind in readings[i].clock else 0.0)
        share = fall / max(squares - len(t), fall)
        return ClockFault(i, kind, size, error, at, abs(size) * float(most) / frame, p_value, share)

    faults = []
    best = int(np.argmax([x.size**2 * x.information for x in regressions]))
    if (found := regressions[best]).left:
        faults.append(judged(rest, found, found.size, *tried[best][:3]))
    if not faults or faults[0].p_value > SIGNIFICANCE:  # what a steady clock does not explain goes first
        for i, r in enumerate(readings):
            for kind, (column, value) in r.clock.items():
                others = _Rest([*readings[:i], r.without(kind), *readings[i + 1 :]], prior)
                found = others.regress(i, r.block.B[: len(r.t), column])
                faults += [judged(others, found, value, i, kind, None)] if found.left else []
    return min(faults, key=lambda fault: fault.p_value, default=None)


def _alternatives(readings: FittedReadings, fitted: Sequence[str]) -> list[tuple[str, float | None, np.ndarray]]:
    """Kind, instant and how far stamps are off with time, (K,), of each fault that is tried and was not fitted."""
    t, frames = readings.t, np.unique(readings.t)
    steady = {DELAY: np.ones_like(t), RATE: t}
    found: list[tuple[str, float | None, np.ndarray]] = [
        (kind, None, x) for kind, x in steady.items() if kind not in fitted and kind not in readings.clock
    ]
    first = frames[1 :: max(1, math.ceil(len(frames) / _INSTANTS))]
    return found + [(JUMP, float(at), (t >= at).astype(float)) for at in first]


@dataclass(frozen=True)
class _Regression:
    """The residuals on one fault, all that was fitted taken out."""

    size: float  # size of the fault
    information: float  # squared length of what fitted unknowns leave of the fault
    left: list[np.ndarray]  # what they leave of it in each recording's readings


class _Rest:
    """What fitted unknowns leave of residuals and faults, by Frisch and Waugh."""

    def __init__(self, readings: Sequence[FittedReadings], prior: np.ndarray | None) -> None:
        self._readings = readings
        self._own = [np.linalg.qr(r.block.B)[0] for r in readings]
        A = [self._without(i, r.block.A) for i, r in enumerate(readings)]
        self._A, self._r = A, [self._without(i, r.block.r) for i, r in enumerate(readings)]
        rows = np.vstack([*A, np.zeros((0, A[0].shape[1])) if prior is None else prior])
        self._inverse = np.linalg.pinv(rows.T @ rows, rcond=1e-12, hermitian=True)
        along = sum(a.T @ r for a, r in zip(A, self._r, strict=True))
        self._r = [r - a @ (self._inverse @ along) for a, r in zip(A, self._r, strict=True)]
        counts = [len(r.t) for r in readings]
        self._squares = sum(float(r[:n] @ r[:n]) for r, n in zip(self._r, counts, strict=True))
        unknowns = A[0].shape[1] + sum(float((Q[:n] ** 2).sum()) for Q, n in zip(self._own, counts, strict=True))
        self._freedom = max(sum(counts) - unknowns - 1, 1.0)

    def _without(self, i: int, x: np.ndarray) -> np.ndarray:
        return x - self._own[i] @ (self._own[i].T @ x)

    def regress(self, i: int, fault: np.ndarray) -> _Regression:
        """The residuals on a fault of recording i's readings, (K,)."""
        padded = np.concatenate([fault, np.zeros(len(self._r[i]) - len(fault))])
        own = self._without(i, padded)
        shared = self._inverse @ (self._A[i].T @ own)
        information = float(own @ own - shared @ (self._A[i].T @ own))
        if not information > _SEEN * float(fault @ fault):
            return _Regression(0.0, 1.0, [])
        left = [-a @ shared for a in self._A]
        left[i] = left[i] + own
        size = sum(float(x @ r) for x, r in zip(left, self._r, strict=True)) / information
        return _Regression(size, information, left)

    def error(self, found: _Regression, *, correlated: bool) -> tuple[float, float]:
        """Standard error of a fault's size, and the degrees of freedom of that."""
        root = math.sqrt(found.information)
        squares = max(self._squares - found.size**2 * found.information, 0.0)
        variance = max(squares / self._freedom, 1.0)
        if not correlated:
            return math.sqrt(variance) / root, self._freedom
        rest, grids, slopes, followed = [], [], [], []
        for r, left, own, A, readings in zip(self._r, found.left, self._own, self._A, self._readings, strict=True):
            n = len(readings.t)
            grids.append(Grid.of(readings.channel, readings.t))
            rest.append((r - found.size * left)[:n])
            slopes.append(left[:n, None] / found.information)
            followed.append(np.hstack([A[:n] @ self._half, left[:n, None] / root, own[:n]]))
        errors, level = error_correlation(
            grids, rest, followed, followed[0].shape[1] - self._own[0].shape[1], self._freedom
        )
        if not len(errors.coefficients):
            return math.sqrt(variance) / root, self._freedom
        scatter = float(spread(grids, rest, slopes, errors)[0, 0]) * max(level, 1.0)
        return math.sqrt(max(scatter, variance / found.information)), errors.independent(self._freedom, grids)

    @property
    def _half(self) -> np.ndarray:
        """A root of the inverse: `A half` has orthonormal columns, except for a prior."""
        size, V = np.linalg.eigh(self._inverse)
        return V * np.sqrt(np.maximum(size, 0.0))
