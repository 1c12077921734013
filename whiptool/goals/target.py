"""Targets: a point to hit, in the strike plane or in space, and on request a direction and a speed of arrival."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, overload

import numpy as np

from whiptool.errors import InputError, expect
from whiptool.goals.goals import CONE, Goals, arrival_directions
from whiptool.models.mount import default_floor
from whiptool.models.numbers import ASK_UNIT, LONGEST, Vector, array_of, made_of_numbers, metres, number, numbers
from whiptool.models.parameters import Model

if TYPE_CHECKING:
    from whiptool.models.trajectory import Approach

HIT_RADIUS = 0.06  # [m], Eq. 17
LARGEST_RADIUS = 10.0  # [m] of a target to hit; what is larger was given in millimetres
TARGET = (1.3, 0.0)  # [m], centre of the target zone; not printed in the paper

_COORDINATES = {2: "two coordinates x y", 3: "three coordinates x y z"}


@made_of_numbers(lambda place: (place,))
@dataclass(frozen=True)
class Target(Vector):
    """A point to hit, with the direction and the speed of the tip if they are required. `np.asarray(target)` is its
    position.

    `Target(1.25, 0.2)` is the same as `Target((1.25, 0.2))`; other arguments are then given by name: `Target(1.25, 0.2,
    hit_radius=0.03)`.

    Args:
        position: (x, y) in the plane, (x, y, z) in space [m].
        hit_radius: Largest distance of the tip at a hit [m].
        direction: Required direction of the tip's velocity at the closest approach, a vector of any length, (2,) or
            (3,), which is stored as a unit vector. None: any direction.
        cone: Largest angle between that direction and the tip's velocity [rad].
        speed: Least speed at the closest approach [m/s], along the direction if there is one; None: any speed.
        sight: Line of sight, perpendicular to the direction; velocity along it is ignored in the angle, see `arriving`.

    Raises:
        InputError: A value is not finite, a radius, cone or speed is not positive, the direction is zero or of another
            dimension.
    """

    position: tuple[float, ...] = TARGET
    hit_radius: float = HIT_RADIUS
    direction: tuple[float, ...] | None = None
    cone: float = CONE
    speed: float | None = None
    sight: tuple[float, ...] | None = None

    if TYPE_CHECKING:

        @overload
        def __init__(
            self,
            position: Sequence[float] = TARGET,
            hit_radius: float = HIT_RADIUS,
            direction: Sequence[float] | None = None,
            cone: float = CONE,
            speed: float | None = None,
            sight: Sequence[float] | None = None,
        ) -> None: ...
        @overload
        def __init__(
            self,
            *position: float,
            hit_radius: float = HIT_RADIUS,
            direction: Sequence[float] | None = None,
            cone: float = CONE,
            speed: float | None = None,
            sight: Sequence[float] | None = None,
        ) -> None: ...

    def __post_init__(self) -> None:
        rule = "two finite coordinates x y in m, or three in space"
        place = array_of("target", self.position, rule)
        if place.shape not in ((2,), (3,)):
            raise InputError("target", self.position, rule)
        position = tuple(place.tolist())
        if (np.abs(place) > LONGEST).any():
            raise InputError("target", position, f"coordinates within {LONGEST:g} m", ASK_UNIT)
        object.__setattr__(self, "position", position)
        object.__setattr__(self, "hit_radius", checked_radius(self.hit_radius))
        object.__setattr__(self, "cone", number("cone", self.cone, low=0, high=math.pi, strict=True))
        if self.speed is not None:
            object.__setattr__(self, "speed", number("least speed", self.speed, low=0, strict=True))
        if self.direction is not None:
            object.__setattr__(self, "direction", _unit("direction", self.direction, len(position)))
        if self.sight is not None:
            if self.direction is None:
                raise InputError("line of sight", self.sight, "None unless a direction of arrival is given")
            object.__setattr__(self, "sight", _unit("line of sight", self.sight, len(position)))
            if abs(np.dot(self.sight, self.direction)) > 1e-9:
                raise InputError("line of sight", self.sight, "a vector at right angles to the direction of arrival")

    def __repr__(self) -> str:
        said = f"({', '.join(f'{x:g}' for x in self.position)}) m, hit radius {self.hit_radius:g} m"
        if self.direction is not None:
            towards = ", ".join(f"{x:.3f}" for x in self.direction)
            said += f", within {math.degrees(self.cone):g} degrees of ({towards})"
            said += "" if self.sight is None else " seen along the line of sight"
        return f"Target({said}{'' if self.speed is None else f', at {self.speed:g} m/s or more'})"

    @classmethod
    def arriving(
        cls,
        position: Sequence[float],
        angle: float,
        *,
        hit_radius: float = HIT_RADIUS,
        cone: float = CONE,
        speed: float | None = None,
    ) -> Target:
        """Return a target at which the tip arrives at an angle.

        In space the angle is that of the velocity as seen from the base: 0 is upward and 90 degrees to the left, and
        motion along the line of sight is ignored; see `arrival_directions`. In the plane it is measured from forward
        (0) to upward (90 degrees), and the whole velocity counts.

        Args:
            position: Position of the target, (2,) or (3,) [m].
            angle: Arrival angle [rad].
            hit_radius, cone, speed: As in `Target`.

        Raises:
            InputError: A value is out of range, or a target in space lies directly above or below the base.
        """
        place = as_target(position).position
        if abs(number("arrival angle", angle)) > 2 * math.pi:
            raise InputError(
                "arrival angle", angle, "an angle of one turn at most", "it is in radians; are these degrees?"
            )
        directions, sights = arrival_directions(np.array([place]), np.array([angle]))
        sight = None if sights is None else tuple(map(float, sights[0]))
        return cls(place, hit_radius, tuple(map(float, directions[0])), cone, speed, sight)

    @classmethod
    def of(cls, goals: Goals, i: int) -> Target:
        """Return goal number i of several goals as a target."""
        rows = (goals.positions, goals.directions, goals.sights)
        place, direction, sight = (None if x is None else tuple(map(float, x[i])) for x in rows)
        assert place is not None
        return cls(place, goals.hit_radius, direction, goals.cone, goals.speed, sight)

    @property
    def vector(self) -> np.ndarray:
        """Position of the target [m], (2,) or (3,)."""
        return np.array(self.position)

    @property
    def goals(self) -> Goals:
        """The target as `Goals` with B = 1."""
        rows = [None if x is None else np.array([x]) for x in (self.position, self.direction, self.sight)]
        assert rows[0] is not None
        return Goals(rows[0], self.hit_radius, rows[1], self.cone, self.speed, rows[2])

    @property
    def outline(self) -> np.ndarray | None:
        """Points (K, d) [m] of a line that shows the target in figures besides its hit radius; None: no line."""
        return None

    def hit_time(self, near: Approach) -> float | None:
        """Return the time [s] of the closest approach of one strike (B = 1) if it is a hit, see `Goals.hit`; else
        None."""
        return float(near.time[0]) if self.goals.hit_by(near)[0] else None

    def missed_by(self, distance: float, velocity: Sequence[float] | np.ndarray) -> dict[str, float]:
        """Return the errors of a strike that misses: `point` [m], `direction` [rad], `speed` [m/s].

        Requirements that are met are left out.

        Args:
            distance: Distance of the tip at the closest approach [m].
            velocity: Velocity of the tip at the closest approach [m/s], (2,) or (3,).
        """
        excess = self.goals.excess(np.array([distance]), np.array([velocity]))
        return {name: float(by[0]) for name, by in excess.items() if by[0] > 0}

    def check_fits(self, model: Model) -> None:
        """Refuse a target with too many or too few coordinates for a model, or with a hit radius that covers all its
        reach.

        Raises:
            InputError: The target does not fit.
        """
        expect(Model, model=model)
        if len(self.position) != model.dimension:
            where = "in space" if model.dimension == 3 else "in the plane"
            rule = f"{_COORDINATES[model.dimension]} in m, for the model {model.name}, which is {where}"
            such = "such as " + " ".join(f"{x:g}" for x in usual_target(model).position)
            too_many = len(self.position) > model.dimension
            raise InputError("target", self.position, rule, such + too_many * "; a hit radius is given by its name")
        check_radius("hit radius", self.hit_radius, self.position, model)

    def check_reach(self, model: Model) -> None:
        """Refuse a target that the stretched arm and whip cannot come near, or cannot miss.

        Raises:
            InputError: The target is farther from the shoulder than reach plus hit radius, or does not fit, see
                `check_fits`.
        """
        self.check_fits(model)
        distance = math.hypot(*self.position)
        if distance > model.reach + self.hit_radius:
            raise InputError(
                "target",
                self.position,
                f"within the model's reach of {model.reach:.3f} m of the {base_name(model.dimension)}",
                f"it is {distance:.4g} m away",
            )
        self._check_direction(model, distance)

    def _check_direction(self, model: Model, distance: float) -> None:
        """Refuse a direction in which no tip moves: where arm and whip are stretched, it cannot move outward."""
        if self.direction is None or distance < model.reach:
            return
        outward = abs(float(np.dot(self.direction, self.position))) / distance
        if self.sight is None and outward > math.sin(min(self.cone, math.pi / 2)):
            cone, given = math.degrees(self.cone), tuple(round(x, 4) for x in self.direction)
            rule = f"at right angles to the line from the base, within the cone of {cone:g} degrees"
            why = f"the target is {distance:.4g} m away, where arm and whip are stretched to their reach"
            raise InputError("direction", given, rule, why)


def checked_radius(radius: float) -> float:
    """Return a hit radius [m] after checking it.

    Raises:
        InputError: The radius is not positive, or implausibly large, such as a value in millimetres.
    """
    return metres("hit radius", radius, longest=LARGEST_RADIUS)


def check_radius(name: str, radius: float, place: Sequence[float], model: Model) -> None:
    """Refuse a radius [m] around a position (2,) or (3,) that contains all points that a model can reach.

    Raises:
        InputError: The radius is too large; the error calls it `name`.
    """
    farthest = model.farthest_miss(place)
    if radius >= farthest:
        rule = f"less than {farthest:.3f} m, the farthest that the tip of {model.name} can be from there"
        raise InputError(name, radius, rule, ASK_UNIT)


def missed_words(missed: Mapping[str, float]) -> str:
    """Return the result of `Target.missed_by` as text, such as `the direction by 12.3 degrees`.

    If a strike meets all requirements and yet does not count as a hit, the text says that its uncertainty is too large.
    """
    if not missed:
        return "by less than the uncertainty"
    units = {"point": (1e3, "mm"), "direction": (math.degrees(1), "degrees"), "speed": (1.0, "m/s")}
    said = (f"the {name} by {by * units[name][0]:.3g} {units[name][1]}" for name, by in missed.items())
    return ", ".join(said)


def base_name(dimension: int) -> str:
    """Return the name of the origin, where the arm stands: the shoulder in the plane, in space the base."""
    return "shoulder" if dimension == 2 else "base"


def _unit(name: str, vector: Sequence[float], dimension: int) -> tuple[float, ...]:
    """Return a vector as a unit vector of so many coordinates."""
    values = numbers(name, vector, dimension)
    length = math.hypot(*values)
    if length == 0:
        raise InputError(name, values, "a vector that is not zero")
    return tuple(x / length for x in values)


_ABOVE_FLOOR = (0.405, 0.1, 0.17)  # of the reach, as below: ahead, aside and above, clear of the floor
_AHEAD = (0.55, 0.0, 0.0)  # of an arm that stands on no floor, such as a person's; 1.3 m ahead of nah2023


def usual_target(model: Model) -> Target:
    """Return the default target of a model: in the plane that of the paper, in space a target that arms hit easily.

    In space its coordinates are fractions of the model's reach, rounded to two digits: in front of the base, and for a
    robot on a floor also to the side and above it.
    """
    if model.dimension == 2:
        return Target(TARGET)
    shares = _AHEAD if default_floor(model.arm) is None else _ABOVE_FLOOR
    digits = 1 - math.floor(math.log10(model.reach / 2))
    return Target(tuple(round(share * model.reach, digits) for share in shares))


def as_target(target: Target | Sequence[float] | np.ndarray) -> Target:
    """Return a target unchanged, or a position (x, y) or (x, y, z) [m] as a target with the default hit radius.

    Raises:
        InputError: The argument is neither a target nor a position.
    """
    place: Any = target  # a sequence of any kind, which a `Target` keeps as a tuple
    return target if isinstance(target, Target) else Target(place)
