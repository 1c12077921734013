"""The work unit of a search at each of some targets, from scratch or from a library of past strikes.

With a library, a search begins at the strike whose tip passed nearest to the target. This is the simplest form of
hindsight (see `whiptool.rl.hindsight`): every strike hits all targets along its path.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from whiptool.comparison.series import MethodUnit
from whiptool.given_files import read_arrays
from whiptool.goals.target import Target
from whiptool.models.strike import T_STAY, StrikeBounds, default_bounds
from whiptool.objective import Objective
from whiptool.optimizers import Result, run_search, search
from whiptool.rollout import CompiledRollout
from whiptool.whole_files import write_npz

RATE = 250.0  # [1/s] of the stored paths: the straight line between samples is then within about a millimetre
_AT_ONCE = 512


@dataclass(frozen=True, eq=False)
class StrikeLibrary:
    """Past strikes and the paths of their tips."""

    strikes: np.ndarray  # vectors of n strikes of an arm with `a` joints, (n, 2 a + 1)
    paths: np.ndarray  # tip at S equal intervals, (n, S, d) [m], single precision; NaN after a strike's end

    @classmethod
    def random(
        cls, rollout: CompiledRollout, bounds: StrikeBounds, count: int, *, seed: int, t_stay: float = T_STAY
    ) -> StrikeLibrary:
        """Return a library of `count` uniformly random strikes."""
        strikes = bounds.sample(np.random.default_rng(seed), count)
        samples = int((bounds.upper[-1] + t_stay) * RATE) + 1
        paths = np.full((count, samples, rollout.model.dimension), np.nan, np.float32)
        for first in range(0, count, 4096):
            some = rollout.tip_path(strikes[first : first + 4096], t_stay=t_stay, rate=RATE)[1]
            paths[first : first + 4096, : some.shape[1]] = some
        return cls(strikes, paths)

    def nearest(self, target: np.ndarray | tuple[float, ...], count: int = 1) -> tuple[np.ndarray, np.ndarray]:
        """Return the strikes whose tips passed nearest to a target (d,) [m], the nearest first, (count, 2 a + 1), and
        their miss distances [m], (count,).
        """
        distance = np.empty(len(self.strikes))
        for first in range(0, len(distance), _AT_ONCE):
            distance[first : first + _AT_ONCE] = _distance(self.paths[first : first + _AT_ONCE], np.asarray(target))
        order = np.argsort(distance, kind="stable")[:count]
        return self.strikes[order], distance[order]

    def save(self, path: Path | str) -> None:
        """Write an NPZ file, without pickle, with the arrays `strikes` and `paths`."""
        write_npz(path, {"strikes": self.strikes, "paths": self.paths})

    @classmethod
    def load(cls, path: Path | str) -> StrikeLibrary:
        """Read a library that `save` wrote."""
        arrays = read_arrays(path, "library of strikes", {"strikes": "nm", "paths": "nSd"})
        return cls(arrays["strikes"], arrays["paths"])


def _distance(paths: np.ndarray, target: np.ndarray) -> np.ndarray:
    """Of each path (b, S, d) from the target, (b,); infinite for a path without two samples."""
    start, step = paths[:, :-1] - target.astype(np.float32), np.diff(paths, axis=1)
    length2 = (step**2).sum(axis=2)
    s = np.clip(-(start * step).sum(axis=2) / np.where(length2 > 0, length2, 1), 0, 1)
    squared = ((start + s[..., None] * step) ** 2).sum(axis=2)
    return np.sqrt(np.where(np.isnan(squared), np.inf, squared).min(axis=1))


def warm_search(
    objective: Objective, method: str, library: StrikeLibrary, *, seed: int = 0, width: float = 0.1
) -> Result:
    """Try the library's strike that is nearest to the target; after a miss, search around it, in a box whose width is
    the fraction `width` of the objective's box.
    """
    first = library.nearest(objective.target.position)[0][0]
    lower, upper = objective.bounds.box
    half = width * (upper - lower) / 2
    centre = np.clip(first, lower + half, upper - half)
    objective.bounds = StrikeBounds(tuple(centre - half), tuple(centre + half))
    return search(objective, method, seed=seed, first=first)


def library_search(objective: Objective, library: StrikeLibrary) -> Result:
    """Try the library's strikes, nearest to the target first, until the objective stops the search or all were
    tried."""

    def strikes(objective: Objective, *, seed: int) -> None:
        for strike in library.nearest(objective.target.position, len(library.strikes))[0]:
            objective.trial(strike)

    return run_search(objective, strikes, "library", seed=0)


@dataclass(frozen=True, kw_only=True)
class SearchUnit(MethodUnit):
    """Work unit that searches at each target of a contiguous range of the targets.

    The search goes on until the tip comes within the smallest hit radius. At a target without direction and speed the
    search does not depend on the radius, so that its first trial within a wider radius also gives the result for that
    radius. A required direction or speed is weighted by the hit radius, so there is then one search per radius.
    """

    method: str  # of `whiptool.optimizers`, or `library`: past strikes, nearest first
    seed: int  # of the search, and of the library
    first: int  # index of the first target
    last: int  # index after the last target
    library: int = 0  # number of past random strikes from which the search starts; 0: none

    @property
    def series(self) -> tuple[str, str, int]:
        """Name of the method, with `+library` if it starts from a library; an empty text, as no observation; seed."""
        name = f"{self.method}+library" if self.library and self.method != "library" else self.method
        return name, "", self.seed

    @property
    def count(self) -> int:
        """Number of targets."""
        return self.last - self.first

    def run(self, folder: Path | None, threads: int | None) -> dict[str, Any]:
        """Search at every target of the unit, and return the results."""

        scene, start = self.scene, time.monotonic()
        rollout, library = scene.rollout(threads), None
        if self.library:
            bounds = default_bounds(scene.model.arm)
            library = StrikeLibrary.random(rollout, bounds, self.library, seed=self.seed, t_stay=scene.t_stay)
        searched = (min(scene.radii),) if scene.arrival.only_points else scene.radii
        found = {
            radius: [self._search(rollout, library, i, radius) for i in range(self.first, self.last)]
            for radius in searched
        }
        outcomes = []
        for radius in scene.radii:
            results = found.get(radius, found[searched[-1]])
            hits = [_hits(result, self._target(i, radius)) for i, result in enumerate(results, start=self.first)]
            hit = [bool(of_target.any()) for of_target in hits]
            trials = [int(h.argmax()) + 1 if any_ else scene.cap for h, any_ in zip(hits, hit, strict=True)]
            outcomes.append({"convention": "", "hit_radius": radius, "trials": trials, "hit": hit})
        return {
            "outcomes": outcomes,
            "training_trials": self.library,
            "n_diverged": sum(result.n_diverged for results in found.values() for result in results),
            "wall_time": time.monotonic() - start,
            "note": "",
        }

    def _target(self, i: int, radius: float) -> Target:
        """Target number i, with a hit radius [m]."""
        return Target.of(replace(self.scene.goals(), hit_radius=radius), i)

    def _search(self, rollout: CompiledRollout, library: StrikeLibrary | None, i: int, radius: float) -> Result:
        """Search at target number i until it is hit within a radius [m]."""
        scene, target = self.scene, self._target(i, radius)
        objective = Objective(rollout, target, t_stay=scene.t_stay, max_trials=scene.cap, stop_at_hit=True)
        seed = int(np.random.SeedSequence((self.seed, i)).generate_state(1)[0]) >> 1  # below 2^31, for NLopt
        if library is None:
            result = search(objective, self.method, seed=seed)
        elif self.method == "library":
            result = library_search(objective, library)
        else:
            result = warm_search(objective, self.method, library, seed=seed)
        return result.uninterrupted()


def _hits(result: Result, target: Target) -> np.ndarray:
    """Which trials of a search hit a target; it may have been made for a tighter hit radius."""
    outcomes = [trial.outcome for trial in result.trace]
    distance = np.array([np.inf if x.lost else x.miss_distance for x in outcomes])
    return target.goals.hit(distance, np.array([x.tip_velocity for x in outcomes]))
