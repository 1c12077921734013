"""Required arrival of the tip at the targets of a zone: direction, range of angles, and speed."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from whiptool.errors import NOTHING, InputError
from whiptool.goals.goals import CONE, Goals, arrival_angles, arrival_directions
from whiptool.goals.target import HIT_RADIUS, Target, checked_radius, usual_target
from whiptool.goals.zone import RADIUS, Disc, Region, Sector, Zone, check_fits, disc_within_reach, sample, usual_disc
from whiptool.models.mount import default_floor, turns_as_a_whole
from whiptool.models.numbers import number, numbers
from whiptool.models.parameters import Model

_MADE = "for which the policy or map was made"
_SAME = 1e-6  # largest difference of directions that are the same


@dataclass(frozen=True)
class ArrivalRule:
    """Required arrival of the tip at every target of a zone; `ArrivalRule()` allows any arrival.

    Args:
        direction: Direction for all targets, a vector of any length, (2,) or (3,); it is stored as a unit vector.
        angle: Arrival angle for all targets [rad], see `arrival_directions`; or a range (from, to) from which an angle
            is drawn uniformly for each target; (-pi, pi) is all angles.
        cone: Largest angle between the direction and the tip's velocity at the closest approach [rad].
        speed: Least speed at the closest approach [m/s], along the direction if there is one; None: any.

    Raises:
        InputError: A value is out of range, the direction is zero, or both a direction and an angle are asked for.
    """

    direction: tuple[float, ...] | None = None
    angle: float | tuple[float, float] | None = None
    cone: float = CONE
    speed: float | None = None

    def __post_init__(self) -> None:
        if self.direction is not None and self.angle is not None:
            raise InputError("arrival angle", self.angle, "a direction or an arrival angle, not both")
        if self.direction is not None and len(self.direction) not in (2, 3):
            raise InputError("direction", tuple(self.direction), "two coordinates x y, or three in space")
        if isinstance(self.angle, (tuple, list)):
            low, high = (float(x) for x in numbers("arrival angle", self.angle, 2))
            if not low < high <= low + 2 * math.pi + _SAME:
                raise InputError(
                    "arrival angle", self.angle, "a range (from, to) [rad] with from < to, at most one turn wide"
                )
            object.__setattr__(self, "angle", (low, high))
        elif self.angle is not None:
            object.__setattr__(self, "angle", number("arrival angle", self.angle))
        origin = (0.0,) * (2 if self.direction is None else len(self.direction))
        checked = Target(origin, direction=self.direction, cone=self.cone, speed=self.speed)
        for name in ("direction", "cone", "speed"):
            object.__setattr__(self, name, getattr(checked, name))

    @property
    def directed(self) -> bool:
        """Whether the rule requires a direction at every target."""
        return self.direction is not None or self.angle is not None

    @property
    def only_points(self) -> bool:
        """Whether the rule requires neither a direction nor a speed."""
        return not self.directed and self.speed is None

    @property
    def drawn(self) -> int:
        """Number of uniform random numbers from which a target's direction is drawn: 1 for a range of angles, else
        0."""
        return int(self.range is not None)

    @property
    def range(self) -> tuple[float, float] | None:
        """Range from which arrival angles are drawn [rad]; None: they are not drawn."""
        return self.angle if isinstance(self.angle, tuple) else None

    def within(self, angles: np.ndarray) -> np.ndarray:
        """Return, for angles of any shape [rad], the nearest angles within `range`."""
        assert self.range is not None
        low, high = self.range
        middle = (low + high) / 2
        from_middle = np.remainder(angles - middle + np.pi, 2 * np.pi) - np.pi
        return middle + np.clip(from_middle, low - middle, high - middle)

    def check_dimension(self, model: Model) -> None:
        """Refuse a direction in the plane for a model in space, and the reverse.

        Raises:
            InputError: The direction has too many coordinates, or too few.
        """
        if self.direction is not None and len(self.direction) != model.dimension:
            raise InputError("direction", self.direction, f"{model.dimension} coordinates, as the model has")

    def goals(self, positions: np.ndarray, hit_radius: float, uniform: np.ndarray) -> Goals:
        """Return the goals at positions (B, d) [m]; their directions follow from uniform random numbers (B, `drawn`) in
        [0, 1).
        """
        angles = None
        if self.range is not None:
            low, high = self.range
            angles = high - uniform[:, 0] * (high - low)
        return self.goals_at(positions, hit_radius, angles)

    def goals_at(self, positions: np.ndarray, hit_radius: float, angles: np.ndarray | None = None) -> Goals:
        """Return the goals at B target positions.

        Args:
            positions: Positions of the targets, (B, d) [m].
            hit_radius: Hit radius [m].
            angles: Arrival angles [rad], (B,), if the rule has a range of them.

        Raises:
            InputError: Angles are missing or not needed, or a target in space lies directly above or below the base.
        """
        if (angles is not None) != bool(self.drawn):
            allowed = "one for each target" if self.drawn else "None, because the rule draws no angles"
            raise InputError("arrival angles", NOTHING if angles is None else angles.tolist(), allowed)
        if isinstance(self.angle, float):
            angles = np.full(len(positions), self.angle)
        directions, sights = None, None
        if self.direction is not None:
            directions = np.tile(self.direction, (len(positions), 1))
        elif angles is not None:
            directions, sights = arrival_directions(positions, angles)
        return Goals(positions, hit_radius, directions, self.cone, self.speed, sights)

    def goal_of(self, target: Target) -> Goals:
        """Return the goal of a target if the rule covers it; a rule with one direction also covers targets without
        direction.

        Raises:
            InputError: The target asks for a direction that the rule does not have, or for more speed, or gives no
                direction although the rule has a range of them.
        """
        asked = target.goals
        self._check_speed(target)
        if asked.directions is None and self.drawn:
            allowed = f"one {_MADE}: Target.arriving(position, angle)"
            raise InputError("direction", NOTHING, allowed)
        angles = None
        if self.drawn and asked.directions is not None:
            angles = self.within(arrival_angles(asked.positions, asked.directions))
        own = self.goals_at(asked.positions, target.hit_radius, angles)
        if asked.directions is not None:
            self._check_direction(target, own)
        return own

    def _check_speed(self, target: Target) -> None:
        """Refuse a target that asks for more speed."""
        if target.speed is not None and target.speed > (self.speed or 0.0):
            allowed = "none, because the policy or map was made without one"
            allowed = allowed if self.speed is None else f"at most {self.speed:g} m/s, {_MADE}"
            raise InputError("least speed", f"{target.speed:g} m/s", allowed)

    def _check_direction(self, target: Target, own: Goals) -> None:
        """Refuse a target whose direction, or the part of the velocity that counts for it, is not the rule's."""
        if own.directions is None:
            raise InputError("direction", target.direction, "none, because the policy or map was made for points alone")
        same = np.abs(own.directions[0] - np.array(target.direction)).max() <= _SAME
        if own.sights is not None:
            same &= target.sight is not None and np.abs(own.sights[0] - np.array(target.sight)).max() <= _SAME
        if not same:
            made = f"({', '.join(f'{x:.6g}' for x in own.directions[0])}), {_MADE}"
            if self.range is not None:
                low, high = map(math.degrees, self.range)
                made = f"Target.arriving(position, angle), at angles from {low:g} to {high:g} degrees, {_MADE}"
            raise InputError("direction", target.direction, made)

    def __str__(self) -> str:
        said, within = [], f"arriving within {math.degrees(self.cone):g} degrees of"
        if self.direction is not None:
            said.append(f"{within} ({', '.join(f'{x:.3f}' for x in self.direction)})")
        elif self.range is not None:
            low, high = map(math.degrees, self.range)
            said.append(f"{within} a random angle for each target, from {low:g} to {high:g} degrees")
        elif isinstance(self.angle, float):
            said.append(f"{within} {math.degrees(self.angle):g} degrees")
        if self.speed is not None:
            said.append(f"at {self.speed:g} m/s or more")
        return ", ".join(said) or "arriving in any way"

    def table(self) -> dict[str, Any] | None:
        """Return the rule as plain data for a result; None if neither direction nor speed is required."""
        if self.only_points:
            return None
        direction, angle = (list(x) if isinstance(x, tuple) else x for x in (self.direction, self.angle))
        cone = self.cone if self.directed else None
        return {"direction": direction, "arrival_angle": angle, "cone": cone, "least_speed": self.speed}


