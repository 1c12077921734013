"""Options of the required arrival of the tip at every target of a zone."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, ClassVar

from tyro.conf import arg

from whiptool.commands.options.option_group import Conditions
from whiptool.commands.options.target_options import DIRECTED, ZoneOptions
from whiptool.errors import InputError

if TYPE_CHECKING:
    pass


@dataclass(frozen=True, kw_only=True)
class ZoneGoalOptions(ZoneOptions):
    """Options for the zone of targets and the required arrival of the tip."""

    only_with: ClassVar[Conditions] = DIRECTED

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
        """Refuse values that are out of range, and options that contradict each other."""
        from whiptool.models.numbers import number

        super().check()
        number("--cone", self.cone, low=0, high=180, strict=True)
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
