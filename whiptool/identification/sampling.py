"""A path on equal times, read at any time, and averaged over an exposure, together with its derivatives."""

from __future__ import annotations

import numpy as np

POINTS = 6  # of the interpolating polynomial: sixth order in the sampling interval
_TO_POLYNOMIAL = np.linalg.inv(np.vander(np.arange(POINTS), increasing=True))  # values at 0..5 -> coefficients
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(4)  # of the exposure's average


class Readings:
    """Interpolates K readings from paths that are sampled on an equidistant time grid.

    Before and after the grid a path is constant.

    Args:
        at: Times of the readings [s], (K,).
        exposure: Each reading is the mean of the path over this interval around its time [s].
        start, interval, count: First time [s], spacing [s] and number of points of the grid.
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
        """Return readings (..., K, d) of a path (..., S, quantities, d); `which` (K,) is the quantity of each
        reading."""
        return np.einsum("...kepd,kep->...kd", path[..., self.index, which[:, None, None], :], self.weight)

    def velocity(self, path: np.ndarray, which: np.ndarray) -> np.ndarray:
        """Return the derivatives of the readings by time [1/s], in the shape of `value`."""
        return np.einsum("...kepd,kep->...kd", path[..., self.index, which[:, None, None], :], self.rate)
