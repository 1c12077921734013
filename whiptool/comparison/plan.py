"""Which methods, observations and seeds are compared, cut into units; and a comparison in memory, for a notebook."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from whiptool.comparison.learner_unit import LearnerUnit
from whiptool.comparison.search_unit import SearchUnit
from whiptool.comparison.series import Series, collect
from whiptool.comparison.target_scene import DifficultyUnit, TargetScene
from whiptool.comparison.units import Store
from whiptool.errors import InputError, expect, refuse_call
from whiptool.goals.target import HIT_RADIUS
from whiptool.goals.zone import Zone, usual_disc
from whiptool.models.numbers import texts, whole
from whiptool.optimizers import find_method
from whiptool.rl.settings import TrainingPlan
from whiptool.rollout.compiled import CompiledRollout
from whiptool.words import method_name

PAPER_METHODS = ("directl", "ga", "sac", "td3", "ddpg", "ppo")  # Fig. 6
LEARNERS = ("sac", "td3", "ddpg", "ppo")
OBSERVATIONS = ("tip", "relative", "goal")
CHUNK = 50  # targets of a unit of searches


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """Definition of a comparison: scene, methods, observations, seeds and training.

    Args:
        scene: Model, targets, hit radii and largest number of trials.
        methods: Methods of `whiptool.optimizers`; `random` is always added.
        observations: Observations of the learners.
        seeds: Number of seeds 0, 1, ...; a deterministic method gets one.
        episodes, trials, random_episodes, hindsight: Training, see `whiptool.rl.training.TrainingPlan`.
        further_episodes: Episodes with observations other than `tip`, at most `episodes`; None: as many. The number of
            random episodes is reduced in proportion.

    Raises:
        InputError: A name or a number is not allowed.
    """

    scene: TargetScene
    methods: tuple[str, ...] = PAPER_METHODS
    observations: tuple[str, ...] = ("goal",)
    seeds: int = 3
    episodes: int = 500
    trials: int = 100
    random_episodes: int = 50
    hindsight: int = 0
    further_episodes: int | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "methods", tuple(dict.fromkeys(map(method_name, (*self.methods, "random")))))
        object.__setattr__(self, "observations", tuple(dict.fromkeys(self.observations)))
        for method in self.methods:
            find_method(method)
        for observation in self.observations:
            if observation not in OBSERVATIONS:
                raise InputError("observation", observation, ", ".join(OBSERVATIONS))
        for name, value in {
            "seeds": self.seeds,
            "targets": self.scene.targets,
            "cap": self.scene.cap,
            "hit radii": len(self.scene.radii),
        }.items():
            whole(name, value)
        if set(LEARNERS) & set(self.methods):
            for observation in ("tip", "goal"):
                TrainingPlan(*self.training(observation), hindsight=self.hindsight)
            if not self.observations:
                raise InputError("observation", (), ", ".join(OBSERVATIONS))

    def units(self) -> list[SearchUnit | LearnerUnit]:
        """Return the work units of the comparison."""
        units: list[SearchUnit | LearnerUnit] = []
        for method in self.methods:
            if method in LEARNERS:
                units += [unit for o in self.observations for unit in self.learner_units(method, o)]
                continue
            units += [
                SearchUnit(
                    scene=self.scene,
                    method=method,
                    seed=seed,
                    first=first,
                    last=min(first + CHUNK, self.scene.targets),
                )
                for seed in range(1 if deterministic(method) else self.seeds)
                for first in range(0, self.scene.targets, CHUNK)
            ]
        return units

    def learner_units(self, method: str, observation: str) -> list[LearnerUnit]:
        """Return the work units of a learner with an observation, one for each seed."""
        episodes, trials, random_episodes = self.training(observation)
        return [
            LearnerUnit(
                scene=self.scene,
                method=method,
                observation=observation,
                seed=seed,
                episodes=episodes,
                trials=trials,
                random_episodes=random_episodes,
                hindsight=self.hindsight,
            )
            for seed in range(self.seeds)
        ]

    def difficulty(self, *, quick: bool = False) -> DifficultyUnit:
        """Return the work unit that finds the fractions of the targets that one strike and random strikes hit."""
        strikes = 500 if quick else min(10_000, 100 * self.scene.targets)
        return DifficultyUnit(scene=self.scene, strikes=strikes)

    def training(self, observation: str) -> tuple[int, int, int]:
        """Return the numbers of episodes, trials per episode, and random episodes for an observation."""
        if observation == "tip" or self.further_episodes is None or self.further_episodes >= self.episodes:
            return self.episodes, self.trials, self.random_episodes
        share = self.further_episodes / self.episodes
        return self.further_episodes, self.trials, math.ceil(self.random_episodes * share)


def deterministic(method: str) -> bool:
    """Whether a method's result does not depend on the seed."""
    name = method.removeprefix("nlopt:")
    return method == "directl" or ("DIRECT" in name and "RAND" not in name)


def compare(
    rollout: CompiledRollout,
    methods: Sequence[str] = ("directl", "cmaes", "gradient"),
    *,
    zone: Zone | None = None,
    targets: int = 12,
    target_seed: int = 0,
    hit_radius: float = HIT_RADIUS,
    max_trials: int = 600,
    **further: Any,
) -> list[Series]:
    """Compare methods by the trials that they need until they hit random targets of a zone (Fig. 6).

    `random` is always added. Learners are trained first; `further` has the length of their training.

    Args:
        rollout: Simulator of the model and controller.
        methods: Methods of `METHODS`. Capital letters, hyphens and underscores make no difference.
        zone: Zone of the targets; None: the paper's disc, in space a ball around the default target.
        targets: Number of targets, the same for all methods.
        target_seed: Seed of the targets.
        hit_radius: Hit radius [m].
        max_trials: Largest number of trials at each target.
        further: `seeds` (1), `observations` of the learners, `episodes`, `trials`, `random_episodes`, `hindsight`, see
            `Comparison`.

    Returns:
        One series for each method, and for a learner one for each way of using its policy.

    Raises:
        InputError: No method has this name, or a number is out of range.
    """
    expect(CompiledRollout, rollout=rollout)
    scene = TargetScene(
        model=rollout.model,
        controller=rollout.controller,
        zone=zone or usual_disc(rollout.model),
        targets=whole("targets", targets),
        target_seed=target_seed,
        radii=(hit_radius,),
        cap=whole("max_trials", max_trials),
        tolerance=rollout.tolerance,
        timestep=rollout.timestep if rollout.tolerance is None else None,
    )
    plan: dict[str, Any] = {"scene": scene, "seeds": 1} | further
    for name, given in {"methods": methods, "observations": further.get("observations", ("goal",))}.items():
        plan[name] = texts(name, given)
    refuse_call("compare", Comparison, **plan)
    comparison = Comparison(**plan)
    with TemporaryDirectory() as folder:
        units = comparison.units()
        return collect(units, Store(Path(folder)).results(units, desc="compare"))
