"""Autocorrelation of the errors, estimated from a fit's residuals, and its effect on the fit's covariance.

Residuals are less correlated than the errors, because the fitted unknowns follow the errors. The expected products of
residuals are linear in the autocovariances of the errors, which are solved for; an autoregression, its order chosen by
Schwarz's criterion, extends them to any lag. Its covariance is not too small, unlike that of a block bootstrap or a lag
window, which give every pair of readings a reduced weight (Andrews and Monahan 1992).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import matmul_toeplitz

_MOST_TERMS, _READINGS_A_TERM = 6, 20  # of the autoregression: at most, and readings that there have to be for each
_LARGEST_PARTIAL = 0.98  # partial correlation: errors that never fade have no variance
_LONGEST_GAP = 100  # frames that count where readings are missing: errors have faded by then


@dataclass(frozen=True)
class Grid:
    """Arrangement of a recording's K readings by channel (a coordinate of a marker) and frame; missing ones are 0."""

    channels: np.ndarray  # labels of the recording's C channels, (C,)
    place: tuple[np.ndarray, np.ndarray]  # channel index and frame index of each reading, two arrays (K,)
    frames: int  # number F of frames

    @classmethod
    def of(cls, channel: np.ndarray, t: np.ndarray) -> Grid:
        """Return the grid of K readings with the given channel labels (K,) and times (K,) [s]."""
        channels, row = np.unique(channel, return_inverse=True)
        instants, which = np.unique(t, return_inverse=True)
        gaps = np.diff(instants)
        apart = np.round(gaps / np.median(gaps)) if len(gaps) else gaps
        frame = np.concatenate([[0], np.cumsum(np.clip(apart, 1, _LONGEST_GAP))]).astype(int)
        return cls(channels, (row, frame[which]), int(frame[-1]) + 1)

    def lay(self, x: np.ndarray) -> np.ndarray:
        """Return readings x (K, ...) arranged by channel and frame, (C, F, ...)."""
        laid = np.zeros((len(self.channels), self.frames, *x.shape[1:]))
        laid[self.place] = x
        return laid

    def neighbours(self, x: np.ndarray, lag: int) -> np.ndarray:
        """Return (K, ...): for each reading x, half the sum of its channel's readings `lag` frames before and after."""
        if lag >= self.frames:
            return np.zeros_like(x)
        laid = self.lay(x)
        total = np.zeros_like(laid)
        total[:, lag:] += laid[:, : self.frames - lag] / 2
        total[:, : self.frames - lag] += laid[:, lag:] / 2
        return total[self.place]


@dataclass(frozen=True)
class Autoregression:
    """A stationary autoregressive series e_t = sum_j a_j e_(t-j) + w_t of unit variance."""

    coefficients: np.ndarray  # coefficients a, (p,)
    first: np.ndarray  # autocorrelation at lags 0 to p, (p + 1,)
    innovation: float  # variance of w

    @property
    def long_run(self) -> float:
        """Variance of the mean of many values, relative to that of as many independent values."""
        return self.innovation / (1 - self.coefficients.sum()) ** 2

    def correlations(self, count: int) -> np.ndarray:
        """Return the autocorrelation at lags 0 to count - 1, (count,)."""
        known, p = list(self.first), len(self.coefficients)
        while len(known) < count:
            known.append(float(self.coefficients @ known[: -p - 1 : -1]) if p else 0.0)
        return np.array(known[:count])

    def independent(self, freedom: float, grids: Sequence[Grid]) -> float:
        """Return the degrees of freedom (at least 1) of the variance of errors with this autocorrelation, given those
        for independent errors; lags count up to the largest number of frames of the grids."""
        correlations = self.correlations(max(grid.frames for grid in grids))
        return max(freedom / (2 * float(correlations @ correlations) - 1), 1.0)


WHITE = Autoregression(np.zeros(0), np.ones(1), 1.0)


def autoregression(correlations: np.ndarray, most: int, readings: float) -> Autoregression:
    """Return the autoregression of at most `most` terms that Schwarz's criterion selects (Levinson's recursion), from
    the autocorrelation at lags 0 to `most` or more, estimated from that number of independent readings."""
    a, variance, known = np.zeros(0), 1.0, [1.0]
    best, lowest = WHITE, 0.0
    for p in range(1, most + 1):
        foreseen = float(a @ known[p - 1 : 0 : -1])
        partial = float(np.clip((correlations[p] - foreseen) / variance, -_LARGEST_PARTIAL, _LARGEST_PARTIAL))
        known.append(foreseen + partial * variance)
        a, variance = np.append(a - partial * a[::-1], partial), variance * (1 - partial**2)
        criterion = readings * np.log(variance) + p * np.log(readings)
        if criterion < lowest:
            best, lowest = Autoregression(a, np.array(known), variance), criterion
    return best


