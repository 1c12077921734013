"""How much a task asks for: the share of its targets that one and the same strike hits, and that random strikes hit.

Where one strike does for nearly all targets, a method can hit them without looking at them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.distance import cdist

from whiptool.comparison.target_scene import TargetScene
from whiptool.comparison.units import Unit
from whiptool.models.strike import StrikeBounds
from whiptool.rl.task import StrikeTask
from whiptool.rollout import CompiledRollout

RATE = 1000.0  # [1/s] of the paths by which strikes are ranked
_KEPT, _CHILDREN = 1 / 250, 25  # the share of the random strikes' number that is varied, and variations of each
WIDTHS = (0.1, 0.05, 0.05, 0.02, 0.02, 0.01, 0.01, 0.005)  # of the variations, in widths of the box


@dataclass(frozen=True, kw_only=True)
class DifficultyUnit(Unit):
    """Estimates the difficulty of a set of targets: the fraction hit by a single strike, and by random strikes.

    The best random strikes are varied by shrinking steps, keeping those that hit most targets; this gives a lower bound
    of the fraction that one strike can hit.

    Args:
        scene: Model, targets and hit radius (the first of its radii).
        strikes: Number of random strikes.
    """

    scene: TargetScene
    strikes: int = 10_000

    def run(self, folder: Path | None, threads: int | None) -> dict[str, Any]:
        """Simulate each random strike at its own target and the best strike at all targets; return the fractions
        hit.
        """
        scene, rng = self.scene, np.random.default_rng(scene_seed(self.scene))
        rollout, goals = scene.rollout(threads), scene.goals()
        task = StrikeTask(
            rollout, scene.zone, arrival=scene.arrival, hit_radius=scene.radii[0], t_stay=scene.t_stay
        )  # which keeps the limits of a robot, as searches do
        strikes = task.admissible(task.bounds.sample(rng, self.strikes))
        random = task.judge(strikes, goals.rows(np.arange(len(strikes)) % scene.targets)).hit
        kept = math.ceil(_KEPT * self.strikes)
        best = _best(task, strikes, targets_hit(rollout, strikes, scene), kept)
        for width in WIDTHS:
            some = np.vstack([best, task.admissible(varied(best, width, task.bounds, rng))])
            best = _best(task, some, targets_hit(rollout, some, scene), kept)
        at_all = task.judge(np.tile(best[0], (scene.targets, 1)), goals).hit
        return {
            "one_strike": best[0].tolist(),
            "one_strike_hits": float(at_all.mean()),
            "random_strikes_hit": float(random.mean()),
        }


def scene_seed(scene: TargetScene) -> list[int]:
    """Return the seed of the random strikes, different from that of the targets."""
    return [scene.target_seed, 1]


def targets_hit(rollout: CompiledRollout, strikes: np.ndarray, scene: TargetScene) -> np.ndarray:
    """Return how many of a scene's targets each strike hits, (B,), from tip paths sampled at `RATE`."""
    goals, found = scene.goals(), []
    targets, radius = goals.positions, goals.hit_radius
    low, high = targets.min(axis=0) - radius, targets.max(axis=0) + radius
    for first in range(0, len(strikes), 1024):
        for path in rollout.tip_path(strikes[first : first + 1024], t_stay=scene.t_stay, rate=RATE)[1]:
            inside = ((path >= low) & (path <= high)).all(axis=1)  # no NaN among them
            if not inside.any():
                found.append(0)
                continue
            distance, velocity = cdist(path[inside], targets), None
            if not goals.only_points:
                velocity = velocities_at(path, np.flatnonzero(inside)[distance.argmin(axis=0)], targets)
            found.append(int(goals.hit(distance.min(axis=0), velocity).sum()))
    return np.array(found)


def velocities_at(path: np.ndarray, samples: np.ndarray, targets: np.ndarray) -> np.ndarray:
    """Return the tip's velocities at the points nearest to targets, (B, d) [m/s].

    Args:
        path: Path of the tip sampled at `RATE`, (S, d) [m]; NaN after the strike's end.
        samples: Index of the sample nearest to each target, (B,).
        targets: Positions of the targets, (B, d) [m].
    """
    path = path[np.isfinite(path).all(axis=1)]
    if len(path) < 2:  # diverged at once
        return np.zeros_like(targets)
    velocity = np.gradient(path, 1 / RATE, axis=0)
    turn, v = np.gradient(velocity, 1 / RATE, axis=0)[samples], velocity[samples]
    ahead = ((targets - path[samples]) * v).sum(axis=1) / np.maximum((v**2).sum(axis=1), np.finfo(float).tiny)
    return v + np.clip(ahead, -1 / RATE, 1 / RATE)[:, None] * turn


def varied(strikes: np.ndarray, width: float, bounds: StrikeBounds, rng: np.random.Generator) -> np.ndarray:
    """Return 25 variations of each strike (B, m), (25 B, m), normal with a standard deviation of `width` times the
    box."""
    lower, upper = bounds.box
    children = np.repeat(strikes, _CHILDREN, axis=0)
    return np.clip(children + width * (upper - lower) * rng.standard_normal(children.shape), lower, upper)


def _best(task: StrikeTask, strikes: np.ndarray, hits: np.ndarray, kept: int) -> np.ndarray:
    """Those within the limits that hit most, the most first; any, where none that hits is within."""
    order = np.argsort(-hits, kind="stable")
    within = islice((i for i in order[: np.count_nonzero(hits)] if task.within_limits(strikes[i])), kept)
    return strikes[order[:kept] if not task.limits else list(within) or order[:kept]]
