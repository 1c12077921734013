"""A comparison of methods, observations and seeds as units of work; and a comparison in memory, for notebooks."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from tempfile import TemporaryDirectory

from whiptool.comparison.learner_unit import LearnerUnit
from whiptool.comparison.search_unit import SearchUnit
from whiptool.comparison.series import Series, collect
from whiptool.comparison.target_scene import DifficultyUnit, TargetScene
from whiptool.comparison.units import Store
from whiptool.errors import InputError, expect
from whiptool.goals.arrival_rule import GoalRegion, as_region
from whiptool.goals.zone import Zone
from whiptool.models.numbers import texts, whole
from whiptool.optimizers import find_method
from whiptool.rl.settings import SETTINGS, TrainingPlan
from whiptool.rl.task import OBSERVATIONS
from whiptool.rollout.compiled import CompiledRollout
from whiptool.words import method_name

LEARNERS = tuple(SETTINGS)
PAPER_METHODS = ("directl", "ga", *LEARNERS)  # Fig. 6
CHUNK = 50  # targets of a unit of searches


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """Definition of a comparison: scene, methods, observations, seeds and training.

    Args:
        scene: Model, targets, hit radii and largest number of trials.
        methods: Methods of `whiptool.optimizers`; `random` is always added.
        observations: Observations of the learners.
        seeds: Number of seeds 0, 1, ...; a deterministic method gets one.
        plan: Length of a learner's training.
        further_episodes: Number of training episodes with observations other than `tip`, at most `plan.episodes`; None:
            as many as with `tip`. The number of random episodes is reduced in proportion.

    Raises:
        InputError: A name or a number is not allowed.
    """

    scene: TargetScene
    methods: tuple[str, ...] = PAPER_METHODS
    observations: tuple[str, ...] = ("goal",)
    seeds: int = 3
    plan: TrainingPlan = field(default_factory=TrainingPlan)
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
                self.training(observation)
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
        plan = asdict(self.training(observation))
        return [
            LearnerUnit(scene=self.scene, method=method, observation=observation, seed=seed, **plan)
            for seed in range(self.seeds)
        ]

    def difficulty(self, *, quick: bool = False) -> DifficultyUnit:
        """Return the work unit that finds the fractions of the targets that one strike and random strikes hit."""
        strikes = 500 if quick else min(10_000, 100 * self.scene.targets)
        return DifficultyUnit(scene=self.scene, strikes=strikes)

    def training(self, observation: str) -> TrainingPlan:
        """Return the length of a learner's training for an observation."""
        plan, further = self.plan, self.further_episodes
        if observation == "tip" or further is None or further >= plan.episodes:
            return plan
        share = further / plan.episodes
        return replace(plan, episodes=further, random_episodes=math.ceil(plan.random_episodes * share))


def deterministic(method: str) -> bool:
    """Whether a method's result does not depend on the seed."""
    name = method.removeprefix("nlopt:")
    return method == "directl" or ("DIRECT" in name and "RAND" not in name)


def compare(
    rollout: CompiledRollout,
    methods: Sequence[str] = ("directl", "cmaes", "gradient"),
    *,
    zone: Zone | GoalRegion | None = None,
    targets: int = 12,
    max_trials: int = 600,
    seeds: int = 1,
    observations: Sequence[str] = ("goal",),
    plan: TrainingPlan | None = None,
) -> list[Series]:
    """Compare methods by the trials that they need until they hit random targets of a zone (Fig. 6).

    `random` is always added. Learners are trained first. `Comparison` has further options.

    Args:
        rollout: Simulator of the model and controller.
        methods: Methods of `METHODS`. Capital letters, hyphens and underscores make no difference.
        zone: Zone of the targets, or region of goals with hit radius and required arrival; None: the paper's disc, in
            space a ball around the default target.
        targets: Number of targets, the same for all methods.
        max_trials: Largest number of trials at each target.
        seeds: Number of seeds of each method.
        observations: Observations of the learners.
        plan: Length of a learner's training; None: that of the paper.

    Returns:
        One series for each method, and for a learner one for each way of using its policy.

    Raises:
        InputError: No method has this name, or a number is out of range.
    """
    expect(CompiledRollout, rollout=rollout)
    expect(TrainingPlan, type(None), plan=plan)
    region = as_region(zone, rollout.model)
    scene = TargetScene(
        model=rollout.model,
        controller=rollout.controller,
        zone=region.zone,
        arrival=region.rule,
        targets=whole("targets", targets),
        radii=(region.hit_radius,),
        cap=whole("max_trials", max_trials),
        tolerance=rollout.tolerance,
        timestep=rollout.timestep if rollout.tolerance is None else None,
    )
    names = {"methods": texts("methods", methods), "observations": texts("observations", observations)}
    comparison = Comparison(scene=scene, seeds=seeds, plan=plan or TrainingPlan(), **names)
    with TemporaryDirectory() as folder:
        units = comparison.units()
        return collect(units, Store(Path(folder)).results(units, desc="compare"))
