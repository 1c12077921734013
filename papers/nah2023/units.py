"""The work units of this reproduction: searches, many solutions of a target, and the published strikes."""

from __future__ import annotations

import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from papers.nah2023 import published
from papers.nah2023.hand import LastNodes, measure
from papers.nah2023.solutions import descend, distinct, path_sensitivity
from whiptool import CompiledRollout, Controller, Target, default_bounds
from whiptool.comparison.units import Unit
from whiptool.impedance import constant_preset
from whiptool.models.presets import NAH2023
from whiptool.models.spatial_arm import SpatialArm

TIMESTEP = 5e-4  # [s], equal steps: distances are right to 0.1 mm, and all nodes are seen at each of them
COARSE = 1e-3  # [s], of descents before their last steps: within half a millimetre of the finer
STAY = 0.6  # [s] after the movement that the tip alone is watched: the published strikes hit up to 0.45 s after it
CONTROLLER = Controller(constant_preset("nah2023"))
BOUNDS = default_bounds(NAH2023.arm)
GROUPS = {"initial": slice(0, 4), "final": slice(4, 8), "D": slice(8, 9)}  # of a strike's vector: their cases A, B, C


def simulator(threads: int | None, engine: str | None = None, timestep: float = TIMESTEP) -> CompiledRollout:
    """Return the rollout of their arm, whip and controller; one strike at a time costs less on the engine `scalar`."""
    return CompiledRollout(NAH2023, CONTROLLER, timestep=timestep, threads=threads, engine=engine)


@dataclass(frozen=True, kw_only=True)
class DirectUnit(Unit):
    """DIRECT-L at one target, until any of the last nodes hits.

    Args:
        target: Which, from 0.
        nodes: How many count, until their simulation ends; 1: the tip alone, by our convention, until `STAY`.
        cap: Evaluations at most.
    """

    target: int
    nodes: int
    cap: int

    def run(self, folder: Path | None, threads: int | None) -> dict[str, Any]:
        """Search, and return how many evaluations it took, if it hit, every miss [m], the best, and the time [s]."""
        tip = simulator(threads, "scalar")
        rollout = tip if self.nodes == 1 else LastNodes(tip, self.nodes, published.UNTIL)
        return _search(rollout, self.target, published.HIT_RADIUS, "directl", self.cap)


@dataclass(frozen=True, kw_only=True)
class GradientUnit(Unit):
    """The search by exact gradients at one target, until the tip comes within 1 mm.

    Args:
        target: Which, from 0.
        cap: Rollouts at most.
    """

    target: int
    cap: int

    def run(self, folder: Path | None, threads: int | None) -> dict[str, Any]:
        """Search, and return how many rollouts it took, whether it hit, every miss [m], the best, and the time [s]."""
        return _search(simulator(threads), self.target, 1e-3, "gradient", self.cap)


def _search(rollout, which: int, radius: float, method: str, cap: int) -> dict[str, Any]:
    from whiptool import Objective, search

    start, target = time.monotonic(), Target(published.TARGETS[which], radius)
    objective = Objective(rollout, target, t_stay=STAY, bounds=BOUNDS, max_trials=cap, stop_at_hit=True)
    found = search(objective, method).uninterrupted()
    misses = [trial.outcome.miss_distance for trial in found.trace]
    return {
        "evaluations": len(misses),
        "hit": found.first_hit is not None,
        "best": min(misses),
        "misses": misses,
        "wall_time": time.monotonic() - start,
    }


@dataclass(frozen=True, kw_only=True)
class SolutionsUnit(Unit):
    """Many strikes at one target, each as near as it can come, and what they are like.

    Args:
        target: Which, from 0.
        random: Random strikes, the nearest of which are the starts.
        starts: How many of them are followed down.
        kept: Of what they lead to, the nearest, which are measured.
        perturbed: Strikes with noise around each of these, in each group of parameters.
    """

    target: int
    random: int = 1000
    starts: int = 32
    kept: int = 24
    perturbed: int = 20

    def run(self, folder: Path | None, threads: int | None) -> dict[str, Any]:
        """Find and measure them, and as many random strikes for comparison."""
        start, rollout, target = time.monotonic(), simulator(threads), np.array(published.TARGETS[self.target])
        coarse, rng = simulator(threads, timestep=COARSE), np.random.default_rng(self.target)
        drawn = BOUNDS.sample(rng, self.random)
        misses = coarse.approach(drawn, target, t_stay=STAY).distance
        nearest = np.argsort(misses, kind="stable")[: self.starts]
        strikes, _ = descend(coarse, BOUNDS, drawn[nearest], target, t_stay=STAY)
        strikes, ends = by_merit(*descend(rollout, BOUNDS, strikes, target, t_stay=STAY))
        kept = strikes[distinct(strikes, BOUNDS)][: self.kept]
        near = rollout.approach(kept, target, t_stay=STAY)
        return {
            "random_best": float(misses.min()),
            "ends": ends.tolist(),
            "strikes": kept.tolist(),
            "misses": near.distance.tolist(),
            "sensitivity": path_sensitivity(rollout, kept, near, t_stay=STAY).tolist(),
            "perturbed": _perturbed(rollout, kept, target, self.perturbed, rng),
            "measures": _measures(rollout, kept),
            "random_measures": _measures(rollout, drawn[: len(kept)]),
            "wall_time": time.monotonic() - start,
        }


