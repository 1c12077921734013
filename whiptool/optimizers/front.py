"""Pareto fronts: the hits of which no other is better by one of two criteria and not worse by the other."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from whiptool.goals.criteria import Criterion
from whiptool.objective import Trial

RESOLUTION = 1e-3  # part of a criterion's range over the front that counts as nothing


@dataclass(frozen=True, eq=False)
class ParetoFront:
    """Pareto front of hits, from the best by the first criterion to the best by the second.

    Args:
        criteria: The two criteria.
        trials: The P trials on the front.
    """

    criteria: tuple[Criterion, Criterion]
    trials: tuple[Trial, ...]

    @classmethod
    def of(cls, criteria: tuple[Criterion, Criterion], trials: Sequence[Trial]) -> ParetoFront:
        """Return the front of a search's trials; of equal hits it contains the first.

        A hit that improves one criterion by less than `RESOLUTION` times its range is left out.
        """
        hits = [trial for trial in trials if trial.outcome.hit and np.isfinite(trial.outcome.values).all()]
        costs = oriented(criteria, [trial.outcome.values for trial in hits])
        order = np.lexsort((costs[:, 1], costs[:, 0]))
        order = _gaining(order, costs[:, 1], 0.0)
        for column in (1, 0):
            step = RESOLUTION * np.ptp(costs[order, column]) if len(order) else 0.0
            order = _gaining(order, costs[:, column], step)[::-1]
        return cls(criteria, tuple(hits[i] for i in order))

    @property
    def values(self) -> np.ndarray:
        """The criteria of each hit in their units, (P, 2)."""
        return np.array([trial.outcome.values for trial in self.trials]).reshape(-1, 2)

    @property
    def strikes(self) -> np.ndarray:
        """Strike vectors of the front, (P, m)."""
        return np.array([trial.strike for trial in self.trials])

    @property
    def costs(self) -> np.ndarray:
        """The criteria, with signs such that less is better, divided by their range over the front, (P, 2)."""
        costs = oriented(self.criteria, self.values)
        span = np.ptp(costs, axis=0) if len(costs) else np.ones(2)
        return costs / np.where(span > 0, span, 1.0)

    def table(self, names: Sequence[str]) -> dict[str, Any]:
        """Return the front as plain data for JSON.

        Args:
            names: Names of a strike's coordinates, (m,).
        """
        criteria = [{"name": x.name, "unit": x.unit, "maximised": x.largest} for x in self.criteria]
        hits = [
            {
                "trial": trial.number,
                **dict(zip((x.name for x in self.criteria), trial.outcome.values, strict=True)),
                "miss_distance": trial.outcome.miss_distance,
                "tip_speed": trial.outcome.tip_speed,
                "strike": dict(zip(names, trial.strike, strict=True)),
            }
            for trial in self.trials
        ]
        return {"criteria": criteria, "front": hits}

    def csv(self, names: Sequence[str]) -> str:
        """Return the front as CSV: number of the trial, both criteria, and the strike.

        Args:
            names: Names of a strike's coordinates, (m,).
        """
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(["trial", *(x.name for x in self.criteria), *names])
        for trial in self.trials:
            writer.writerow([trial.number, *map(repr, trial.outcome.values), *map(repr, trial.strike)])
        return text.getvalue()


def dominated_by(criteria: Sequence[Criterion], front: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return by how much each of Q other hits dominates a front, relative to the front's range, (Q,).

    This is the additive epsilon indicator (Zitzler et al. 2003): the shift of the front in both criteria that would
    make it at least as good as that hit. If it is at most 0, the hit dominates no point of the front.

    Args:
        criteria: The two criteria.
        front: Values of the hits on the front, (P, 2).
        values: Values of the other hits, (Q, 2).
    """
    costs = oriented(criteria, front)
    span = np.where(np.ptp(costs, axis=0) > 0, np.ptp(costs, axis=0), 1.0)
    behind = (costs[None] - oriented(criteria, values)[:, None]) / span  # (Q, P, 2)
    return behind.max(axis=2).min(axis=1)


def _gaining(order: Sequence[int] | np.ndarray, costs: np.ndarray, step: float) -> list[int]:
    """Return those of some hits, in their order, that cost less than all before them, by more than a step."""
    kept: list[int] = []
    for i in order:
        if not kept or costs[i] < costs[kept[-1]] - step:
            kept.append(int(i))
    return kept


def oriented(criteria: Sequence[Criterion], values: np.ndarray | Sequence[Sequence[float]]) -> np.ndarray:
    """Return the values (B, k) of k criteria with signs such that less is better."""
    signs = [-1.0 if criterion.largest else 1.0 for criterion in criteria]
    return np.asarray(values, float).reshape(-1, len(signs)) * signs
