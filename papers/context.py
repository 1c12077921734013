"""What every part of the reproduction is given."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from whiptool.comparison import Comparison, Series, Store, collect
from whiptool.comparison.units import Unit
from whiptool.goals.zone import Zone


@dataclass(frozen=True)
class Context:
    """A run of the reproduction.

    Args:
        comparison: Methods, observations, seeds, targets, training.
        store: Results of its units: what one part of the report worked out, the others find there.
        quick: Take the short form of whatever takes long.
        whips: Unknown whips of each family, in `adapt`.
        whip_targets: Targets of each of them.
        space: Whether they are ropes on a robot in space.
        rows: Ways to strike them, see `papers.unknown.study.WAYS`.
        further: Methods and observations that Fig. 6 compares in further zones; None: as `comparison`.
        zones: Those zones (`whiptool.comparison.target_scene.zone_named`).
    """

    comparison: Comparison
    store: Store
    quick: bool = False
    whips: int = 30
    whip_targets: int = 3
    space: bool = False
    rows: tuple[str, ...] = ("still", "wiggle")
    further: Comparison | None = None
    zones: tuple[str, ...] = ()

    def results(self, units: Sequence[Unit], desc: str) -> dict[str, dict[str, Any]]:
        """Results of units by key, worked on if they are not there yet."""
        return self.store.results(units, desc=desc)

    def difficulty(self, comparison: Comparison) -> dict[str, Any]:
        """What one strike, and random ones, hit of a comparison's targets."""
        unit = comparison.difficulty(quick=self.quick)
        return self.results([unit], "difficulty")[unit.key]

    def elsewhere(self, zone: Zone) -> Comparison:
        """The further comparison at targets from another zone, at the widest hit radius."""
        base = self.further or self.comparison
        return replace(base, scene=replace(base.scene, zone=zone, radii=base.scene.radii[:1]))

    def series(self, desc: str) -> list[Series]:
        """Of the whole comparison."""
        units = self.comparison.units()
        return collect(units, self.results(units, desc))
