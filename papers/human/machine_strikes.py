"""Strikes at one target that five methods find; and learning over trials by people, a learner and adaptation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from papers.human.reading import People
from whiptool import (
    Adaptation,
    CompiledRollout,
    Controller,
    Objective,
    Target,
    TipPort,
    default_bounds,
    default_prior,
    draw_twin,
    preset,
    search,
)
from whiptool.adaptation.adapter import Options
from whiptool.comparison.units import Unit
from whiptool.goals.criteria import find_criterion

METHODS = {
    "DIRECT-L": "directl",
    "CMA-ES": "cmaes",
    "SAC": "sac",
    "gradient": "gradient",
    "robust": "gradient",  # minimises the root mean square miss under noise
}
ROBUST = "robust"
TARGET = (1.2, 0.1)
TRIALS = 600
NOISE = 0.1  # [rad, s] that the robust planner expects of each number of a strike
TIMESTEP = 5e-4  # [s]


def machine(threads: int | None = None) -> CompiledRollout:
    """Return the machine that strikes: the paper's arm and whip."""
    return CompiledRollout(preset("lemon2024"), Controller(), timestep=TIMESTEP, threads=threads)


def target_of(hit_radius: float) -> Target:
    """Return the one target with a hit radius [m]."""
    return Target(TARGET, hit_radius=hit_radius)


@dataclass(frozen=True, kw_only=True)
class StrikeUnit(Unit):
    """One method with one seed, a work unit.

    Args:
        method: A key of `METHODS`.
        seed: Seed of what is random.
        hit_radius: Hit radius [m].
        trials: Strikes at most, of which the best is kept.
    """

    method: str
    seed: int
    hit_radius: float
    trials: int = TRIALS

    def run(self, folder: Path | None, threads: int | None) -> dict[str, Any]:
        """Search, and return the strike with what every trial missed by [m]."""
        return found_by(self.method, self.seed, self.hit_radius, self.trials, machine(threads))


def found_by(method: str, seed: int, hit_radius: float, trials: int, rollout: CompiledRollout) -> dict[str, Any]:
    """Return the best strike that a method finds, its miss distance [m], its tip's speed [m/s], and all misses [m]."""
    bounds = default_bounds(rollout.model.arm)
    criteria = [find_criterion("robustness", bounds, noise=(NOISE,))] if method == ROBUST else []
    objective = Objective(rollout, target_of(hit_radius), max_trials=trials, criteria=criteria)
    result = search(objective, METHODS[method], seed=seed).uninterrupted()
    assert result.strike is not None
    assert result.outcome is not None
    return {
        "method": method,
        "seed": seed,
        "strike": result.strike.vector.tolist(),
        "miss_distance": result.outcome.miss_distance,
        "tip_speed": result.outcome.tip_speed,
        "misses": [trial.outcome.miss_distance for trial in objective.trials],
    }


def by_method(found: Sequence[dict[str, Any]]) -> dict[str, np.ndarray]:
    """Return strikes (seeds, numbers) by method, in the order of `METHODS`."""
    return {
        method: np.array([one["strike"] for one in found if one["method"] == method])
        for method in METHODS
        if any(one["method"] == method for one in found)
    }


STRIKES = 5  # of an adaptation
EDGES = (1, 2, 3, 4, 6, 9, 14, 21, 33, 51, 80, 125, 196, 307, 481, 753)  # of bins of trials
_RESAMPLES = 1000


@dataclass(frozen=True, kw_only=True)
class AdaptUnit(Unit):
    """A machine that learns an unknown whip strike by strike, a work unit.

    Args:
        seed: Which whip, of the family `strange`, that no model of the planner's simulates.
        hit_radius: Hit radius [m].
        strikes: That it makes, hit or miss.
    """

    seed: int
    hit_radius: float
    strikes: int = STRIKES

    def run(self, folder: Path | None, threads: int | None) -> dict[str, Any]:
        """Adapt, and return what every strike missed by [m]."""
        model, controller, target = preset("lemon2024"), Controller(), target_of(self.hit_radius)
        twin = draw_twin("strange", self.seed, model, controller)
        options = Options(max_strikes=self.strikes, stop_at=0.0, seed=self.seed)
        steps = Adaptation(default_prior(model, controller), TipPort(twin, target), target, options).run()
        return {"misses": [step.outcome.true_miss for step in steps.strikes]}


@dataclass(frozen=True, eq=False)
class Curve:
    """Median miss distances over bins of trials, with 95 % intervals; B bins that hold something.

    Args:
        label: Whose.
        trial: Geometric middle of each bin, (B,).
        median, low, high: [m], (B,).
        learners: People, seeds or whips.
    """

    label: str
    trial: np.ndarray
    median: np.ndarray
    low: np.ndarray
    high: np.ndarray
    learners: int


def curve(label: str, misses: Sequence[Sequence[float | None]], *, seed: int = 0) -> Curve:
    """Return the curve of some learners.

    The interval is that of learners resampled, with replacement, each with all its trials.

    Args:
        label: Whose.
        misses: Misses of each learner, trial by trial [m]; None where nothing was seen.
        seed: Seed of the drawing.
    """
    longest = max(len(one) for one in misses)
    table = np.full((len(misses), longest), np.nan)
    for row, one in zip(table, misses, strict=True):
        row[: len(one)] = [np.nan if x is None else x for x in one]
    rng = np.random.default_rng(seed)
    drawn = rng.integers(len(table), size=(_RESAMPLES, len(table)))
    rows = []
    for low, high in pairwise(EDGES):
        some = table[:, low - 1 : high - 1]
        if np.isfinite(some).any(axis=1).sum() < (len(table) + 1) // 2:
            continue  # fewer than half of them went on so long
        found = np.nanmedian(some[drawn].reshape(_RESAMPLES, -1), axis=1)
        last = min(high - 1, longest)
        rows.append((np.sqrt(low * last), np.nanmedian(some), *np.nanpercentile(found, (2.5, 97.5))))
    trial, median, lowest, highest = np.array(rows).T
    return Curve(label, trial, median, lowest, highest, len(table))


def people_misses(people: People, style: str) -> list[list[float]]:
    """Return every person's minimal distances in a style, throw by throw [m]."""
    throws = people.throws[people.throws["style"] == style].sort_values(["person", "block", "trial"])
    return [rows["min_distance"].tolist() for _, rows in throws.groupby("person")]
