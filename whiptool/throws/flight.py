"""Flight of a thrown thing through gravity and quadratic air drag to the plane of a box's opening, with derivatives.

The equations of motion are `p' = v` and `v' = g - k |v| v`, with k the drag per mass [1/m] (e.g. Timmerman and van der
Weele 1999, Am. J. Phys. 67, 538). Without drag the path is a parabola. With drag the classical Runge-Kutta method
integrates it, in steps that for each thing keep the error of a step below a tolerance, and together with it
its derivatives by the velocity at release and by k.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from whiptool.errors import InputError
from whiptool.models.numbers import NoArray, number
from whiptool.throws.passage import Opening, overlap, passage

AIR_DENSITY = 1.2  # [kg/m^3], at 20 degrees Celsius
SPHERE = 0.47  # drag coefficient of a sphere at Reynolds numbers of 1e3 to 1e5
MOST_DRAG = 100.0  # [1/m] per mass; a party balloon has about 5
HIGHEST = 5.0  # [m], by which a thing may rise above its release and above the opening's plane
EXACT = 1e-10  # [m], error of a step; `tests/throws/test_flight.py` has those of flights
_ARRIVED, _IN_PLANE = 1e-12, 1e-9  # [s, m], from an event
_MOST_STEPS = 20_000
LONGEST = 60.0  # [s]; a thing that has not arrived by then does not arrive


@dataclass(frozen=True)
class Thing(NoArray, instead="its mass and drag"):
    """A thing that is thrown, as a point with drag.

    Args:
        mass: Mass [kg].
        drag: Quadratic air drag [N s^2/m^2]: the force is `-drag |v| v`; see `of_ball`.
        radius: Radius [m], by which the opening of a box is narrower for its centre.

    Raises:
        InputError: The mass is not positive, a number is negative or not finite, or drag / mass above `MOST_DRAG`.
    """

    mass: float = 0.02
    drag: float = 0.0
    radius: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "mass", number("mass of the thing", self.mass, low=0, strict=True))
        for name in ("drag", "radius"):
            object.__setattr__(self, name, number(f"{name} of the thing", getattr(self, name), low=0))
        if self.drag_per_mass > MOST_DRAG:
            rule = f"at most {MOST_DRAG:g} 1/m; a party balloon has about 5"
            raise InputError(
                "drag per mass of the thing", self.drag_per_mass, rule, "give its mass in kg, its diameter in m"
            )

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
class Landing:
    """Where R things cross the plane of an opening into the box; those that stay below it: their highest point.

    Args:
        offset: Position relative to the centre of the opening at that instant as it counts, see `passage`, (R, d) [m];
            of those that stay below, lowered by the opening's radius; of those that rise too high, or through the
            opening or its rim, raised.
        velocity: Velocity, (R, d) [m/s].
        time: Time since release, (R,) [s].
        slopes: Derivatives of offset and velocity by position and velocity at release, and by drag per mass,
            (R, 2 d, 2 d + 1); None: not computed.
        place: Position relative to the centre of the opening as it is, (R, d) [m].
        arrives: Whether it comes down through the opening's plane, (R,).
    """

    offset: np.ndarray
    velocity: np.ndarray
    time: np.ndarray
    slopes: np.ndarray | None = None
    place: np.ndarray | None = None
    arrives: np.ndarray | None = None


def land(
    states: np.ndarray,
    opening: Opening,
    *,
    gravity: float,
    drag: float,
    tolerance: float = EXACT,
    slopes: bool = False,
) -> Landing:
    """Return where things land that are released in given states.

    Seen from the box, a thing first rises to its highest point over the opening's plane, and then falls through it. A
    thing that does not rise above the plane does not enter, however near it comes: it counts with its highest point,
    lowered by the opening's radius. A thing that rises by more than `HIGHEST` does not count as entering either, and
    neither does one released under the plane that does not rise through it wholly outside of the rim.

    Args:
        states: Positions and velocities at release, (R, 2 d) [m, m/s].
        opening: Openings of the boxes.
        gravity: Gravity [m/s^2], along the last axis.
        drag: Drag per mass [1/m].
        tolerance: Error of a step [m].
        slopes: Whether to compute derivatives.
    """
    d = states.shape[1] // 2
    down = np.zeros(d)
    down[-1] = -gravity
    flight = _Flight(states[:, :d].copy(), states[:, d:].copy(), down, drag, slopes=slopes, tolerance=tolerance)
    n, u, begin = opening.normal, opening.drift, flight.height(opening)
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        rising = (flight.velocity - u) @ n > 0
        flight.go(_to_top, opening, rising)
        height, top = flight.height(opening), np.einsum("d,rdm->rm", n, flight.slopes()[:, :d]) if slopes else None
        above = height > 0
        flight.go(_to_plane, opening, above)
        if not drag:
            flight.step(np.where(above, -flight.height(opening) / ((flight.velocity - u) @ n), 0.0))
    place, seen = flight.place - opening.centres - u * flight.time[:, None], flight.velocity - u
    arrives, excess = above & (np.abs(place @ n) < _IN_PLANE), height - np.maximum(begin, 0.0) - HIGHEST
    counted, by_place, by_seen = passage(place, seen, opening, down, flight.time)
    raised = np.where(arrives, np.where(excess > 0, opening.radius + excess, 0.0), np.copysign(opening.radius, height))
    low = np.flatnonzero(arrives & rising & (begin < opening.ball))  # those that cross the plane upward first
    start = _Flight(states[low, :d], states[low, d:], down, drag, slopes=slopes, tolerance=tolerance)
    within, by_rise = _rise(start, replace(opening, centres=opening.centres[low]))
    raised[low] += np.where(within > 0, opening.radius + within, 0.0)
    offset = np.where(arrives[:, None], counted, place) + raised[:, None] * n
    if top is None:
        return Landing(offset, flight.velocity, flight.time, place=place, arrives=arrives)
    whole = flight.slopes_at_event(opening, np.where(above, 1, np.where(rising, -1, 0)))
    top[:, :d] -= np.where(begin > 0, 1.0, 0.0)[:, None] * n
    of_offset = np.einsum("rij,rjm->rim", by_place, whole[:, :d]) + np.einsum("rij,rjm->rim", by_seen, whole[:, d:])
    of_offset += n[:, None] * np.where(excess > 0, 1.0, 0.0)[:, None, None] * top[:, None]
    of_offset[low] += n[:, None] * np.where(within > 0, 1.0, 0.0)[:, None, None] * by_rise[:, None]
    whole[:, :d] = np.where(arrives[:, None, None], of_offset, whole[:, :d])
    return Landing(offset, flight.velocity, flight.time, whole, place, arrives)


def _rise(flight: _Flight, opening: Opening) -> tuple[np.ndarray, np.ndarray]:
    """Return by how much things reach within the rim as they rise through the plane, see `overlap`, (R,) [m], and
    derivatives by position and velocity at release and by drag, (R, 2 d + 1), if the flight has its own.
    """
    R, d = flight.place.shape
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        flight.go(_to_rise, opening, np.ones(R, bool))
        place = flight.place - opening.centres - opening.drift * flight.time[:, None]
        within, by_place, by_seen = overlap(place, flight.velocity - opening.drift, opening, flight.down, flight.time)
    if not flight.by:
        return within, np.zeros((R, 2 * d + 1))
    whole = flight.slopes_at_event(opening, np.ones(R))
    return within, np.einsum("ri,rim->rm", np.concatenate([by_place, by_seen], axis=1), whole)


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
    clock = Opening(times[:, None], np.ones(1), np.zeros(1))  # whose "centres" are the times
    flight.go(lambda one, until: until.centres[:, 0] - one.time, clock, np.ones(len(times), bool))
    return flight.place, flight.velocity


def _to_top(flight: _Flight, opening: Opening) -> np.ndarray:
    """Time to the highest point over the plane at the present acceleration, (R,) [s]."""
    speed = (flight.velocity - opening.drift) @ opening.normal
    slows = -(flight.acceleration if flight.drag else flight.down) @ opening.normal
    return np.where(slows > 0, speed / slows, np.inf)


def _to_plane(flight: _Flight, opening: Opening) -> np.ndarray:
    """Time to the plane at the present acceleration, (R,) [s], of things that fall, or have fallen little too far."""
    speed, height = (flight.velocity - opening.drift) @ opening.normal, flight.height(opening)
    pull = (flight.acceleration if flight.drag else flight.down) @ opening.normal
    fall = np.sqrt(np.maximum(speed**2 - 2 * pull * height, 0.0))
    if not flight.drag:
        return (-speed - fall) / pull
    ahead = np.where((height > 0) & (fall <= speed), np.inf, 2 * height / (fall - speed))
    return np.where(height == 0, 0.0, ahead)


def _to_rise(flight: _Flight, opening: Opening) -> np.ndarray:
    """Time to where things rise through the plane at the present acceleration, (R,) [s]; in the past: negative."""
    speed, height = (flight.velocity - opening.drift) @ opening.normal, flight.height(opening)
    pull = (flight.acceleration if flight.drag else flight.down) @ opening.normal
    return -2 * height / (speed + np.sqrt(np.maximum(speed**2 - 2 * pull * height, 0.0)))


class _Flight:
    """R things in flight, and how they change by velocity at release and drag per mass."""

    def __init__(
        self,
        place: np.ndarray,
        velocity: np.ndarray,
        down: np.ndarray,
        drag: float,
        *,
        slopes: bool,
        tolerance: float = EXACT,
    ) -> None:
        R, d = place.shape
        self.place, self.velocity, self.time, self.down, self.drag = place, velocity, np.zeros(R), down, drag
        self.tolerance = tolerance
        self.by: list[np.ndarray] = []  # of place and velocity, (R, d, d + 1) each
        if slopes:
            self.by = [np.zeros((R, d, d + 1)), np.tile(np.eye(d, d + 1), (R, 1, 1))]

    @property
    def acceleration(self) -> np.ndarray:
        return self._falls(self.velocity, np.linalg.norm(self.velocity, axis=1, keepdims=True))

    def height(self, opening: Opening) -> np.ndarray:
        """Height over the opening's plane, (R,) [m]."""
        return (self.place - opening.centres - opening.drift * self.time[:, None]) @ opening.normal

    def go(self, left: Callable[[_Flight, Opening], np.ndarray], opening: Opening, moving: np.ndarray) -> None:
        """Fly on, those things (R,) that move, until no time (R,) [s] is left; without drag that is one step."""
        if not self.drag:
            self.step(np.where(moving, left(self, opening), 0.0))
            return
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            for _ in range(_MOST_STEPS):
                longest = np.where(moving & (self.time < LONGEST), self._longest(), 0.0)
                h = np.clip(left(self, opening), -longest, longest)
                moving = np.abs(h) > _ARRIVED
                if 2 * moving.sum() <= len(h):
                    break
                self.step(np.where(moving, h, 0.0))
            else:
                return
        if not moving.any():
            return
        part = _Flight(self.place[moving], self.velocity[moving], self.down, self.drag, slopes=False)
        part.time, part.by, part.tolerance = self.time[moving], [x[moving] for x in self.by], self.tolerance
        part.go(left, replace(opening, centres=opening.centres[moving]), np.ones(len(part.time), bool))
        for whole, own in zip([self.place, self.velocity, self.time, *self.by],
                              [part.place, part.velocity, part.time, *part.by], strict=True):  # fmt: skip
            whole[moving] = own

    def step(self, h: np.ndarray) -> None:
        """Fly on for some time, (R,) [s], by one step of the classical Runge-Kutta method."""
        now = [self.place, self.velocity, *self.by]
        one = self._rates(now)
        two = self._rates(_ahead(now, one, h / 2))
        three = self._rates(_ahead(now, two, h / 2))
        four = self._rates(_ahead(now, three, h))
        mean = [(a + 2 * (b + c) + e) / 6 for a, b, c, e in zip(one, two, three, four, strict=True)]
        self.place, self.velocity, *self.by = _ahead(now, mean, h)
        self.time = self.time + h

    def _longest(self) -> np.ndarray:
        """Longest step (R,) [s] whose error stays below the tolerance, and that is stable."""
        speed, gravity = np.linalg.norm(self.velocity, axis=1), np.linalg.norm(self.down)
        rate = self.drag * (2 * speed + math.sqrt(gravity / self.drag))  # at which a velocity changes
        pull = np.linalg.norm(self.acceleration, axis=1)
        return np.minimum((120 * self.tolerance * rate**2 / np.maximum(pull, 1e-12)) ** 0.2, 1.0) / rate

    def slopes(self) -> np.ndarray:
        """Derivatives of place and velocity by place and velocity at release and by drag, (R, 2 d, 2 d + 1)."""
        R, d = self.place.shape
        of_place = np.concatenate([np.tile(np.eye(d), (R, 1, 1)), np.zeros((R, d, d))], axis=1)
        return np.concatenate([of_place, np.concatenate(self.by, axis=1)], axis=2)

    def slopes_at_event(self, opening: Opening, event: np.ndarray) -> np.ndarray:
        """Derivatives as of `slopes` where things cross the plane (1), are highest over it (-1), or begin (0), (R,)."""
        n, d, fixed = opening.normal, self.place.shape[1], self.slopes()
        into, turns = (self.velocity - opening.drift) @ n, self.acceleration @ n
        of_height, of_speed = (np.einsum("d,rdm->rm", n, x) for x in (fixed[:, :d], fixed[:, d:]))
        crossed = -of_height / np.where(into == 0, 1, into)[:, None]
        highest = -of_speed / np.where(turns == 0, 1, turns)[:, None]
        later = np.select([event[:, None] > 0, event[:, None] < 0], [crossed, highest], 0.0)  # (R, 2 d + 1)
        rates = np.concatenate([self.velocity - opening.drift, self.acceleration], axis=1)
        return fixed + rates[:, :, None] * later[:, None, :]

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
