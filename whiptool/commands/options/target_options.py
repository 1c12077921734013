"""Options of targets: one target, or the zone or region from which targets are drawn, and the required arrival."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar

from tyro.conf import arg

from whiptool.commands.options.option_group import Condition, Conditions, Interval, OptionGroup, Ranges, unless
from whiptool.errors import InputError
from whiptool.models.strike import T_STAY

if TYPE_CHECKING:
    from whiptool.goals.arrival_rule import ArrivalRule
    from whiptool.goals.target import Target
    from whiptool.goals.zone import Zone
    from whiptool.models.parameters import Model

LONGEST_STAY = 60.0  # [s]


@dataclass(frozen=True, kw_only=True)
class TargetOptions(OptionGroup):
    """Options for the target, and for the time during which the tip is observed."""

    heading: ClassVar[str] = "target"
    first: ClassVar[tuple[str, ...]] = (
        "target",
        "hit_radius",
    )

    ranges: ClassVar[Ranges] = {"t_stay": Interval(0, LONGEST_STAY)}

    target: tuple[float, ...] | None = None
    """Target position [m]: x y, in space x y z (default: 1.3 0, in space 0.405 of the model's reach ahead, 0.1 to the
    left, 0.17 up). The origin is the shoulder, x is forward and y is up; in space the origin is the base, y is to the
    left and z is up. For ur5e and panda the default is 1.2 0.3 0.5; for an arm without a floor, such as nah2023, it is
    0.55 of the reach straight ahead."""
    hit_radius: float = 0.06
    """Largest distance between tip and target at a hit [m]."""
    t_stay: float = T_STAY
    """Time after the movement in which the tip can still hit [s]."""

    def check(self) -> None:
        super().check()
        self.build_target()

    def build_target(self, model: Model | None = None) -> Target:
        """Return the target; default: the usual target of the model, or without a model the one in the plane."""
        from whiptool.goals.target import TARGET, Target, usual_target

        if self.target is not None:
            return Target(self.target, self.hit_radius)
        return Target(TARGET if model is None else usual_target(model).position, self.hit_radius)


_CONE = Interval(0, 180, strict=True)
DIRECTED = {
    "cone": Condition(
        "only with --direction or --arrival-angle",
        lambda o: o.direction is not None or o.arrival_angle is not None,
    ),
    "arrival_angle": unless("direction"),
}


@dataclass(frozen=True, kw_only=True)
class GoalOptions(TargetOptions):
    """Options for the target and the required arrival of the tip."""

    first: ClassVar[tuple[str, ...]] = ("direction",)
    only_with: ClassVar[Conditions] = DIRECTED
    ranges: ClassVar[Ranges] = {"cone": _CONE, "arrival_angle": Interval(-360, 360)}

    direction: tuple[float, ...] | None = None
    """Direction of the tip's velocity at a hit, x y or x y z (default: any). The vector can have any length."""
    arrival_angle: float | None = None
    """Angle of the tip's velocity at a hit [degrees]. In the plane 0 is forward and 90 is upward. In space, seen from
    the base, 0 is upward and 90 is to the left; motion along the line of sight is ignored. Default: any angle."""
    cone: float = 10.0
    """Largest angle at a hit between the tip's velocity and the required direction [degrees]."""
    least_speed: float | None = None
    """Least speed of the tip at a hit [m/s], along the required direction if there is one. Default: any speed."""

    def build_target(self, model: Model | None = None) -> Target:
        """Return the target with the required arrival of the tip.

        Raises:
            InputError: The direction is zero or has a wrong dimension, or the arrival angle is not defined at the
                target.
        """
        from whiptool.goals.target import Target

        point, cone = super().build_target(model), math.radians(self.cone)
        if model is None and self.target is None:
            return point  # before the model is known, so is not how many coordinates there are
        if self.arrival_angle is not None:
            angle = math.radians(self.arrival_angle)
            return Target.arriving(
                point.position, angle, hit_radius=point.hit_radius, cone=cone, speed=self.least_speed
            )
        return replace(point, direction=self.direction, cone=cone, speed=self.least_speed)


