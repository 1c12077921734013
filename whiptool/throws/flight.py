"""Flight of a thrown thing through gravity and quadratic air drag to the plane of a box's opening, with derivatives.

The equations of motion are `p' = v` and `v' = g - k |v| v`, with k the drag per mass [1/m] (e.g. Timmerman and van der
Weele 1999, Am. J. Phys. 67, 538). The classical Runge-Kutta method integrates them with a fixed number of steps, which
is exact without drag, and together with them their derivatives by the velocity at release and by k.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from whiptool.models.numbers import NoArray, number

AIR_DENSITY = 1.2  # [kg/m^3], at 20 degrees Celsius
SPHERE = 0.47  # drag coefficient of a sphere at Reynolds numbers of 1e3 to 1e5
STEPS = 16  # of the rise, and of the fall; `tests/throws/test_flight.py` has the errors
_NEWTON = 3  # further steps to the apex, and to the plane


@dataclass(frozen=True)
class Thing(NoArray, instead="its mass and drag"):
    """A thing that is thrown, as a point with drag.

    Args:
        mass: Mass [kg].
        drag: Quadratic air drag [N s^2/m^2]: the force is `-drag |v| v`; see `of_ball`.
        radius: Radius [m], by which the opening of a box is narrower for its centre.

    Raises:
        InputError: The mass is not positive, or a number is negative or not finite.
    """

    mass: float = 0.02
    drag: float = 0.0
    radius: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "mass", number("mass of the thing", self.mass, low=0, strict=True))
        for name in ("drag", "radius"):
            object.__setattr__(self, name, number(f"{name} of the thing", getattr(self, name), low=0))

    @classmethod
    def of_ball(cls, mass: float, diameter: float) -> Thing:
        """Return a ball of a mass [kg] and a diameter [m], with the drag of a smooth sphere in air."""
        radius = number("diameter of the thing", diameter, low=0) / 2
        return cls(mass, AIR_DENSITY / 2 * SPHERE * math.pi * radius**2, radius)

    @property
    def drag_per_mass(self) -> float:
        """Drag divided by mass [1/m]."""
        return self.drag / self.mass


@dataclass(frozen=True)
class Opening:
    """The planes of openings towards which R things fly, as they are at release.

    Args:
        centres: Centres of the openings, (R, d) [m].
        normal: Unit vector out of the box, (d,), with an upward component.
        drift: Velocity of the box, (d,) [m/s].
        radius: Radius of the openings [m].
    """

    centres: np.ndarray
    normal: np.ndarray
    drift: np.ndarray
    radius: float = 0.0


@dataclass(frozen=True)
class Landing:
    """Where R things cross the plane of an opening into the box; those that stay below it: their highest point.

    Args:
        offset: Position relative to the centre of the opening at that instant, (R, d) [m]; of those that stay below,
            lowered by the opening's radius.
        velocity: Velocity, (R, d) [m/s].
        time: Time since release, (R,) [s].
        slopes: Derivatives of offset and velocity by position and velocity at release, and by drag per mass,
            (R, 2 d, 2 d + 1); None: not computed.
        time_slopes: Derivatives of `time`, (R, 2 d + 1).
    """

    offset: np.ndarray
    velocity: np.ndarray
    time: np.ndarray
    slopes: np.ndarray | None = None
    time_slopes: np.ndarray | None = None


def land(
    states: np.ndarray, opening: Opening, *, gravity: float, drag: float, steps: int = STEPS, slopes: bool = False
) -> Landing:
    """Return where things land that are released in given states.

    Seen from the box, a thing first rises to its highest point over the opening's plane, and then falls through it. A
    thing that does not rise above the plane does not enter, however near it comes: it counts with its highest point,
    lowered by the opening's radius.

    Args:
        states: Positions and velocities at release, (R, 2 d) [m, m/s].
        opening: Openings of the boxes.
        gravity: Gravity [m/s^2], along the last axis.
        drag: Drag per mass [1/m].
        steps: Number of Runge-Kutta steps of the rise, and of the fall.
        slopes: Whether to compute derivatives.
    """
    d = states.shape[1] // 2
    down = np.zeros(d)
    down[-1] = -gravity
    flight = _Flight(states[:, :d].copy(), states[:, d:].copy(), down, drag, slopes=slopes)
    n, u = opening.normal, opening.drift
    rising = np.maximum((flight.velocity - u) @ n, 0.0) > 0
    steps = steps if drag else 1
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        flight.go(_rise_time(np.maximum((flight.velocity - u) @ n, 0.0), float(-down @ n), drag), steps, graded=True)
        for _ in range(_NEWTON if drag else 0):
            flight.go(np.where(rising, -((flight.velocity - u) @ n) / (flight.acceleration @ n), 0.0), 1)
        height, speed = flight.height(opening), (flight.velocity - u) @ n
        above = height > 0
        fall = np.sqrt(np.maximum(speed**2 - 2 * (down @ n) * height, 0.0))
        longer = _fall_ratio(np.maximum(height, 0.0), drag)
        flight.go(np.where(above, (-speed - fall) / (down @ n) * longer, 0.0), steps)
        for _ in range(_NEWTON if drag else 1):
            flight.go(np.where(above, -flight.height(opening) / ((flight.velocity - u) @ n), 0.0), 1)
    lowered = np.where(above, 0.0, opening.radius)[:, None] * n
    offset = flight.place - opening.centres - u * flight.time[:, None] - lowered
    if not slopes:
        return Landing(offset, flight.velocity, flight.time)
    fixed = flight.slopes()  # at a fixed time of flight
    into, turns = (flight.velocity - u) @ n, flight.acceleration @ n
    by_place, by_velocity = (np.einsum("d,rdm->rm", n, x) for x in (fixed[:, :d], fixed[:, d:]))
    sooner = np.where(rising[:, None], -by_velocity / np.where(turns == 0, 1, turns)[:, None], 0.0)
    crossed = -by_place / np.where(into == 0, 1, into)[:, None]
    later = np.where(above[:, None], crossed, sooner)  # (R, 2 d + 1)
    rates = np.concatenate([flight.velocity - u, flight.acceleration], axis=1)
    return Landing(offset, flight.velocity, flight.time, fixed + rates[:, :, None] * later[:, None, :], later)


def _rise_time(speed: np.ndarray, gravity: float, drag: float) -> np.ndarray:
    """Return how long things rise that begin to rise vertically at a speed (R,) [m/s], (R,) [s]."""
    if not drag:
        return speed / gravity
    return np.arctan(speed * math.sqrt(drag / gravity)) / math.sqrt(drag * gravity)


def _fall_ratio(height: np.ndarray, drag: float) -> np.ndarray:
    """Return the time of a vertical fall from rest over that without drag, of heights (R,) [m], (R,)."""
    x = drag * height
    found = (x + np.log1p(np.sqrt(-np.expm1(-2 * x)))) / np.sqrt(np.where(x > 0, 2 * x, 1.0))
    return np.where(x > 0, found, 1.0)


def fly(state: np.ndarray, times: np.ndarray, down: np.ndarray, drag: float) -> tuple[np.ndarray, np.ndarray]:
    """Return positions and velocities (R, d) of a thing released in a state (1, 2 d), after times (R,) [s].

    Args:
        state, times: State at release [m, m/s], and times since then [s].
        down: Acceleration by gravity, (d,) [m/s^2].
        drag: Drag per mass [1/m].
    """
    many = np.repeat(state, len(times), axis=0)
    place, velocity = np.split(many, 2, axis=1)
    flight = _Flight(place, velocity, down, drag, slopes=False)
    flight.go(times, 2 * STEPS if drag else 1, graded=True)
    return flight.place, flight.velocity


class _Flight:
    """R things in flight, and how they change by velocity at release and drag per mass."""

    def __init__(self, place: np.ndarray, velocity: np.ndarray, down: np.ndarray, drag: float, *, slopes: bool) -> None:
        R, d = place.shape
        self.place, self.velocity, self.time, self.down, self.drag = place, velocity, np.zeros(R), down, drag
        self.by: list[np.ndarray] = []  # of place and velocity, (R, d, d + 1) each
        if slopes:
            self.by = [np.zeros((R, d, d + 1)), np.tile(np.eye(d, d + 1), (R, 1, 1))]

    @property
    def acceleration(self) -> np.ndarray:
        return self._falls(self.velocity, np.linalg.norm(self.velocity, axis=1, keepdims=True))

    def height(self, opening: Opening) -> np.ndarray:
        """Height over the opening's plane, (R,) [m]."""
        return (self.place - opening.centres - opening.drift * self.time[:, None]) @ opening.normal

    def go(self, span: np.ndarray, steps: int, *, graded: bool = False) -> None:
        """Fly on for some time, (R,) [s], by the classical Runge-Kutta method.

        Graded steps are in proportion to 1, 2, 3, ..., for a speed that is highest at first.
        """
        for i in range(steps):
            h = span * (2 * (i + 1) / (steps * (steps + 1)) if graded else 1 / steps)
            now = [self.place, self.velocity, *self.by]
            one = self._rates(now)
            two = self._rates(_ahead(now, one, h / 2))
            three = self._rates(_ahead(now, two, h / 2))
            four = self._rates(_ahead(now, three, h))
            mean = [(a + 2 * (b + c) + e) / 6 for a, b, c, e in zip(one, two, three, four, strict=True)]
            self.place, self.velocity, *self.by = _ahead(now, mean, h)
        self.time = self.time + span

    def slopes(self) -> np.ndarray:
        """Derivatives of place and velocity by place and velocity at release and by drag, (R, 2 d, 2 d + 1)."""
        R, d = self.place.shape
        of_place = np.concatenate([np.tile(np.eye(d), (R, 1, 1)), np.zeros((R, d, d))], axis=1)
        return np.concatenate([of_place, np.concatenate(self.by, axis=1)], axis=2)

    def _falls(self, velocity: np.ndarray, speed: np.ndarray) -> np.ndarray:
        return self.down - self.drag * speed * velocity

    def _rates(self, now: list[np.ndarray]) -> list[np.ndarray]:
        velocity, speed = now[1], np.linalg.norm(now[1], axis=1, keepdims=True)
        found = [velocity, self._falls(velocity, speed)]
        if self.by:
            dvelocity = now[3]
            unit = np.divide(velocity, speed, out=np.zeros_like(velocity), where=speed > 0)
            dspeed = np.einsum("rd,rdm->rm", unit, dvelocity)
            change = -self.drag * (speed[..., None] * dvelocity + velocity[..., None] * dspeed[:, None, :])
            change[..., -1] -= speed * velocity
            found += [dvelocity, change]
        return found


def _ahead(now: list[np.ndarray], rates: list[np.ndarray], h: np.ndarray) -> list[np.ndarray]:
    """States (R, ...) after a time h (R,) at constant rates."""
    return [x + h.reshape(-1, *[1] * (x.ndim - 1)) * rate for x, rate in zip(now, rates, strict=True)]
