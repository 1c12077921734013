"""What trials strike by strike say: strikes to a hit, with intervals, and how reliable stated probabilities are."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np

from whiptool import Target

_RESAMPLES, _BINS = 2000, 5


@dataclasses.dataclass(frozen=True, eq=False)
class Trials:
    """One method with one family.

    Args:
        miss: Miss distance of every strike [m], (T, strikes); infinite where nothing was seen.
        whip: Which whip, (T,).
    """

    miss: np.ndarray
    whip: np.ndarray

    @classmethod
    def of(cls, by_whip: Sequence[Sequence[dict[str, Any]]]) -> Trials:
        """From the trials of each whip."""
        rows = [(w, trial["miss"]) for w, trials in enumerate(by_whip) for trial in trials]
        miss = [[np.inf if x is None else x for x in row] for _, row in rows]
        return cls(np.array(miss), np.array([w for w, _ in rows]))

    def hits(self, radius: float) -> np.ndarray:
        """Which strikes hit a point to within a radius [m], (T, strikes)."""
        return hits(self.miss, radius)

    def trials(self, radius: float) -> np.ndarray:
        """To the first hit within a radius, the number of strikes where there was none, (T,)."""
        hit = self.hits(radius)
        return np.where(hit.any(axis=1), hit.argmax(axis=1) + 1, self.miss.shape[1])

    def interval(self, values: np.ndarray, statistic=np.mean) -> tuple[float, float]:
        """Of a statistic of values (T,) or (T, k): 95 %, whips resampled with all their trials."""
        rng, whips = np.random.default_rng(0), np.unique(self.whip)
        rows = [np.flatnonzero(self.whip == w) for w in whips]
        found = []
        for _ in range(_RESAMPLES):
            drawn = np.concatenate([rows[i] for i in rng.integers(len(rows), size=len(rows))])
            found.append(statistic(values[drawn]))
        low, high = np.percentile(found, (2.5, 97.5), method="nearest")  # some may be infinite
        return float(low), float(high)


def hits(miss: np.ndarray, radius: float) -> np.ndarray:
    """Which miss distances [m], any shape, hit a point to within a radius [m]."""
    return Target(hit_radius=radius).goals.hit(miss)


def reliability(stated: np.ndarray, observed: np.ndarray) -> tuple[np.ndarray, float]:
    """Mean stated probability, observed share and number of strikes of each occupied bin, (k, 3), and the expected
    calibration error.

    Args:
        stated: Probabilities, (T,).
        observed: Whether it came, (T,).
    """
    which = np.minimum((stated * _BINS).astype(int), _BINS - 1)
    inside = [which == i for i in range(_BINS) if (which == i).any()]
    bins = np.array([[stated[x].mean(), observed[x].mean(), x.sum()] for x in inside])
    return bins, float(np.abs(bins[:, 0] - bins[:, 1]) @ bins[:, 2] / len(stated))