@dataclass(frozen=True, kw_only=True)
class ZoneOptions(TargetOptions):
    """Options for the zone from which targets are drawn; --target is its centre."""

    of_disc: ClassVar[tuple[str, ...]] = ("target", "zone_radius")
    first: ClassVar[tuple[str, ...]] = ("zone_radius",)
    ranges: ClassVar[Ranges] = {"zone_radius": Interval(0, strict=True)}

    zone_radius: float = 0.1
    """Radius of the zone of targets around --target [m]. The zone is a disc, in space a ball; targets out of reach are
    left out."""

    def build_arrival(self) -> ArrivalRule:
        """Return the required arrival of the tip; any, if the command has no options for it.

        Raises:
            InputError: The direction is zero, or the speed is not positive.
        """
        from whiptool.goals.arrival_rule import named_rule

        return named_rule(vars(self))

    def build_zone(self, model: Model) -> Zone:
        """Return the zone from which targets are drawn.

        Raises:
            InputError: The zone has another dimension than the model or is out of its reach, or its file cannot be
                read; or no tip moves along the direction at the target.
        """
        from whiptool.goals.arrival_rule import named_zone

        return named_zone(vars(self), model)


@dataclass(frozen=True, kw_only=True)
class ZoneGoalOptions(ZoneOptions):
    """Options for the zone of targets and the required arrival of the tip."""

    only_with: ClassVar[Conditions] = DIRECTED
    ranges: ClassVar[Ranges] = {"cone": _CONE}

    direction: tuple[float, ...] | None = None
    """Direction of the tip's velocity at every target: x y, in space x y z. The vector can have any length. Default:
    any direction."""
    arrival_angle: Annotated[tuple[float, ...] | None, arg(metavar="ANGLE|FROM TO")] = None
    """Angle of the tip's velocity at every target [degrees]. In the plane 0 is forward and 90 is upward. In space, seen
    from the base, 0 is upward and 90 is to the left. If two angles are given, that of each target is drawn uniformly
    between them; -180 180 is the full turn. Default: any angle."""
    cone: float = 10.0
    """Largest angle at a hit between the tip's velocity and the required direction [degrees]."""
    least_speed: float | None = None
    """Least speed of the tip at a hit [m/s], along the required direction if there is one. Default: any speed."""

    def check(self) -> None:
        super().check()
        if self.arrival_angle is not None:
            self._check_angles(self.arrival_angle)
        self.build_arrival()

    def _check_angles(self, angles: tuple[float, ...]) -> None:
        """Refuse what is neither an angle nor a range of them.

        Raises:
            InputError: It is neither.
        """
        ordered = len(angles) == 1 or (len(angles) == 2 and angles[0] < angles[1] <= angles[0] + 360)
        if not (ordered and all(map(math.isfinite, angles))):
            allowed = "an angle, or FROM TO with FROM < TO, at most one turn apart"
            raise InputError("--arrival-angle", angles, allowed)


@dataclass(frozen=True, kw_only=True)
class RegionOptions(ZoneGoalOptions):
    """Options for the region of goals: a disc or ball around --target, a sector, or a region from a file."""

    first: ClassVar[tuple[str, ...]] = ("region", "sector")
    only_with: ClassVar[Conditions] = {
        "sector": (unless("region"),),
        **dict.fromkeys(ZoneOptions.of_disc, (unless("region"), unless("sector"))),
    }

    region: Path | None = None
    """NPZ file with the cells of a region of targets: arrays corners (cells, 2 or 3) and cell, their width [m]. It
    takes the place of --zone-radius; whiptool.goals.zone.Region.save writes such files."""
    sector: Annotated[tuple[float, ...] | None, arg(metavar="NEAR FAR LOW HIGH ANGLE")] = None
    """Region of targets from NEAR to FAR from the base and from LOW to HIGH above it [m], up to ANGLE from forward to
    either side [degrees]."""

    def check(self) -> None:
        from whiptool.goals.arrival_rule import named_sector

        super().check()
        if self.sector is not None:
            if len(self.sector) != 5:
                raise InputError("--sector", self.sector, "five numbers: NEAR FAR LOW HIGH [m] and ANGLE [degrees]")
            named_sector(self.sector)
