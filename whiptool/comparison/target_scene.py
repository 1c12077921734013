"""Model, controller and targets, which are the same for all compared methods, and the difficulty of the targets.

Targets lie in a disc, or where the tip can be fast. If a single strike hits nearly all targets, a method can hit them
without using their positions.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.distance import cdist

from whiptool.comparison.units import Store, Unit
from whiptool.errors import InputError
from whiptool.given_files import number_in
from whiptool.goals.arrival_rule import ArrivalRule, GoalRegion
from whiptool.goals.goals import Goals
from whiptool.goals.target import TARGET
from whiptool.goals.zone import (
    Disc,
    ReachableDisc,
    Region,
    Zone,
    check_fits,
    disc_within_reach,
    reachable_region,
    round_name,
)
from whiptool.impedance import Controller
from whiptool.models import Model
from whiptool.models.numbers import LARGEST, number, numbers
from whiptool.models.strike import T_STAY, StrikeBounds, default_bounds
from whiptool.rl.task import StrikeTask
from whiptool.rollout import CompiledRollout


@dataclass(frozen=True, kw_only=True)
class TargetScene:
    """Model, controller and targets of a comparison, the same for all methods."""

    model: Model
    controller: Controller
    zone: Zone = field(default_factory=Disc)  # of the targets
    arrival: ArrivalRule = field(default_factory=ArrivalRule)  # required arrival of the tip at the targets
    targets: int = 300
    target_seed: int = 0  # with which the targets are drawn
    radii: tuple[float, ...] = (0.06, 0.03, 0.01)  # hit radii [m], the widest first, with which learners are trained
    cap: int = 600  # largest number of trials at each target
    t_stay: float = T_STAY  # time after the movement during which the tip is followed [s]
    tolerance: float | None = None  # of the compiled rollout
    timestep: float | None = None  # of the compiled rollout

    def __post_init__(self) -> None:
        for radius in self.radii:
            check_fits(self.zone, self.model, radius)

    def points(self) -> np.ndarray:
        """Positions of the targets, (targets, d) [m]."""
        return self.goals().positions

    def goals(self) -> Goals:
        """Return the targets with the widest hit radius and the required arrival of the tip."""
        return self.region(self.radii[0]).draw(self.targets, np.random.default_rng(self.target_seed))

    def region(self, hit_radius: float) -> GoalRegion:
        """Return the region of the goals for one of the hit radii [m]."""
        return GoalRegion(self.zone, self.arrival, hit_radius)

    def rollout(self, threads: int | None = None) -> CompiledRollout:
        """Return the simulator that all methods share."""
        accuracy = {"tolerance": self.tolerance, "timestep": self.timestep}
        return CompiledRollout(self.model, self.controller, **accuracy, threads=threads)


FAST = "fast"
SPEED = 3.0  # [m/s] at least, of the tip in the fast region
STRIKES, QUICK_STRIKES = 1_000_000, 2_048  # random ones that find the fast region
CELL = 0.02  # [m]
STRIKES_IN_SPACE, QUICK_STRIKES_IN_SPACE = 100_000, 2_048  # a strike costs ten times more there,
CELL_IN_SPACE = 0.1  # [m], and cells are more


@dataclass(frozen=True, kw_only=True)
class RegionUnit(Unit):
    """Work unit that finds the region that the tips of random strikes pass at `SPEED` [m/s] or faster."""

    scene: TargetScene  # its zone and targets are not used
    strikes: int  # number of random strikes
    cell: float = CELL  # width of the cells of the region [m]

    def run(self, folder: Path | None, threads: int | None) -> dict[str, Any]:
        """Simulate random strikes, and return the cells that their tips pass with at least `SPEED`."""
        bounds = default_bounds(self.scene.model.arm)
        region = reachable_region(self.scene.rollout(threads), bounds, speed=SPEED, count=self.strikes, cell=self.cell)
        return {"corners": region.corners.tolist(), "cell": region.cell}


def fast_region(scene: TargetScene, store: Store, *, quick: bool = False) -> Region:
    """Return all cells that the tip passes with at least `SPEED`; computed once and kept in the store."""
    in_space = scene.model.dimension == 3
    usual, few = (STRIKES_IN_SPACE, QUICK_STRIKES_IN_SPACE) if in_space else (STRIKES, QUICK_STRIKES)
    strikes = few if quick else usual
    unit = RegionUnit(scene=scene, strikes=strikes, cell=CELL_IN_SPACE if in_space else CELL)
    known = store.results([unit], desc="region")[unit.key]
    return Region(np.array(known["corners"]), known["cell"])


def check_zone(name: str, centre: tuple[float, ...] = TARGET, reach: float = LARGEST) -> None:
    """Check the text that names a zone of targets: `fast` (where the tips of random strikes are fast), or a radius [m],
    such as `0.3`, of a disc that contains some, but not all points within the tip's reach from the shoulder [m].
    """
    if name == FAST:
        return
    try:
        disc = Disc(centre, number_in(name))
    except ValueError:
        raise InputError("zone", name, f"radii > 0 in m, or {FAST}") from None
    try:
        disc_within_reach(disc, reach)
    except InputError as error:
        raise InputError("zone", name, error.allowed) from None


def zone_named(name: str, scene: TargetScene, store: Store, *, quick: bool = False) -> Zone:
    """Return the zone with a name: the fast region, or the reachable part of a disc of that radius [m] around the
    middle of the scene's zone.
    """
    if name == FAST:
        return fast_region(scene, store, quick=quick)
    around = scene.zone.disc if isinstance(scene.zone, ReachableDisc) else scene.zone
    centre = tuple(np.mean(around.box, axis=0).tolist())
    return disc_within_reach(Disc(centre, float(name)), scene.model.reach)


def words(zone: Zone) -> str:
    """Return a zone as text."""
    if isinstance(zone, Disc):
        centre = ", ".join(f"{x:g}" for x in zone.centre)
        return f"{round_name(zone)} of radius {zone.radius:g} m around ({centre}) m"
    if isinstance(zone, ReachableDisc):
        return f"what is within reach ({zone.reach:.3f} m) of {words(zone.disc)}"
    return f"wherever the tip can pass with {SPEED:g} m/s, {zone.size:.2f} m^{zone.dimension}"


RATE = 1000.0  # [1/s] of the paths by which strikes are ranked
_KEPT, _CHILDREN = 1 / 250, 25  # the share of the random strikes' number that is varied, and variations of each
WIDTHS = (0.1, 0.05, 0.05, 0.02, 0.02, 0.01, 0.01, 0.005)  # of the variations, in widths of the box


@dataclass(frozen=True, kw_only=True)
class DifficultyUnit(Unit):
    """Estimates the difficulty of a set of targets: the fraction hit by a single strike, and by random strikes.

    The best random strikes are varied by shrinking steps, keeping those that hit most targets; this gives a lower bound
    of the fraction that one strike can hit.
    """

    scene: TargetScene  # its first hit radius counts
    strikes: int = 10_000  # number of random strikes

    def run(self, folder: Path | None, threads: int | None) -> dict[str, Any]:
        """Simulate each random strike at its target and the best strike at all targets; return the fractions hit."""
        scene, rng = self.scene, np.random.default_rng(scene_seed(self.scene))
        rollout, goals = scene.rollout(threads), scene.goals()
        task = StrikeTask(rollout, scene.region(scene.radii[0]), t_stay=scene.t_stay)  # within a robot's limits
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

    def check(self, result: Mapping[str, Any]) -> None:
        """Raise an exception if a stored result is not one that this unit can have had."""
        numbers("one_strike", result["one_strike"])
        for name in ("one_strike_hits", "random_strikes_hit"):
            number(name, result[name], low=0, high=1)


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
    """Return the tip's velocities at the points nearest to targets, (B, d) [m/s]: `samples` are the nearest indices,
    (B,), of a path sampled at `RATE`, (S, d) [m], NaN after the strike's end.
    """
    path = path[np.isfinite(path).all(axis=1)]
    if len(path) < 2:  # diverged at once
        return np.zeros_like(targets)
    velocity = np.gradient(path, 1 / RATE, axis=0)
    turn, v = np.gradient(velocity, 1 / RATE, axis=0)[samples], velocity[samples]
    ahead = ((targets - path[samples]) * v).sum(axis=1) / np.maximum((v**2).sum(axis=1), np.finfo(float).tiny)
    return v + np.clip(ahead, -1 / RATE, 1 / RATE)[:, None] * turn


def varied(strikes: np.ndarray, width: float, bounds: StrikeBounds, rng: np.random.Generator) -> np.ndarray:
    """Return 25 normally distributed variations of each of B strikes (B, m), clipped to the bounds, (25 B, m); the
    standard deviation is `width` times the width of the bounds.
    """
    lower, upper = bounds.box
    children = np.repeat(strikes, _CHILDREN, axis=0)
    return np.clip(children + width * (upper - lower) * rng.standard_normal(children.shape), lower, upper)


def _best(task: StrikeTask, strikes: np.ndarray, hits: np.ndarray, kept: int) -> np.ndarray:
    """Those within the limits that hit most, the most first; any, where none that hits is within."""
    order = np.argsort(-hits, kind="stable")
    within = islice((i for i in order[: np.count_nonzero(hits)] if task.within_limits(strikes[i])), kept)
    return strikes[order[:kept] if not task.limits else list(within) or order[:kept]]
