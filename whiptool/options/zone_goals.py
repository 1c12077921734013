"""Options of the required arrival of the tip at every target of a zone."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Annotated

from tyro.conf import arg

from whiptool.errors import InputError
from whiptool.options.base import refuse_idle
from whiptool.options.scene import ZoneOptions

if TYPE_CHECKING:
    from whiptool.goals.arrival_rule import ArrivalRule
    from whiptool.goals.zone import Disc, ReachableDisc
    from whiptool.models.parameters import Model


@dataclass(frozen=True, kw_only=True)
class ZoneGoalOptions(ZoneOptions):
    """Where targets are drawn, and how the tip has to arrive there."""

    direction: tuple[float, ...] | None = None
    """Direction in which the tip has to arrive at every target: a vector x y, in space x y z, of any length. Default:
    any direction."""
    arrival_angle: Annotated[tuple[float, ...] | None, arg(metavar="ANGLE|FROM TO")] = None
    """Angle at which the tip has to arrive at every target [degrees]. In the plane it turns from forward to upward. In
    space, seen from the base, 0 is upward and 90 is to the left. With two angles each target has its own, drawn
    uniformly between them; -180 180 is the full turn."""
    cone: float = 10.0
    """Largest angle between the tip's velocity and the required direction [degrees]."""
    least_speed: float | None = None
    """Least speed of the tip at the target [m/s], along the required direction if there is one."""

    def check(self) -> None:
        """Refuse values that are out of range, and options that contradict each other."""
        from whiptool.models.parameters import number

        super().check()
        number("--cone", self.cone, low=0, high=180, strict=True)
        if self.direction is not None and self.arrival_angle is not None:
            raise InputError("--arrival-angle", self.arrival_angle, "--direction or --arrival-angle, not both")
        if self.direction is None and self.arrival_angle is None:
            refuse_idle(self, {"cone": "only with --direction or --arrival-angle"})
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
            allowed = "an angle, or from which to which it is drawn, one turn at most"
            raise InputError("--arrival-angle", angles, allowed)

    def build_arrival(self) -> ArrivalRule:
        """Return the required arrival of the tip.

        Raises:
            InputError: The direction is zero, or the speed is not positive.
        """
        from whiptool.goals.arrival_rule import ArrivalRule

        angle: float | tuple[float, float] | None = None
        if self.arrival_angle is not None:
            first, *last = map(math.radians, self.arrival_angle)
            angle = (first, last[0]) if last else first
        return ArrivalRule(self.direction, angle, math.radians(self.cone), self.least_speed)

    def build_disc(self, model: Model) -> Disc | ReachableDisc:
        """As of any zone.

        Raises:
            InputError: See there; or no tip moves along the direction at the zone's centre, or it is of another space.
        """
        disc, rule = super().build_disc(model), self.build_arrival()
        rule.check_dimension(model)
        if rule.direction is not None:
            replace(self.build_target(model), direction=rule.direction, cone=rule.cone).check_reach(model)
        return disc
