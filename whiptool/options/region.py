"""Options of the region of goals that a strike map answers."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

from whiptool.errors import InputError
from whiptool.options.base import refuse_idle
from whiptool.options.zone_goals import ZoneGoalOptions

if TYPE_CHECKING:
    from whiptool.goals.zone import Zone
    from whiptool.models.parameters import Model


@dataclass(frozen=True, kw_only=True)
class RegionOptions(ZoneGoalOptions):
    """Where goals are drawn; a disc or ball around --target, or one of these."""

    first: ClassVar[tuple[str, ...]] = (
        "region",
        "sector",
    )

    region: Path | None = None
    """Draw the targets from the region in this file instead of a disc (see whiptool.goals.zone.Region)."""
    sector: tuple[float, ...] | None = None
    """Draw the targets in space from part of a shell around the base. The five numbers are the least and the largest
    distance from the base, the least and the largest height above it [m], and the angle from forward to either side
    [degrees]."""

    def check(self) -> None:
        """Refuse values that are out of range, and options that contradict each other."""
        super().check()
        if self.region is not None:
            refuse_idle(self, dict.fromkeys((*self.of_disc, "sector"), "only without --region"))
        if self.sector is not None:
            refuse_idle(self, dict.fromkeys(self.of_disc, "only without --sector"))
            if len(self.sector) != 5:
                raise InputError("--sector", self.sector, "five numbers: NEAR FAR LOW HIGH DEGREES")
            self.build_sector()

    @property
    def names_zone(self) -> bool:
        """Whether any option says where goals are drawn."""
        default = {f.name: f.default for f in fields(self)}
        return any(getattr(self, name) != default[name] for name in (*self.of_disc, "sector", "region"))

    def build_sector(self) -> Zone:
        """Return the sector.

        Raises:
            InputError: A number is out of range.
        """
        from whiptool.goals.zone import Sector

        assert self.sector is not None
        near, far, low, high, aside = self.sector
        return Sector(near, far, low, high, math.radians(aside))

    def build_zone(self, model: Model) -> Zone:
        """Return where targets are drawn.

        Raises:
            InputError: It is of another dimension than the model, lies out of its reach, or its file cannot be read.
        """
        from whiptool.goals.zone import Region, check_fits

        if self.region is None and self.sector is None:
            return self.build_disc(model)
        zone = self.build_sector() if self.region is None else Region.load(self.region)
        check_fits(zone, model, self.hit_radius)
        self.build_arrival().check_dimension(model)
        return zone
