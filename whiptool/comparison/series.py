"""Trials to the first hit of one way to strike, over seeds and targets, and what can be said of them."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from whiptool.comparison.intervals import mean_interval, needs_fewer
from whiptool.comparison.learner_unit import MAIN_CONVENTION, LearnerUnit
from whiptool.comparison.search_unit import SearchUnit

NAMES = {
    "directl": "DIRECT-L",
    "ga": "GA",
    "cmaes": "CMA-ES",
    "gradient": "gradient",
    "random": "random",
    "sac": "SAC",
    "td3": "TD3",
    "ddpg": "DDPG",
    "ppo": "PPO",
}


@dataclass(frozen=True, eq=False, repr=False)
class Series:
    """S seeds of a method at the same T targets.

    Args:
        method: Its name on the command line.
        observation: Observation of a learner; empty for a search.
        convention: How its policy struck (`whiptool.rl.policy.CONVENTIONS`); empty for a search.
        hit_radius: Hit radius [m].
        trials: To the first hit, the cap where there was none, (S, T).
        hit: Whether there was one, (S, T).
        training_trials: Strikes that each seed was trained with before, a mean.
        n_diverged: Strikes that diverged while searching or training, all seeds.
        wall_time: A seed's search or training, a mean [s].
        notes: Deviations from the plan.
        cap: Most trials at a target.
    """

    method: str
    observation: str
    convention: str
    hit_radius: float
    trials: np.ndarray
    hit: np.ndarray
    training_trials: float
    n_diverged: int
    wall_time: float
    notes: tuple[str, ...] = ()
    cap: float = math.inf

    def __repr__(self) -> str:
        low, high = self.interval
        way = f" ({self.convention})" if self.convention else ""
        needs = f"{self.mean:.1f} trials to a hit, 95 % interval {low:.1f} to {high:.1f}"
        return f"Series({self.label}{way}: {needs}, {self.hit.mean():.0%} of {self.hit.size} hit)"

    @property
    def label(self) -> str:
        """Name of the series in figures and tables."""
        method, *library = self.method.split("+")
        name = NAMES.get(method, method) + (" from a library" if library else "")
        return f"{name}, {self.observation}" if self.observation else name

    @property
    def learned(self) -> bool:
        """Whether it was trained before."""
        return bool(self.observation)

    @property
    def main(self) -> bool:
        """Whether it is a search, or a learner under the main convention."""
        return self.convention in ("", MAIN_CONVENTION)

    @property
    def mean(self) -> float:
        """Eq. 21, over all seeds."""
        return float(self.trials.mean())

    @cached_property
    def interval(self) -> tuple[float, float]:
        """95 % interval of the mean, over seeds and targets (`whiptool.comparison.intervals`)."""
        return mean_interval(self.trials, cap=self.cap)

    def needs_fewer(self, other: Series, *, share: float = 1.0) -> bool:
        """Whether it needs fewer trials than another, or than a share of the other's, beyond the 95 % interval."""
        return needs_fewer(self.trials, other.trials, share=share)

    def row(self) -> dict[str, Any]:
        """One line of the table."""
        low, high = self.interval
        return {
            "method": self.method,
            "observation": self.observation,
            "convention": self.convention,
            "hit_radius": self.hit_radius,
            "mean_trials": self.mean,
            "low": low,
            "high": high,
            "median_trials": float(np.median(self.trials)),
            "largest": int(self.trials.max()),
            "share_hit": float(self.hit.mean()),
            "seeds": len(self.trials),
            "targets": self.trials.shape[1],
            "training_trials": self.training_trials,
            "n_diverged": self.n_diverged,
            "notes": "; ".join(self.notes),
            "wall_time": self.wall_time,
        }


def collect(units: Iterable[SearchUnit | LearnerUnit], results: Mapping[str, Mapping[str, Any]]) -> list[Series]:
    """The series of finished units, in the order of the units."""
    groups: dict[tuple[str, str], dict[int, list[Mapping[str, Any]]]] = defaultdict(lambda: defaultdict(list))
    units = list(units)
    for unit in units:
        observation = unit.observation if isinstance(unit, LearnerUnit) else ""
        groups[unit.series, observation][unit.seed].append(results[unit.key])
    series = []
    for (method, observation), seeds in groups.items():
        parts = [part for chunks in seeds.values() for part in chunks]
        notes = tuple(f"seed {seed}: {c['note']}" for seed, chunks in seeds.items() for c in chunks if c["note"])
        for i, kind in enumerate(parts[0]["outcomes"]):
            trials, hit = (
                np.array([[x for chunk in chunks for x in chunk["outcomes"][i][key]] for chunks in seeds.values()])
                for key in ("trials", "hit")
            )
            series.append(
                Series(
                    method=method,
                    observation=observation,
                    convention=kind["convention"],
                    hit_radius=kind["hit_radius"],
                    trials=trials,
                    hit=hit,
                    training_trials=float(np.mean([chunks[0]["training_trials"] for chunks in seeds.values()])),
                    n_diverged=sum(part["n_diverged"] for part in parts),
                    wall_time=sum(part["wall_time"] for part in parts) / len(seeds),
                    notes=notes,
                    cap=units[0].scene.cap,
                )
            )
    return series