def by_merit(strikes: np.ndarray, misses: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return strikes and their misses, the nearest first."""
    order = np.argsort(misses, kind="stable")
    return strikes[order], misses[order]


def _measures(rollout: CompiledRollout, strikes: np.ndarray) -> list[dict[str, Any]]:
    assert isinstance(NAH2023.arm, SpatialArm)
    K = np.array(rollout.controller.law.parameters()["K"]).reshape(4, 4)
    paths = rollout.trajectories(strikes, t_stay=0.0)
    return [asdict(measure(NAH2023.arm, K, p, float(x[-1]))) for p, x in zip(paths, strikes, strict=True)]


def noisy(strike: np.ndarray, group: slice, count: int, rng: np.random.Generator) -> np.ndarray:
    """Return copies of a strike with uniform noise on a group of its parameters, as in their robustness analysis."""
    lower, upper = BOUNDS.box
    noise = np.zeros((count, len(strike)))
    half = published.NOISE * (upper - lower)[group]
    noise[:, group] = rng.uniform(-half, half, (count, len(half)))
    return strike + noise


def _perturbed(
    rollout: CompiledRollout, strikes: np.ndarray, target: np.ndarray, count: int, rng: np.random.Generator
) -> dict[str, list[float]]:
    """Mean miss of the tip around each strike, by the group of parameters that is perturbed [m]."""
    found: dict[str, list[float]] = {}
    for name, group in GROUPS.items():
        around = np.concatenate([noisy(x, group, count, rng) for x in strikes])
        misses = rollout.approach(around, target, t_stay=STAY).distance.reshape(len(strikes), count)
        found[name] = misses.mean(axis=1).tolist()
    return found


@dataclass(frozen=True, kw_only=True)
class PublishedUnit(Unit):
    """The strikes and distances that the authors published, in our simulation.

    Args:
        perturbed: Strikes with noise around each, in each group of parameters.
    """

    perturbed: int = published.PERTURBED

    def run(self, folder: Path | None, threads: int | None) -> dict[str, Any]:
        """Roll them out, and return each strike's miss [m], around it the share of hits and the mean miss [m] by group,
        its hand's measures, and the distances of DIRECT-L's first strikes, (4, 19) [m]."""
        rollout, rng = simulator(threads), np.random.default_rng(0)
        theirs = LastNodes(rollout, published.LAST_NODES, published.UNTIL)
        misses, shares, means = [], {name: [] for name in GROUPS}, {name: [] for name in GROUPS}
        for strike, place in zip(published.STRIKES, published.TARGETS, strict=True):
            target = np.array(place)
            misses.append(float(theirs.approach(strike[None], target).distance[0]))
            for name, group in GROUPS.items():
                around = theirs.approach(noisy(strike, group, self.perturbed, rng), target).distance
                shares[name].append(float((around <= published.HIT_RADIUS).mean()))
                means[name].append(float(around.mean()))
        return {
            "misses": misses,
            "hit_share": shares,
            "mean_miss": means,
            "measures": _measures(rollout, published.STRIKES),
            "logged": _logged(rollout),
        }


def first_strikes() -> np.ndarray:
    """Return DIRECT-L's first strikes: the middle of the box, and a third of it to either side along each axis."""
    lower, upper = BOUNDS.box
    middle, third = (lower + upper) / 2, np.diag((upper - lower) / 3)
    return np.concatenate([middle[None], np.stack([middle - third, middle + third], axis=1).reshape(-1, len(middle))])


def _logged(rollout: CompiledRollout) -> list[list[float]]:
    """Distances of DIRECT-L's first strikes by the rule of their logs, (4, 19) [m]."""
    strikes, found = first_strikes(), []
    for place, nodes in zip(published.LOGGED_TARGETS, published.LOGGED_NODES, strict=True):
        rule = LastNodes(rollout, nodes, published.UNTIL)
        found.append(rule.approach(strikes, np.array(place)).distance.tolist())
    return found
