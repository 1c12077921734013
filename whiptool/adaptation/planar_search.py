"""Candidates of an arm in the plane: random strikes, improved along derivatives and brought within the motors."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from whiptool.adaptation.plan_search import PlanningEffort, Search
from whiptool.models.trajectory import Approach

MARGINS = (0.1, 0.2, 0.3, 0.4)  # part of the limits that is kept free; more, where all strikes were refused
CHECKED = 3  # strikes that are asked about before more is kept free
# Strikes are brought within limits by random steps that shrink, for derivatives do not see the limits.
_ROUNDS, _CHILDREN, _KEPT = 12, 64, 8  # of steps; strikes that are tried in each; the best of all that are kept
_SHRINK = 0.8  # of the steps from round to round
_NEAR, _LAST_STEPS = 0.015, 3  # [m] of miss on the mean that so many steps along derivatives mend: no more random ones


class PlanarSearch(Search):
    """Search in the plane: the best of random strikes, past strikes and their neighbours are refined along derivatives.

    If limits or a least speed allow only a small part of the box, random steps find that part. If `check` forbids the
    best `CHECKED` strikes, the search is repeated with a larger margin to the limits (`MARGINS`).
    """

    margins, checked, spread = MARGINS, CHECKED, 0.04

    def candidates(
        self, rng: np.random.Generator, past: Sequence[Sequence[float]], effort: PlanningEffort
    ) -> tuple[np.ndarray, int]:
        """See `Search.candidates`."""
        lower, upper = self.striker.bounds.box
        pool = self.striker.admissible(rng.uniform(lower, upper, (effort.pool, len(lower))))
        if len(past):
            known = np.array(past, float)
            around = np.repeat(known, 8, axis=0)
            around = around + 0.05 * (upper - lower) * rng.standard_normal(around.shape)
            pool = np.vstack([self.striker.admissible(np.vstack([known, around])), pool])
        best = pool[np.argsort(self.rank(self.mean(pool)))[: effort.polished]]
        tried = np.vstack([best, self.polish(best, effort.steps)])
        if self.striker.limits or self.goal.speed is not None:  # what is allowed is a thin part of the box
            squeezed = self.squeeze(tried, rng)
            tried = np.vstack([squeezed, self.polish(squeezed, _LAST_STEPS)])
        return tried, len(pool)

    def beyond(self, strikes: np.ndarray) -> np.ndarray:
        """Return the excess of strikes (B, m) over the limits and below the least speed, (B,); see `Search.beyond`."""
        if not self.striker.limits and self.goal.speed is None:
            return np.zeros(len(strikes))
        return self.excess(self.mean(strikes))

    def usage(self, near: Approach) -> float | None:
        """See `Search.usage`."""
        return float(self._violation(near)[0]) + 1 if self.striker.limits else None

    def excess(self, near: Approach) -> np.ndarray:
        """Return the excess of strikes over the limits with margin and below the least speed, (B,); 0: both are
        kept."""
        excess = np.zeros(len(near.distance))
        if self.goal.speed is not None:
            arrival = self.goal.arrival_speed(near.velocity)
            excess = np.clip(np.nan_to_num(1 - arrival / self.goal.speed, nan=1.0), 0.0, 1.0)
        if self.striker.limits:
            excess = excess + np.clip(self._violation(near) + self.margin, 0.0, 10.0)
        return excess

    def _violation(self, near: Approach) -> np.ndarray:
        return np.max([limits.violation_of_peaks(near) for limits in self.striker.limits.members], axis=0)

    def rank(self, near: Approach) -> np.ndarray:
        """Return miss distances (B,), with 10 or more added to strikes that break the motors' limits or are too
        slow."""
        excess = self.excess(near)
        distance = np.where(near.known, near.distance, 1e3)
        return distance + np.where(excess > 0, 10 + excess, 0)

    def polish(self, strikes: np.ndarray, steps: int) -> np.ndarray:
        """Return strikes (B, m) after Gauss-Newton steps that reduce the miss with the belief's mean; the best of each
        path.
        """
        width, x, best, value = self.striker.widths, strikes.copy(), strikes.copy(), np.full(len(strikes), np.inf)
        for step in range(steps + 1):
            near, slope = self.rollout.gradient(x, self.goal.positions[0], t_stay=self.striker.t_stay)
            rank = self.rank(near)
            better = rank < value
            best[better], value[better] = x[better], rank[better]
            if step == steps:
                break
            g = slope * width  # by the numbers in units of their range
            move = -near.distance[:, None] * g / np.maximum((g**2).sum(axis=1, keepdims=True), 1e-6)
            length = np.linalg.norm(move, axis=1, keepdims=True)
            move = np.nan_to_num(move * np.minimum(1.0, 0.1 / np.maximum(length, 1e-9)))
            x = self.striker.admissible(x + move * width)
        return best

    def squeeze(self, strikes: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """Return strikes that rank better with the belief's mean, found by shrinking random steps; limits have no
        derivatives.
        """
        kept, rank, spread = strikes, self.rank(self.mean(strikes)), 0.1
        for _ in range(_ROUNDS):
            if np.sort(rank)[: _KEPT // 2].max() <= _NEAR:
                break
            parents = kept[rng.integers(len(kept), size=_CHILDREN)]
            children = parents + spread * self.striker.widths * rng.standard_normal(parents.shape)
            children = self.striker.admissible(children)
            kept, rank = np.vstack([kept, children]), np.r_[rank, self.rank(self.mean(children))]
            order = np.argsort(rank)[:_KEPT]
            kept, rank, spread = kept[order], rank[order], spread * _SHRINK
        return kept[np.argsort(rank)[:_KEPT]]
