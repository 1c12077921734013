"""Intervals of shares and medians over solutions, and which parameter moves a strike most."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import binom, binomtest

LEVEL = 0.95


@dataclass(frozen=True)
class Share:
    """How many of some solutions have a property.

    Args:
        count: Count of those that have it.
        of: All.
    """

    count: int
    of: int

    @property
    def interval(self) -> tuple[float, float]:
        """The 95 % interval of the share among all such solutions (Wilson 1927)."""
        if not self.of:
            return 0.0, 1.0
        found = binomtest(self.count, self.of).proportion_ci(LEVEL, method="wilson")
        return float(found.low), float(found.high)

    @property
    def most(self) -> bool:
        """Whether more than half of all have it, beyond the interval."""
        return self.interval[0] > 0.5

    def __str__(self) -> str:
        low, high = self.interval
        return f"{self.count} of {self.of} ({100 * low:.0f} to {100 * high:.0f} %)"


def median_interval(values: np.ndarray) -> tuple[float, float]:
    """Return the 95 % interval of a median, between two of the values in order; all of them where there are few.

    There has to be at least one.
    """
    ordered = np.sort(values)
    # fewer than k values lie below a median with a probability of 2.5 % at most: the k-th is then the lower end
    k = int(np.sum(binom.cdf(np.arange(len(ordered) // 2), len(ordered), 0.5) <= (1 - LEVEL) / 2))
    left_out = max(k - 1, 0)
    return float(ordered[left_out]), float(ordered[-1 - left_out])


def median_of(values: np.ndarray, unit: str = "", digits: int = 2) -> str:
    """Return a median with its interval, in words; of no values a dash."""
    if not len(values):
        return "-"
    low, high = median_interval(values)
    return f"{np.median(values):.{digits}g}{unit} ({low:.{digits}g} to {high:.{digits}g})"


def share_nearer(trials: int) -> float:
    """Return the share of trials that come nearer than the nearest of so many, which is not exceeded at 95 %.

    Whatever the distances' distribution is, that share is distributed as the least of so many uniform numbers.
    """
    return float(1 - (1 - LEVEL) ** (1 / trials))
