"""Strikes at one target that five methods find, each with several seeds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from whiptool import CompiledRollout, Controller, Objective, Target, default_bounds, preset, search
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
