"""Motion of an emulated UR arm's joints under the commands of URScript.

The joints are stiff: the measured positions are those that the controller aims at, one period ago. What lags behind a
command is `servoj`, whose law the script manual describes: the joint is accelerated by the gain times the difference of
the command and the position projected forward by the look-ahead time, `q'' = gain (q_d - q - lookahead q')`. Its lag at
low frequencies is the look-ahead time. On a UR10e with 0.03 s and a gain of 1200, 34 ms were measured from sending to
reading, 4 to 6 ms of them without servoj (UniversalRobots/Universal_Robots_Client_Library, issue 86).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

PERIOD = 0.002  # [s] of the controller
SANITY = 150.0  # [rad/s^2] a sudden change of the target's speed beyond it is refused; not published, assumed
BRAKE = 20.0  # [rad/s^2] with which a stop of the controller's own brakes the fastest joint; not published, assumed


@dataclass(frozen=True)
class ServoJ:
    """Parameters of `servoj`: the target [rad], (6,), look-ahead time [s], and gain [1/s^2]."""

    target: np.ndarray
    lookahead: float
    gain: float


class UrJoints:
    """Positions q [rad] and speeds v [rad/s] of six joints, (6,), and their present command.

    Args:
        q: Positions at which the arm stands, (6,).
    """

    def __init__(self, q: np.ndarray) -> None:
        self.q, self.v, self.a = np.array(q, float), np.zeros(6), np.zeros(6)
        self._law: Callable[[], bool] = self._rest  # moves by one period, and returns whether it has ended

    @property
    def moving(self) -> bool:
        """Whether a joint moves."""
        return bool(np.abs(self.v).max() > 1e-9)

    def step(self) -> bool:
        """Move by one period; return whether the present command has been carried out."""
        before = self.v
        ended = self._law()
        self.a = (self.v - before) / PERIOD
        return ended

    def rest(self) -> None:
        """Stand still at once."""
        self.v, self._law = np.zeros(6), self._rest

    def servo(self, servo: ServoJ) -> None:
        """Follow a target as `servoj`; a command that follows another only changes the target."""
        self._law = lambda: self._servo(servo)

    def brake(self, deceleration: float) -> None:
        """Slow all joints down together, the fastest by a deceleration [rad/s^2], as `stopj`."""
        fastest = float(np.abs(self.v).max())
        self._slow(math.ceil(fastest / (deceleration * PERIOD) - 1e-9))

    def brake_within(self, duration: float) -> None:
        """Slow all joints down together within a duration [s], as `stopl` does for the time that the tool takes."""
        self._slow(math.ceil(duration / PERIOD - 1e-9))

    def accelerate(self, v: np.ndarray, acceleration: float) -> None:
        """Change to speeds (6,), the fastest change by an acceleration [rad/s^2], as `speedj`."""

        def law() -> bool:
            left = v - self.v
            share = min(1.0, acceleration * PERIOD / max(float(np.abs(left).max()), 1e-12))
            return self._move(self.v + share * left)

        self._law = law

    def move(self, q: np.ndarray, speed: float, acceleration: float) -> None:
        """Move to positions (6,) along a straight line with a trapezoid of the leading axis' speed, as `movej`."""
        start, span = self.q.copy(), q - self.q
        length = float(np.abs(span).max())
        peak = min(speed, math.sqrt(length * acceleration))  # a triangle where the way is short
        ramp = peak / acceleration
        total = ramp + (length / peak if peak > 0 else 0.0)
        t = 0.0

        def law() -> bool:
            nonlocal t
            t = min(t + PERIOD, total)
            done = _trapezoid(t, ramp, total, peak)
            where = start + span * (done / length if length else 1.0)
            self.v, self.q = (where - self.q) / PERIOD, where
            if t >= total:
                self.rest()
            return t >= total

        self._law = law

    def _rest(self) -> bool:
        return True

    def _servo(self, servo: ServoJ) -> bool:
        """One period with the target held, exactly: the law is linear."""
        step = _transition(servo.gain, servo.lookahead)
        state = step @ np.stack([self.q - servo.target, self.v])
        self.q, self.v = state[0] + servo.target, state[1]
        return False

    def _slow(self, periods: int) -> None:
        left = periods

        def law() -> bool:
            nonlocal left
            if left <= 1:
                self.rest()
                return True
            left -= 1
            return self._move(self.v * left / (left + 1))

        self._law = law

    def _move(self, v: np.ndarray) -> bool:
        self.q = self.q + (self.v + v) / 2 * PERIOD
        self.v = v
        return False


_steps: dict[tuple[float, float], np.ndarray] = {}


def _transition(gain: float, lookahead: float) -> np.ndarray:
    """What one period makes of the distance from the target and the speed, (2, 2)."""
    from scipy.linalg import expm

    key = (gain, lookahead)
    if key not in _steps:
        _steps[key] = expm(PERIOD * np.array([[0.0, 1.0], [-gain, -gain * lookahead]]))
    return _steps[key]


def _trapezoid(t: float, ramp: float, total: float, peak: float) -> float:
    """Way along a trapezoid of speed."""
    if t < ramp:
        return peak * t**2 / (2 * ramp)
    if t <= total - ramp:
        return peak * (t - ramp / 2)
    return peak * (total - ramp) - peak * (total - t) ** 2 / (2 * ramp)
