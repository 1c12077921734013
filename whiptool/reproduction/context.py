"""What every part of the reproduction is given."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from whiptool.comparison import Comparison, LearnerUnit, SearchUnit, Series, Store, collect


@dataclass(frozen=True)
class Context:
    """A run of the reproduction.

    Args:
        comparison: Methods, observations, seeds, targets, training.
        store: Results of its units: what one part of the report worked out, the others find there.
        quick: Take the short form of whatever takes long.
    """

    comparison: Comparison
    store: Store
    quick: bool = False

    def results(self, units: Sequence[SearchUnit | LearnerUnit], desc: str) -> dict[str, dict[str, Any]]:
        """Results of units by name, worked on if they are not there yet."""
        return self.store.results(units, desc=desc)

    def series(self, desc: str) -> list[Series]:
        """Of the whole comparison."""
        units = self.comparison.units()
        return collect(units, self.results(units, desc))
