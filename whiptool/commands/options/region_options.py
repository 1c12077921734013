"""Options of the region of goals that a strike map answers."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

from whiptool.commands.options.option_group import Conditions, unless
from whiptool.commands.options.target_options import ZoneOptions
from whiptool.commands.options.zone_goal_options import ZoneGoalOptions
from whiptool.errors import InputError

if TYPE_CHECKING:
    pass


@dataclass(frozen=True, kw_only=True)
class RegionOptions(ZoneGoalOptions):
    """Options for the region of goals: a disc or ball around --target, a sector, or a region from a file."""

    first: ClassVar[tuple[str, ...]] = ("region", "sector")
    only_with: ClassVar[Conditions] = {
        "sector": (unless("region"),),
        **dict.fromkeys(ZoneOptions.of_disc, (unless("region"), unless("sector"))),
    }

    region: Path | None = None
    """Draw the targets from the region in this file instead of a disc (see whiptool.goals.zone.Region)."""
    sector: tuple[float, ...] | None = None
    """Targets from part of a shell: 2 distances, 2 heights, angle. The five numbers are the least and the largest
    distance from the base, the least and the largest height above it [m], and the angle from forward to either side
    [degrees]."""

    def check(self) -> None:
        """Refuse values that are out of range, and options that contradict each other."""
        from whiptool.goals.arrival_rule import named_sector

        super().check()
        if self.sector is not None:
            if len(self.sector) != 5:
                raise InputError("--sector", self.sector, "five numbers: NEAR FAR LOW HIGH DEGREES")
            named_sector(self.sector)