def error_correlation(
    grids: Sequence[Grid], residuals: Sequence[np.ndarray], followed: Sequence[np.ndarray], shared: int, freedom: float
) -> tuple[Autoregression, float]:
    """Return the autocorrelation in time of the errors that caused the whitened residuals (K,), and their variance.

    Errors with negative autocorrelation are taken as independent: fitting many unknowns makes residuals alternate, and
    the covariance of independent errors is then the larger one. Columns `followed` are, for each recording, U (K, G +
    L) such that the fit removes `U U' errors` from its errors; the first G, `shared`, belong to unknowns that all
    recordings share.
    """
    most = int(min(_MOST_TERMS, freedom // _READINGS_A_TERM))
    lags = range(2 * most + 1)
    seen = np.array([sum(r @ g.neighbours(r, k) for g, r in zip(grids, residuals, strict=True)) for k in lags])
    expected = _expected(grids, followed, shared, len(lags))
    covariances = np.linalg.lstsq(expected, seen, rcond=None)[0]
    if not covariances[0] > 0:
        return WHITE, float(seen[0]) / freedom
    found = autoregression(covariances / covariances[0], most, freedom)
    if found.long_run <= 1:
        return WHITE, float(seen[0]) / freedom
    return found, float(seen[0] / (expected[0] @ found.correlations(len(lags))))


def _expected(grids: Sequence[Grid], followed: Sequence[np.ndarray], shared: int, lags: int) -> np.ndarray:
    """E[sum of r_t r_(t+k)] of residuals r = (I - U U') e, by the autocovariance j of the errors e: (lags, lags)."""
    found, both = np.zeros((lags, lags)), np.zeros((lags, shared, shared))
    for grid, U in zip(grids, followed, strict=True):
        there = grid.lay(np.ones(len(U)))
        pairs = [np.sum(there[:, k:] * there[:, : grid.frames - k]) if k < grid.frames else 0.0 for k in range(lags)]
        found += np.diag(np.array(pairs) * np.where(np.arange(lags) > 0, 0.5, 1.0))
        moved = [grid.neighbours(U, k) for k in range(lags)]
        inner = np.stack([U.T @ x for x in moved])
        both += inner[:, :shared, :shared]
        inner[:, :shared, :shared] = 0
        moved = np.stack(moved).reshape(lags, -1)
        inner = inner.reshape(lags, -1)
        found += inner @ inner.T - 2 * moved @ moved.T
    both = both.reshape(lags, -1)
    found += both @ both.T
    found[:, 1:] *= 2  # a lag is found in both directions
    return found


def spread(
    grids: Sequence[Grid], residuals: Sequence[np.ndarray], slopes: Sequence[np.ndarray], errors: Autoregression
) -> np.ndarray:
    """Return the covariance of sum_t slope_t e_t for errors e of unit variance, (G, G); slopes (K, G) are the
    derivatives of each recording's whitened residuals (K,) along G directions of the shared unknowns.

    The correlation between channels is that of their residuals, multiplied at each lag by the autocorrelation in time.
    """
    names = np.unique(np.concatenate([g.channels for g in grids]))
    together = np.zeros((len(names), len(names)))
    rows = [np.searchsorted(names, g.channels) for g in grids]
    for row, grid, r in zip(rows, grids, residuals, strict=True):
        laid = grid.lay(r)
        together[np.ix_(row, row)] += laid @ laid.T
    size = np.sqrt(np.diag(together))
    size = np.where(size > 0, size, 1)
    together = together / np.outer(size, size)
    np.fill_diagonal(together, 1)
    total = 0.0
    for row, grid, slope in zip(rows, grids, slopes, strict=True):
        laid = grid.lay(slope)  # (C, F, G)
        passed = np.stack([matmul_toeplitz(errors.correlations(grid.frames), x) for x in laid])
        total = total + np.einsum("cd,cfg,dfh->gh", together[np.ix_(row, row)], laid, passed, optimize=True)
    return np.asarray(total)
