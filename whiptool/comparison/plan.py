"""Which methods, observations and seeds are compared, cut into units."""

from __future__ import annotations

import math
from dataclasses import dataclass

from whiptool.comparison.difficulty import DifficultyUnit
from whiptool.comparison.learner_unit import LearnerUnit
from whiptool.comparison.scene import Scene
from whiptool.comparison.search_unit import SearchUnit
from whiptool.errors import InputError
from whiptool.models.parameters import whole
from whiptool.rl.settings import TrainingPlan
from whiptool.words import method_name

PAPER_METHODS = ("directl", "ga", "sac", "td3", "ddpg", "ppo")  # Fig. 6
LEARNERS = ("sac", "td3", "ddpg", "ppo")
OBSERVATIONS = ("tip", "relative", "goal")
CHUNK = 50  # targets of a unit of searches


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """What is compared.

    Args:
        scene: Model, targets, hit radii, cap.
        methods: Methods of `whiptool.optimizers`; `random` is always among them.
        observations: Observations of the learners.
        seeds: Number of seeds, 0, 1, ...; one for what is deterministic.
        episodes, trials, random_episodes, hindsight: Training, see `whiptool.rl.training.TrainingPlan`.
        further_episodes: Episodes under observations other than `tip`; None for as many, which is the most.
            Fewer have fewer random ones in proportion.

    Raises:
        InputError: A name or a number is not allowed.
    """

    scene: Scene
    methods: tuple[str, ...] = PAPER_METHODS
    observations: tuple[str, ...] = ("goal",)
    seeds: int = 3
    episodes: int = 500
    trials: int = 100
    random_episodes: int = 50
    hindsight: int = 0
    further_episodes: int | None = None

    def __post_init__(self) -> None:
        from whiptool.optimizers import find_method

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
        """What there is to do."""
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
        """One for each seed."""
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
        """What one strike, and random ones, hit of its targets."""
        strikes = 500 if quick else min(10_000, 100 * self.scene.targets)
        return DifficultyUnit(scene=self.scene, strikes=strikes)

    def training(self, observation: str) -> tuple[int, int, int]:
        """Episodes, trials in each, and how many episodes are random, under an observation."""
        if observation == "tip" or self.further_episodes is None or self.further_episodes >= self.episodes:
            return self.episodes, self.trials, self.random_episodes
        share = self.further_episodes / self.episodes
        return self.further_episodes, self.trials, math.ceil(self.random_episodes * share)


def deterministic(method: str) -> bool:
    """Whether a seed changes nothing."""
    name = method.removeprefix("nlopt:")
    return method == "directl" or ("DIRECT" in name and "RAND" not in name)
