"""How near the tip comes at full reach: many independent trials down to where no neighbour is nearer, and CMA-ES."""

from __future__ import annotations

import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from papers.nah2023 import published
from papers.nah2023.solutions import descend
from papers.nah2023.units import (
    BOUNDS,
    COARSE,
    CONTROLLER,
    NAH2023,
    STAY,
    by_merit,
    simulator,
)
from whiptool import CompiledRollout, Strike, StrikeBounds, Target
from whiptool.comparison.units import Unit

CLOSE = published.HIT_RADIUS  # [m]: descents that end farther away are not followed on
BESIDE = (0.2, 0.04)  # widths of the boxes around a strike, of the whole box
_GAIN, _LAST_GAIN = 1e-3, 1e-6  # of a step, of the descents with the finer step, and of the nearest


@dataclass(frozen=True, kw_only=True)
class TrialsUnit(Unit):
    """Independent trials, all alike: of some random strikes the nearest, from there down to where none is nearer.

    Args:
        target: Which, from 0.
        seed: Seed of the random strikes.
        trials: Number of trials.
        random: Random strikes of each.
    """

    target: int
    seed: int
    trials: int = 16
    random: int = 32

    def run(self, folder: Path | None, threads: int | None) -> dict[str, Any]:
        """Return where the trials ended and how far from the target [m], the nearest first."""
        start, target = time.monotonic(), np.array(published.TARGETS[self.target])
        rollout, coarse = simulator(threads), simulator(threads, timestep=COARSE)
        drawn = BOUNDS.sample(np.random.default_rng([self.target, self.seed]), self.trials * self.random)
        misses = coarse.approach(drawn, target, t_stay=STAY).distance.reshape(self.trials, self.random)
        starts = drawn.reshape(self.trials, self.random, -1)[np.arange(self.trials), misses.argmin(axis=1)]
        strikes, ends = descend(coarse, BOUNDS, starts, target, t_stay=STAY)
        near = ends <= CLOSE
        strikes[near], ends[near] = descend(rollout, BOUNDS, strikes[near], target, t_stay=STAY, gain=_GAIN)
        strikes, ends = by_merit(strikes, ends)
        strikes[:1], ends[:1] = descend(rollout, BOUNDS, strikes[:1], target, t_stay=STAY, gain=_LAST_GAIN)
        return {
            "random": self.random,
            "ends": ends.tolist(),
            "strikes": strikes.tolist(),
            "wall_time": time.monotonic() - start,
        }


@dataclass(frozen=True, kw_only=True)
class EvolutionUnit(Unit):
    """CMA-ES with restarts over the whole box, and a descent from the nearest that it finds.

    Args:
        target: Which, from 0.
        seed: Seed of the search.
        cap: Rollouts.
    """

    target: int
    seed: int
    cap: int = 10_000

    def run(self, folder: Path | None, threads: int | None) -> dict[str, Any]:
        """Return where the search ended and how far from the target [m]."""
        start, target = time.monotonic(), np.array(published.TARGETS[self.target])
        rollout, coarse = simulator(threads), simulator(threads, timestep=COARSE)
        first, _ = cmaes(coarse, self.target, BOUNDS, self.cap, self.seed)
        strikes, ends = descend(rollout, BOUNDS, first[None], target, t_stay=STAY, gain=_LAST_GAIN)
        return {
            "rollouts": self.cap,
            "ends": ends.tolist(),
            "strikes": strikes.tolist(),
            "wall_time": time.monotonic() - start,
        }


def cmaes(rollout: CompiledRollout, target: int, bounds: StrikeBounds, cap: int, seed: int) -> tuple[np.ndarray, float]:
    """Return the nearest strike that CMA-ES finds within bounds, and its miss [m]."""
    from whiptool import Objective, search

    sought = Target(published.TARGETS[target], published.HIT_RADIUS)
    objective = Objective(rollout, sought, t_stay=STAY, bounds=bounds, max_trials=cap)
    found = search(objective, "cmaes", seed=seed).uninterrupted()
    nearest = min(found.trace, key=lambda trial: trial.outcome.miss_distance)
    return np.array(nearest.strike), nearest.outcome.miss_distance


@dataclass(frozen=True, kw_only=True)
class BesideUnit(Unit):
    """CMA-ES in smaller and smaller boxes around a strike, each around the nearest so far: is there a nearer one?

    Args:
        target: Which, from 0.
        strike: Strike vector.
        cap: Rollouts in each box.
    """

    target: int
    strike: tuple[float, ...]
    cap: int = 1000

    def run(self, folder: Path | None, threads: int | None) -> dict[str, Any]:
        """Return the nearest strike, and the least miss before and after each box [m]."""
        start, rollout, strike = time.monotonic(), simulator(threads), np.array(self.strike)
        target, (lower, upper) = np.array(published.TARGETS[self.target]), BOUNDS.box
        misses = [float(rollout.approach(strike[None], target, t_stay=STAY).distance[0])]
        for seed, share in enumerate(BESIDE):
            half = share / 2 * (upper - lower)
            box = StrikeBounds(tuple(np.maximum(lower, strike - half)), tuple(np.minimum(upper, strike + half)))
            other, miss = cmaes(rollout, self.target, box, self.cap, seed)
            strike = other if miss < misses[-1] else strike
            misses.append(min(miss, misses[-1]))
        wall_time = time.monotonic() - start
        return {"strike": strike.tolist(), "misses": misses, "rollouts": self.cap, "wall_time": wall_time}


@dataclass(frozen=True, kw_only=True)
class ReferenceUnit(Unit):
    """A strike in MuJoCo, at the step that it needs there.

    Args:
        target: Which, from 0.
        strike: Strike vector.
    """

    target: int
    strike: tuple[float, ...]

    def run(self, folder: Path | None, threads: int | None) -> dict[str, Any]:
        """Return the miss here and in MuJoCo [m], None where it diverges there, the step there [s], whether both agree,
        and how far the shoulder's second joint turned until the closest approach [rad]."""
        from whiptool.rollout.reference import replay

        start, target, strike = time.monotonic(), np.array(published.TARGETS[self.target]), np.array(self.strike)
        path = simulator(threads).trajectory(strike, t_stay=STAY)
        here = path.approach(target)
        expected, until = float(here.distance[0]), path.t <= here.time[0]
        found = replay(NAH2023, CONTROLLER, Strike.from_vector(strike), target, t_stay=STAY, expected=expected)
        return {
            "expected": expected,
            **asdict(found),
            "abduction": float(np.abs(path.q[until, 1]).max()),
            "wall_time": time.monotonic() - start,
        }