def sample_goals(zone: Zone, rule: ArrivalRule, hit_radius: float, count: int, rng: np.random.Generator) -> Goals:
    """Return `count` random goals: positions uniform over the zone, and directions by the rule."""
    positions = sample(zone, count, rng)
    return rule.goals(positions, hit_radius, rng.random((count, rule.drawn)))


def named_rule(named: Mapping[str, Any]) -> ArrivalRule:
    """Return the rule that options name: `direction`, or `arrival_angle` and `cone` in degrees, and `least_speed`.

    Raises:
        InputError: The direction is zero, or the speed is not positive.
    """
    direction, angles = named.get("direction"), [math.radians(x) for x in named.get("arrival_angle") or ()]
    angle = None if not angles else angles[0] if len(angles) == 1 else (angles[0], angles[1])
    cone = math.radians(named["cone"]) if "cone" in named else CONE
    return ArrivalRule(None if direction is None else tuple(direction), angle, cone, named.get("least_speed"))


def named_zone(named: Mapping[str, Any], model: Model) -> Zone:
    """Return the zone that options name: the file of a `region`, a `sector`, or a disc or ball around `target`.

    Raises:
        InputError: The zone has another dimension than the model or is out of its reach, or its file cannot be read; or
            no tip moves along the direction of `named_rule` at the target.
    """
    rule, hit_radius = named_rule(named), named.get("hit_radius", HIT_RADIUS)
    if named.get("region") is None and named.get("sector") is None:
        return _named_disc(named, model, rule, hit_radius)
    zone = named_sector(named["sector"]) if named.get("region") is None else Region.load(named["region"])
    check_fits(zone, model, hit_radius)
    rule.check_dimension(model)
    return zone


