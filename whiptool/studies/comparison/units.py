"""The work units of a comparison: each is a pure function of its specification, with seeds of its own.

So it does not matter where, beside what, or in which order they are worked, and what is done need not be done again.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from whiptool.impedance import Controller
from whiptool.models import Model
from whiptool.models.strike import T_STAY, default_bounds
from whiptool.rollout import CompiledRollout
from whiptool.rollout.compiled import TIMESTEP
from whiptool.zone import Disc, Zone, sample


@dataclass(frozen=True, kw_only=True)
class Scene:
    """What is struck with and at: the same for all methods.

    Args:
        model, controller: Whip, arm, and law.
        zone: Where the targets lie.
        targets: Their number.
        target_seed: They are drawn with it.
        radii: Hit radii [m]; with the first one learners are trained.
        cap: Trials at most at each target.
        t_stay: [s]
        timestep: [s]
    """

    model: Model
    controller: Controller
    zone: Zone = field(default_factory=Disc)
    targets: int = 300
    target_seed: int = 0
    radii: tuple[float, ...] = (0.06, 0.03, 0.01)
    cap: int = 600
    t_stay: float = T_STAY
    timestep: float = TIMESTEP

    def points(self) -> np.ndarray:
        """The targets, (targets, 2) [m]."""
        return sample(self.zone, self.targets, np.random.default_rng(self.target_seed))

    def rollout(self, threads: int | None = None) -> CompiledRollout:
        """Return the simulator that all methods share."""
        return CompiledRollout(self.model, self.controller, timestep=self.timestep, threads=threads)


class Unit(Protocol):
    """A part of a comparison."""

    @property
    def name(self) -> str:
        """Its own, fit for a file."""
        ...

    def run(self, folder: Path | None, threads: int | None) -> dict[str, Any]:
        """Do it.

        Args:
            folder: For checkpoints of what takes long; None, or not there (another machine): none are kept.
            threads: Of the simulator; the result does not depend on it.

        Returns:
            Plain data. Of a search or a learner, with `outcomes`: for conventions and hit radii the trials to the
            first hit of each target, `cap` where there was none, and whether there was one.
        """
        ...


@dataclass(frozen=True, kw_only=True)
class SearchUnit:
    """A search from scratch at each target of a part of them.

    It goes on until the tightest hit radius is hit: no search looks at the radius, so its first trial within a wider
    one is when it would have ended there.

    Args:
        scene: See there.
        method: Of `whiptool.optimizers`; or `library`: what passed nearest, nearest first.
        seed: Of the search, and of the library.
        first, last: The part of the targets.
        library: Random strikes of the past that the search begins from; 0: it begins from nothing.
        task: Put before the name, where a folder holds several tasks.
    """

    scene: Scene
    method: str
    seed: int
    first: int
    last: int
    library: int = 0
    task: str = ""

    @property
    def series(self) -> str:
        """What it is called in a table."""
        return f"{self.method}+library" if self.library and self.method != "library" else self.method

    @property
    def name(self) -> str:
        """Name of the unit: method, seed and targets."""
        return f"{self.task}{self.series.replace(':', '-')}-seed{self.seed}-targets{self.first}-{self.last}"

    def run(self, folder: Path | None, threads: int | None) -> dict[str, Any]:
        """Search at every target of the unit."""
        from whiptool.objective import Objective
        from whiptool.optimizers import search
        from whiptool.optimizers.library import StrikeLibrary, library_search, warm_search
        from whiptool.target import Target

        scene, start = self.scene, time.monotonic()
        rollout, misses, n_diverged, library = scene.rollout(threads), [], 0, None
        if self.library:
            bounds = default_bounds(scene.model.arm)
            library = StrikeLibrary.random(rollout, bounds, self.library, seed=self.seed, t_stay=scene.t_stay)
        for i, point in list(enumerate(scene.points()))[self.first : self.last]:
            objective = Objective(
                rollout,
                Target(tuple(point), min(scene.radii)),
                t_stay=scene.t_stay,
                max_trials=scene.cap,
                stop_at_hit=True,
            )
            seed = int(np.random.SeedSequence((self.seed, i)).generate_state(1)[0]) >> 1  # below 2^31, for NLopt
            if library is None:
                found = search(objective, self.method, seed=seed)
            elif self.method == "library":
                found = library_search(objective, library)
            else:
                found = warm_search(objective, self.method, library, seed=seed)
            if found.status.value == "interrupted":  # `search` turns Ctrl-C into a result
                raise KeyboardInterrupt
            n_diverged += found.n_diverged
            misses.append(np.array([trial.outcome.miss_distance for trial in found.trace]))
        outcomes = []
        for radius in scene.radii:
            hit = [bool((miss <= radius).any()) for miss in misses]
            trials = [int((m <= radius).argmax()) + 1 if h else scene.cap for m, h in zip(misses, hit, strict=True)]
            outcomes.append({"convention": "", "hit_radius": radius, "trials": trials, "hit": hit})
        seconds = time.monotonic() - start
        return {
            "outcomes": outcomes,
            "training_trials": self.library,
            "n_diverged": n_diverged,
            "wall_time": seconds,
            "note": "",
        }
