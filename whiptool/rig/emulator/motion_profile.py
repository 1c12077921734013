"""The profiles on which an emulated servo moves to a goal.

Source: https://emanual.robotis.com/docs/en/dxl/x/xm430-w350/, "What is the Profile". Positions are in counts (1/4096
rev), times in seconds. The jerk control that older versions of the manual mention is left out, because no version says
how it works.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

VELOCITY = 0.229 / 60 * 4096  # [counts/s] of one count of Profile Velocity(112), 0.229 rev/min
ACCELERATION = 214.577 / 3600 * 4096  # [counts/s2] of one count of Profile Acceleration(108), 214.577 rev/min2
STEP, RECTANGULAR, TRIANGULAR, TRAPEZOIDAL = range(4)  # bits 4 and 5 of Moving Status(123)


@dataclass(frozen=True)
class Profile:
    """A movement in pieces of constant acceleration.

    Args:
        kind: `STEP`, `RECTANGULAR`, `TRIANGULAR` or `TRAPEZOIDAL`.
        start, velocity: Position [counts] and velocity [counts/s] at time 0; a rectangular profile jumps to its
            velocity.
        pieces: Duration [s] and acceleration [counts/s2] of each piece.
        end, end_velocity: Position [counts] and velocity [counts/s] after the last piece.
    """

    kind: int
    start: float
    velocity: float
    pieces: tuple[tuple[float, float], ...]
    end: float
    end_velocity: float = 0.0

    @property
    def duration(self) -> float:
        """Duration of the movement [s]."""
        return sum(duration for duration, _ in self.pieces)

    def at(self, t: float) -> tuple[float, float, float]:
        """Return position [counts], velocity [counts/s] and acceleration [counts/s2] at time t >= 0 [s]."""
        p, v = self.start, self.velocity
        for duration, a in self.pieces:
            h = min(t, duration)
            p, v = p + v * h + a * h * h / 2, v + a * h
            t -= duration
            if t < 0:
                return p, v, a
        return self.end, self.end_velocity, 0.0


def resting(position: float) -> Profile:
    """Return the profile of a servo that stays at a position [counts], or steps to it."""
    return Profile(STEP, position, 0.0, (), position)


def to_position(p: float, v: float, goal: float, *, velocity: int, acceleration: int, timed: bool) -> Profile:
    """Return the profile from position p [counts] and velocity v [counts/s] to rest at `goal` [counts].

    Args:
        velocity, acceleration: Values of the registers Profile Velocity and Profile Acceleration. Without a velocity
            the profile is a step, without an acceleration it is rectangular.
        timed: The registers are the movement's total time and acceleration time [ms], the latter at most half of the
            former (bit 2 of Drive Mode). Else they are its largest velocity and its acceleration.
    """
    if velocity == 0:
        return resting(goal)
    if timed:
        return _in_time(p, v, goal, total=velocity / 1000, rising=min(acceleration, velocity / 2) / 1000)
    top = velocity * VELOCITY
    if acceleration == 0:
        speed = math.copysign(top, goal - p)
        return Profile(RECTANGULAR, p, speed, (((goal - p) / speed, 0.0),), goal)
    return _trapezoid(p, v, goal, top=top, a=acceleration * ACCELERATION)


def _in_time(p: float, v: float, goal: float, *, total: float, rising: float) -> Profile:
    """The profile that takes `total` [s], and `rising` [s] each to accelerate and to brake."""
    top = (goal - p - v * rising / 2) / (total - rising)
    if rising == 0:
        return Profile(RECTANGULAR, p, top, ((total, 0.0),), goal)
    kind = TRIANGULAR if 2 * rising == total else TRAPEZOIDAL
    pieces = ((rising, (top - v) / rising), (total - 2 * rising, 0.0), (rising, -top / rising))
    return Profile(kind, p, v, pieces, goal)


def _trapezoid(p: float, v: float, goal: float, *, top: float, a: float) -> Profile:
    """The fastest profile within a velocity `top` [counts/s] and an acceleration `a` [counts/s2].

    A servo that is too fast to stop at the goal, or moves away from it, brakes first and comes back.
    """
    stop = p + v * abs(v) / (2 * a)  # where it comes to rest if it brakes at once
    direction = math.copysign(1.0, goal - stop)
    distance, v0 = direction * (goal - p), direction * v
    highest = math.sqrt(max(a * distance + v0 * v0 / 2, 0.0))  # without a cruise
    peak = min(highest, top)
    rise, fall = abs(peak - v0) / a, peak / a
    cruise = 0.0 if peak == highest else (distance - (v0 + peak) / 2 * rise - peak / 2 * fall) / peak
    first = math.copysign(a, peak - v0)  # it brakes down to `top` if it is faster
    pieces = ((rise, direction * first), (cruise, 0.0), (fall, -direction * a))
    return Profile(TRIANGULAR if cruise == 0 else TRAPEZOIDAL, p, v, pieces, goal)


def to_velocity(v: float, goal: float, *, acceleration: int, timed: bool) -> Profile:
    """Return the profile from velocity v to `goal` [counts/s], of which the position is of no meaning.

    Args:
        acceleration: Value of the register Profile Acceleration; 0: the profile is a step.
        timed: The register is the time of acceleration [ms] (bit 2 of Drive Mode). Else it is the acceleration.
    """
    if acceleration == 0 or goal == v:
        return Profile(STEP, 0.0, goal, (), 0.0, goal)
    rise = acceleration / 1000 if timed else abs(goal - v) / (acceleration * ACCELERATION)
    return Profile(TRAPEZOIDAL, 0.0, v, ((rise, (goal - v) / rise),), 0.0, goal)
