"""The work unit of a search: from scratch, or from a library of past strikes, at each target of a part of them."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from whiptool.comparison.target_scene import TargetScene
from whiptool.comparison.units import Unit
from whiptool.goals.target import Target
from whiptool.models.strike import default_bounds
from whiptool.rollout import CompiledRollout

if TYPE_CHECKING:
    from whiptool.optimizers.result import Result
    from whiptool.optimizers.strike_library import StrikeLibrary


@dataclass(frozen=True, kw_only=True)
class SearchUnit(Unit):
    """A search from scratch at each target of a contiguous part of the targets.

    The search goes on until the smallest hit radius is hit. For a target that is a point no search uses the radius, so
    its first trial within a wider radius is the one at which a search with that radius would have ended. A required
    direction or speed is weighted by the hit radius, so there is then one search per radius.

    Args:
        scene: Model, targets and hit radii.
        method: Method of `whiptool.optimizers`, or `library`: strikes of a library of past strikes, nearest first.
        seed: Seed of the search, and of the library.
        first, last: Range of the targets.
        library: Number of past random strikes from which the search starts; 0: none.
    """

    scene: TargetScene
    method: str
    seed: int
    first: int
    last: int
    library: int = 0

    @property
    def series(self) -> str:
        """Name of the method in tables."""
        return f"{self.method}+library" if self.library and self.method != "library" else self.method

    def run(self, folder: Path | None, threads: int | None) -> dict[str, Any]:
        """Search at every target of the unit, and return the results."""
        from whiptool.optimizers.strike_library import StrikeLibrary

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
        from whiptool.objective import Objective
        from whiptool.optimizers import search
        from whiptool.optimizers.strike_library import library_search, warm_search

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
