"""A Kalman filter for a marker that rests, flies and cracks: constant acceleration, disturbed by white jerk."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class MotionGate:
    """How a marker moves, and how far from where it is expected it is looked for.

    Args:
        jerk: Spectral density of its jerk [m^2 / s^5]: it lets through what random strikes of 15 to 30 m/s do at the
            crack, where the tip strays by two decimetres within a frame from a constant acceleration.
        at_rest: Standard deviations of a resting marker's speed [m/s] and acceleration [m/s^2].
        in_flight: Likewise of one that was just found again.
        error: Error of a measurement [pixels].
        deviations: Standard deviations that are let through.
        narrowest: It is no narrower than this [pixels].
        fastest: A marker is no faster [m/s]; random strikes of the paper's whip stay below 35.
    """

    jerk: float = 2e7
    at_rest: tuple[float, float] = (1.0, 20.0)
    in_flight: tuple[float, float] = (12.0, 200.0)
    error: float = 0.3
    deviations: float = 4.0
    narrowest: float = 8.0
    fastest: float = 50.0


_GATE = MotionGate()


class MotionFilter:
    """Where a marker is, how it moves, and how sure that is; both coordinates share one covariance.

    Args:
        pixel: Position where it was seen first, (2,) [pixels].
        t: When [s].
        per_metre: Pixels per metre there.
        moving: Whether it may be in flight.
    """

    def __init__(self, pixel: np.ndarray, t: float, per_metre: float, *, moving: bool = False) -> None:
        speed, acceleration = _GATE.in_flight if moving else _GATE.at_rest
        self.t, self._per_metre = t, per_metre
        self._x = np.stack([pixel, np.zeros(2), np.zeros(2)])  # position, velocity, acceleration, (3, 2)
        self._P = np.diag([_GATE.error**2, (speed * per_metre) ** 2, (acceleration * per_metre) ** 2])
        self._jerk = _GATE.jerk * per_metre**2

    @property
    def pixel(self) -> np.ndarray:
        """Where it was seen last, (2,) [pixels]."""
        return self._x[0]

    @property
    def velocity(self) -> np.ndarray:
        """Velocity in the image [pixels/s], (2,)."""
        return self._x[1]

    def could_reach(self, t: float, pixel: np.ndarray) -> bool:
        """Whether any whip's tip gets from where it was seen last to `pixel` (2,) by the time t [s]."""
        farthest = _GATE.narrowest + _GATE.fastest * self._per_metre * max(t - self.t, 0.0)
        return float(np.hypot(*(pixel - self.pixel))) <= farthest

    def velocity_with(self, t: float, pixel: np.ndarray) -> np.ndarray:
        """What `velocity` would be after `update(t, pixel)`, (2,) [pixels/s]."""
        x, P = self._ahead(t)
        return x[1] + P[1, 0] / (P[0, 0] + _GATE.error**2) * (pixel - x[0])

    def _ahead(self, t: float) -> tuple[np.ndarray, np.ndarray]:
        d = max(t - self.t, 0.0)
        F = np.array([[1, d, d**2 / 2], [0, 1, d], [0, 0, 1]])
        Q = self._jerk * np.array(
            [[d**5 / 20, d**4 / 8, d**3 / 6], [d**4 / 8, d**3 / 3, d**2 / 2], [d**3 / 6, d**2 / 2, d]]
        )
        return F @ self._x, F @ self._P @ F.T + Q

    def predict(self, t: float) -> tuple[np.ndarray, float]:
        """Where it should be at t [s], (2,), and the radius of the gate around that [pixels]."""
        x, P = self._ahead(t)
        return x[0], max(_GATE.narrowest, _GATE.deviations * float(np.sqrt(P[0, 0] + _GATE.error**2)))

    def update(self, t: float, pixel: np.ndarray) -> None:
        """Take a measurement in: seen at `pixel` (2,) at t [s]."""
        x, P = self._ahead(t)
        gain = P[:, 0] / (P[0, 0] + _GATE.error**2)  # (3,)
        self._x = x + gain[:, None] * (pixel - x[0])
        self._P = P - np.outer(gain, P[0])
        self.t = t
