"""The work units of a comparison: each is a pure function of its specification, with seeds of its own.

So it does not matter where, beside what, or in which order they are worked, and what is done need not be done again.
"""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Protocol

import numpy as np

from whiptool.impedance import Controller
from whiptool.models import CompiledRollout, Model
from whiptool.models.compiled import TIMESTEP
from whiptool.objective import T_STAY
from whiptool.runs import write_whole
from whiptool.strike import default_bounds
from whiptool.zone import Disc, Zone, sample

CHECKPOINT_EVERY = 10  # episodes
MAIN_CONVENTION = "mean-first"  # of whiptool.rl.policy


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
        """The simulator."""
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
        """Method, seed, targets."""
        return f"{self.task}{self.series.replace(':', '-')}-seed{self.seed}-targets{self.first}-{self.last}"

    def run(self, folder: Path | None, threads: int | None) -> dict[str, Any]:
        """Search."""
        from whiptool.objective import Objective, Target
        from whiptool.optimizers import search
        from whiptool.optimizers.library import StrikeLibrary, library_search, warm_search

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


@dataclass(frozen=True, kw_only=True)
class LearnerUnit:
    """A learner, trained once over the zone, that then strikes at every target with its policy.

    Args:
        scene: See there.
        method: sac, td3, ddpg or ppo.
        observation: What it sees.
        seed: Of its training.
        episodes, trials, random_episodes, hindsight: See `whiptool.rl.training.Plan`.
        reward: See `whiptool.rl.task.StrikeTask`.
        settings: Hyperparameters other than the usual ones, by name.
        task: Put before the name, where a folder holds several tasks.
    """

    scene: Scene
    method: str
    observation: str
    seed: int
    episodes: int = 500
    trials: int = 100
    random_episodes: int = 50
    hindsight: int = 0
    reward: str = "paper"
    settings: tuple[tuple[str, float], ...] = ()
    task: str = ""

    @property
    def series(self) -> str:
        """What it is called in a table."""
        return self.method

    @property
    def name(self) -> str:
        """Method, observation, seed."""
        return f"{self.task}{self.method}-{self.observation}-seed{self.seed}"

    def run(self, folder: Path | None, threads: int | None) -> dict[str, Any]:
        """Train, from the last checkpoint if there is one, and strike."""
        from whiptool.comparison.policy_trials import trials_within
        from whiptool.rl.policy import CONVENTIONS

        scene = self.scene
        with one_torch_thread():
            training, history, note = self.trained(folder, threads)
            task, points = self._task(scene.radii[0], threads), scene.points()
            seen = _tensor(task.normalise(task.reset(points)))
            strikes = task.to_strikes(training.learner.act(seen, deterministic=True).numpy().astype(float))
            _, first_misses = task.approach(strikes, points)
            outcomes = []
            for convention in CONVENTIONS:
                # a policy that misses again and again takes long: tighter radii under the first convention only
                radii = scene.radii if convention == MAIN_CONVENTION else scene.radii[:1]
                training.learner.generator.manual_seed(self.seed)  # whatever was drawn before
                found = trials_within(
                    training.learner,
                    self._task(min(radii), threads),
                    points,
                    radii,
                    cap=scene.cap,
                    convention=convention,
                )
                outcomes += [
                    {"convention": convention, "hit_radius": radius, "trials": trials.tolist(), "hit": hit.tolist()}
                    for radius, (trials, hit) in found.items()
                ]
        return {
            "outcomes": outcomes,
            "training_trials": training.done * self.trials,
            "n_diverged": training.task.n_diverged,
            "wall_time": history["seconds"],
            "note": note,
            "rewards": history["rewards"],
            "first_strikes": strikes.tolist(),
            "first_misses": first_misses.tolist(),
        }

    def _task(self, radius: float, threads: int | None):
        from whiptool.comparison.policy_trials import RecordedTask

        scene = self.scene
        return RecordedTask(
            scene.rollout(threads),
            scene.zone,
            observation=self.observation,
            reward=self.reward,
            hit_radius=radius,
            t_stay=scene.t_stay,
        )

    def _fresh(self, threads: int | None):
        """A learner that knows nothing, and its training."""
        import torch

        from whiptool.rl.learner import OffPolicyLearner
        from whiptool.rl.settings import settings_for
        from whiptool.rl.training import Plan, Training, make_learner

        task = self._task(self.scene.radii[0], threads)
        generator = torch.Generator().manual_seed(self.seed)
        learner = make_learner(self.method, settings_for(self.method, **dict(self.settings)), task, generator)
        relabels = isinstance(learner, OffPolicyLearner) and self.observation == "goal"
        plan = Plan(self.episodes, self.trials, self.random_episodes, self.hindsight if relabels else 0)
        return Training(learner, task, plan)

    def trained(self, folder: Path | None, threads: int | None) -> tuple[Any, dict[str, Any], str]:
        """The training at its end, its mean rewards and seconds, and what there is to say about it."""
        from whiptool.rl.learner import Diverged

        with Checkpoint.within(folder, self.name) as checkpoint:
            training, note = self._fresh(threads), ""
            history = checkpoint.load(training)
            try:
                while training.done < training.plan.episodes:
                    start = time.monotonic()
                    history["rewards"] += [e.mean_reward for e in training.run(episodes=CHECKPOINT_EVERY)]
                    history["seconds"] += time.monotonic() - start
                    checkpoint.save(training, history)
            except Diverged as error:  # strike with what it knew before
                training = self._fresh(threads)
                history = checkpoint.load(training)
                note = f"training ended after {training.done} episodes: {error}"
            return training, history, note


class Checkpoint:
    """A training and its history, in two files.

    Args:
        path: Of the training.
    """

    def __init__(self, path: Path) -> None:
        self.path, self.history = path, path.with_suffix(".history.json")

    @classmethod
    @contextmanager
    def within(cls, folder: Path | None, name: str) -> Iterator[Checkpoint]:
        """In a folder; where there is none, in one that is gone afterwards."""
        if folder is not None and folder.is_dir():
            yield cls(folder / f"{name}.pt")
            return
        with TemporaryDirectory() as temporary:
            yield cls(Path(temporary) / f"{name}.pt")

    def load(self, training) -> dict[str, Any]:
        """Set a training to where it was; mean reward of every episode so far, and seconds."""
        from whiptool.rl.training import load_checkpoint

        if self.path.exists() and self.history.exists():
            history = json.loads(self.history.read_text(encoding="utf-8"))
            if len(history["rewards"]) >= int(load_checkpoint(self.path)["done"]):
                training.load(self.path)
                return {**history, "rewards": history["rewards"][: training.done]}
        return {"rewards": [], "seconds": 0.0}

    def save(self, training, history: dict[str, Any]) -> None:
        """The history first: what it holds beyond the training is made again."""
        write_whole(self.history, json.dumps(history))
        training.save(self.path)

    def remove(self) -> None:
        """Both files."""
        self.path.unlink(missing_ok=True)
        self.history.unlink(missing_ok=True)


@contextmanager
def one_torch_thread() -> Iterator[None]:
    """Sums come out differently in their last digits with another number of threads."""
    import torch

    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)


def _tensor(array: np.ndarray):
    import torch

    return torch.as_tensor(array, dtype=torch.float32)
