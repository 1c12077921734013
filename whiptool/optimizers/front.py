"""Pareto fronts: the hits of which no other is better by one of two criteria and not worse by the other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from whiptool.criteria import Criterion
from whiptool.objective import Trial


@dataclass(frozen=True, eq=False)
class Front:
    """Hits that no other hit dominates, from the best by the first criterion to the best by the second.

    Args:
        criteria: Two.
        trials: P of them.
    """

    criteria: tuple[Criterion, Criterion]
    trials: tuple[Trial, ...]

    @classmethod
    def of(cls, criteria: tuple[Criterion, Criterion], trials: Sequence[Trial]) -> Front:
        """Return the front of what a search tried; of equal hits it holds the first."""
        hits = [trial for trial in trials if trial.outcome.hit and np.isfinite(trial.outcome.values).all()]
        costs = oriented(criteria, [trial.outcome.values for trial in hits])
        kept: list[Trial] = []
        least = np.inf
        for i in np.lexsort((costs[:, 1], costs[:, 0])):
            if costs[i, 1] < least:
                least = costs[i, 1]
                kept.append(hits[i])
        return cls(criteria, tuple(kept))

    @property
    def values(self) -> np.ndarray:
        """The criteria of each hit in their units, (P, 2)."""
        return np.array([trial.outcome.values for trial in self.trials]).reshape(-1, 2)

    @property
    def strikes(self) -> np.ndarray:
        """The strikes, (P, m)."""
        return np.array([trial.strike for trial in self.trials])

    @property
    def costs(self) -> np.ndarray:
        """The criteria so that less is better, in parts of their range over the front, (P, 2)."""
        costs = oriented(self.criteria, self.values)
        span = np.ptp(costs, axis=0) if len(costs) else np.ones(2)
        return costs / np.where(span > 0, span, 1.0)

    def dominated_by(self, values: np.ndarray) -> np.ndarray:
        """Return by how much each of other hits dominates the front, in parts of its range, (Q,).

        It is the additive epsilon indicator (Zitzler et al. 2003): what the front would have to be moved by, in both
        criteria, to be no worse than that hit; 0 or less: the hit dominates nothing of it.

        Args:
            values: The criteria of other hits, (Q, 2).
        """
        costs = oriented(self.criteria, self.values)
        span = np.where(np.ptp(costs, axis=0) > 0, np.ptp(costs, axis=0), 1.0)
        behind = (costs[None] - oriented(self.criteria, values)[:, None]) / span  # (Q, P, 2)
        return behind.max(axis=2).min(axis=1)


def oriented(criteria: Sequence[Criterion], values: np.ndarray | Sequence[Sequence[float]]) -> np.ndarray:
    """Return values (B, k) of k criteria so that less is better."""
    signs = [-1.0 if criterion.largest else 1.0 for criterion in criteria]
    return np.asarray(values, float).reshape(-1, len(signs)) * signs
