"""What every part of the reproduction is given."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from whiptool.comparison import Comparison, Series, Store, collect
from whiptool.comparison.units import Unit


@dataclass(frozen=True)
class Context:
    """A run of the reproduction.

    Args:
        comparison: Methods, observations, seeds, targets, training.
        store: Results of its units: what one part of the report worked out, the others find there.
        quick: Take the short form of whatever takes long.
        whips: Unknown whips of each family, in `adapt`.
    """

    comparison: Comparison
    store: Store
    quick: bool = False
    whips: int = 100

    def results(self, units: Sequence[Unit], desc: str) -> dict[str, dict[str, Any]]:
        """Results of units by name, worked on if they are not there yet."""
        return self.store.results(units, desc=desc)

    def series(self, desc: str) -> list[Series]:
        """Of the whole comparison."""
        units = self.comparison.units()
        return collect(units, self.results(units, desc))
