"""A Kalman filter for a marker that rests, flies and cracks: constant acceleration, disturbed by white jerk."""

from __future__ import annotations

import numpy as np

# Spectral density of a marker's jerk [m^2 / s^5]: it lets through what random strikes of 15 to 30 m/s do at the crack,
# where the tip strays by two decimetres within a frame from a constant acceleration
_JERK = 2e7
_AT_REST = 1.0, 20.0  # standard deviations of a resting marker's speed [m/s] and acceleration [m/s^2]
_IN_FLIGHT = 12.0, 200.0  # likewise of one that was just found again
_ERROR = 0.3  # of a measurement [pixels]
_DEVIATIONS = 4.0  # standard deviations that the gate, within which a marker is looked for, lets through
_NARROWEST = 8.0  # radius of the gate, at least [pixels]
_FASTEST = 50.0  # a marker is no faster [m/s]; random strikes of the paper's whip stay below 35


class MotionFilter:
    """Kalman filter of a marker's motion in the image; both coordinates share one covariance.

    Args:
        pixel: First measured position, (2,) [pixels].
        t: Time of the first measurement [s].
        per_metre: Image scale there [pixels/m].
        moving: Whether the marker may be moving.
    """

    def __init__(self, pixel: np.ndarray, t: float, per_metre: float, *, moving: bool = False) -> None:
        speed, acceleration = _IN_FLIGHT if moving else _AT_REST
        self.t, self._per_metre = t, per_metre
        self._x = np.stack([pixel, np.zeros(2), np.zeros(2)])  # position, velocity, acceleration, (3, 2)
        self._P = np.diag([_ERROR**2, (speed * per_metre) ** 2, (acceleration * per_metre) ** 2])
        self._jerk = _JERK * per_metre**2

    @property
    def pixel(self) -> np.ndarray:
        """Last position, (2,) [pixels]."""
        return self._x[0]

    @property
    def velocity(self) -> np.ndarray:
        """Velocity in the image [pixels/s], (2,)."""
        return self._x[1]

    def could_reach(self, t: float, pixel: np.ndarray) -> bool:
        """Whether a whip's tip could have moved from its last position to `pixel` (2,) by the time t [s]."""
        farthest = _NARROWEST + _FASTEST * self._per_metre * max(t - self.t, 0.0)
        return float(np.hypot(*(pixel - self.pixel))) <= farthest

    def velocity_with(self, t: float, pixel: np.ndarray) -> np.ndarray:
        """Return the velocity after `update(t, pixel)`, (2,) [pixels/s], without updating."""
        x, P = self._ahead(t)
        return x[1] + P[1, 0] / (P[0, 0] + _ERROR**2) * (pixel - x[0])

    def _ahead(self, t: float) -> tuple[np.ndarray, np.ndarray]:
        d = max(t - self.t, 0.0)
        F = np.array([[1, d, d**2 / 2], [0, 1, d], [0, 0, 1]])
        Q = self._jerk * np.array(
            [[d**5 / 20, d**4 / 8, d**3 / 6], [d**4 / 8, d**3 / 3, d**2 / 2], [d**3 / 6, d**2 / 2, d]]
        )
        return F @ self._x, F @ self._P @ F.T + Q

    def predict(self, t: float) -> tuple[np.ndarray, float]:
        """Return the expected position at time t [s], (2,), and the search radius around it [pixels]."""
        x, P = self._ahead(t)
        return x[0], max(_NARROWEST, _DEVIATIONS * float(np.sqrt(P[0, 0] + _ERROR**2)))

    def update(self, t: float, pixel: np.ndarray) -> None:
        """Update with a measured position `pixel` (2,) at time t [s]."""
        x, P = self._ahead(t)
        gain = P[:, 0] / (P[0, 0] + _ERROR**2)  # (3,)
        self._x = x + gain[:, None] * (pixel - x[0])
        self._P = P - np.outer(gain, P[0])
        self.t = t