def _named_disc(named: Mapping[str, Any], model: Model, rule: ArrivalRule, hit_radius: float) -> Zone:
    """Return what the model can reach of the disc or ball around `target`."""
    place = named.get("target")
    target = Target(usual_target(model).position if place is None else tuple(place), hit_radius)
    target.check_reach(model)
    disc = disc_within_reach(Disc(target.position, named.get("zone_radius", RADIUS)), model.reach)
    rule.check_dimension(model)
    if rule.direction is not None:
        replace(target, direction=rule.direction, cone=rule.cone).check_reach(model)
    return disc


def named_sector(numbers: Sequence[float]) -> Sector:
    """Return the sector of five numbers: distances and heights [m], and the angle to either side [degrees]."""
    near, far, low, high, aside = numbers
    return Sector(near, far, low, high, math.radians(aside))


_ANY = ArrivalRule()  # points alone
_SHELL = 0.32, 0.8, 0.05, 0.8  # of a robot's reach: from this far to this far from the base, from this low to this high
_BALL = 0.8, 0.35  # of another arm's reach: how far ahead, and how wide
_LEAST_SPEED = 1.0  # [m/s], as in "Point It, Strike It" (2026)


@dataclass(frozen=True, eq=False)
class GoalRegion:
    """A region of goals: a zone of targets, with the required arrival of the tip.

    Args:
        zone: Zone of the targets.
        rule: Required arrival of the tip.
        hit_radius: Hit radius [m].

    Raises:
        InputError: The hit radius is not positive.
    """

    zone: Zone
    rule: ArrivalRule = _ANY
    hit_radius: float = HIT_RADIUS

    def __post_init__(self) -> None:
        checked_radius(self.hit_radius)

    def draw(self, count: int, rng: np.random.Generator) -> Goals:
        """Return `count` random goals, uniform over the region."""
        return sample_goals(self.zone, self.rule, self.hit_radius, count, rng)

    def angles(self, tips: np.ndarray, velocities: np.ndarray) -> np.ndarray | None:
        """Return the arrival angles (K,) [rad] of tips at positions (K, d) [m] with velocities (K, d) [m/s].

        Return None if the rule has no range of angles.
        """
        return arrival_angles(tips, velocities) if self.rule.drawn else None

    def goals_of(self, tips: np.ndarray, velocities: np.ndarray) -> Goals:
        """Return the goals at tip positions (K, d) [m] whose directions are nearest to the tips' velocities (K, d)
        [m/s].
        """
        angles = self.angles(tips, velocities)
        return self.rule.goals_at(tips, self.hit_radius, None if angles is None else self.rule.within(angles))


def as_region(zone: Zone | GoalRegion | None, model: Model) -> GoalRegion:
    """Return a region of goals unchanged, or a zone as a region of points; None: the usual disc, in space a ball."""
    return zone if isinstance(zone, GoalRegion) else GoalRegion(zone or usual_disc(model))


def usual_region(model: Model, hit_radius: float = HIT_RADIUS) -> GoalRegion:
    """Return the default region of goals of a model.

    For a robot on the floor whose first axis is vertical it is a spherical shell around its base, above the floor and
    up to 90 degrees to either side of forward, with any arrival angle and a speed of at least 1 m/s. For other arms it
    is a disc in the plane or a ball in space, within reach.

    Args:
        model: Model of arm and whip.
        hit_radius: Hit radius [m].
    """
    reach = model.reach
    if turns_as_a_whole(model.arm) and default_floor(model.arm) is not None:
        near, far, low, high = (round(share * reach, 2) for share in _SHELL)
        full_turn = ArrivalRule(angle=(-math.pi, math.pi), speed=_LEAST_SPEED)
        return GoalRegion(Sector(near, far, low, high, math.pi / 2), full_turn, hit_radius)
    ahead, radius = (share * reach for share in _BALL)
    return GoalRegion(disc_within_reach(Disc((ahead, 0.0, 0.0)[: model.dimension], radius), reach), _ANY, hit_radius)
