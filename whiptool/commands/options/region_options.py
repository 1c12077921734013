"""Options of the region of goals of a strike map."""

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
    """NPZ file with the region of targets, in place of --zone-radius. whiptool.goals.zone.Region.save writes such
    files."""
    sector: tuple[float, ...] | None = None
    """Region of targets: NEAR FAR LOW HIGH [m] ANGLE [degrees]. NEAR and FAR are distances from the base, LOW and HIGH
    heights above it, and ANGLE is that from forward to either side."""

    def check(self) -> None:
        """Refuse values that are out of range, and options that contradict each other."""
        from whiptool.goals.arrival_rule import named_sector

        super().check()
        if self.sector is not None:
            if len(self.sector) != 5:
                raise InputError("--sector", self.sector, "five numbers: NEAR FAR LOW HIGH ANGLE")
            named_sector(self.sector)
