"""A path on equal times, read at any time, and averaged over an exposure, together with its derivatives."""

from __future__ import annotations

import numpy as np

POINTS = 6  # of the interpolating polynomial: sixth order in the sampling interval
_TO_POLYNOMIAL = np.linalg.inv(np.vander(np.arange(POINTS), increasing=True))  # values at 0..5 -> coefficients
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(4)  # of the exposure's average


class Readings:
    """Where K readings of a path lie on its grid, and with what weights.

    A path stands still before its grid begins, as a strike does before its command, and after it ends.

    Args:
        at: Times of the readings [s], (K,).
        exposure: Each is the path's mean over this span around its time [s].
        start, interval, count: The grid [s].
    """

    def __init__(self, at: np.ndarray, *, exposure: float, start: float, interval: float, count: int) -> None:
        nodes, shares = (_NODES * exposure / 2, _WEIGHTS / 2) if exposure else (np.zeros(1), np.ones(1))
        place = (at[:, None] + nodes - start) / interval  # (K, E) on the grid
        inside = (place >= 0) & (place <= count - 1)
        place = np.clip(place, 0, count - 1)
        first = np.clip(np.floor(place).astype(int) - (POINTS // 2 - 1), 0, count - POINTS)
        x = (place - first)[..., None]
        powers = x ** np.arange(POINTS)
        rates = np.arange(POINTS) * x ** np.maximum(np.arange(POINTS) - 1, 0)
        self.index = first[..., None] + np.arange(POINTS)  # (K, E, 6)
        self.weight = powers @ _TO_POLYNOMIAL * shares[:, None]
        self.rate = rates @ _TO_POLYNOMIAL * (shares * inside)[..., None] / interval

    def value(self, path: np.ndarray, which: np.ndarray) -> np.ndarray:
        """Readings of quantities `which` (K,) of a path (..., S, quantities, d): (..., K, d)."""
        return np.einsum("...kepd,kep->...kd", path[..., self.index, which[:, None, None], :], self.weight)

    def velocity(self, path: np.ndarray, which: np.ndarray) -> np.ndarray:
        """Their derivative by the time of the reading, shaped like `value`."""
        return np.einsum("...kepd,kep->...kd", path[..., self.index, which[:, None, None], :], self.rate)
