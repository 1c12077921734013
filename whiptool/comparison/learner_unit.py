"""The work unit of a learner, which is trained once with checkpoints and then strikes at every target."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import numpy as np

from whiptool.comparison.series import MAIN_CONVENTION, MethodUnit
from whiptool.extras import optional
from whiptool.given_files import parsing, read_json
from whiptool.models.numbers import float_array, number
from whiptool.rl.trained import one_torch_thread
from whiptool.whole_files import write_whole
from whiptool.words import counted

if TYPE_CHECKING:
    from whiptool.goals.goals import Goals
    from whiptool.rl.learner import Learner
    from whiptool.rl.task import Judged, StrikeTask

CHECKPOINT_EVERY = 10  # episodes


@dataclass(frozen=True, kw_only=True)
class LearnerUnit(MethodUnit):
    """Work unit that trains a learner once over the zone of its scene and then strikes at every target with its policy.

    For `episodes`, `trials`, `random_episodes` and `hindsight` see `TrainingPlan`, for `reward`
    `whiptool.rl.task.StrikeTask`.
    """

    method: str  # sac, td3, ddpg or ppo
    observation: str  # of the learner
    seed: int  # of its training
    episodes: int = 500
    trials: int = 100
    random_episodes: int = 50
    hindsight: int = 0
    reward: str = "paper"
    settings: tuple[tuple[str, float], ...] = ()  # hyperparameters that differ from the defaults, by name

    @property
    def series(self) -> tuple[str, str, int]:
        """Name of the learner, kind of its observation, and seed."""
        return self.method, self.observation, self.seed

    @property
    def count(self) -> int:
        """Number of targets."""
        return self.scene.targets

    def run(self, folder: Path | None, threads: int | None) -> dict[str, Any]:
        """Train the learner, from the last checkpoint if there is one, then strike at all targets; return the
        results."""
        from whiptool.rl.policy import CONVENTIONS, first_strikes

        scene = self.scene
        with one_torch_thread():
            training, history, note = self.trained(folder, threads)
            task, goals = self._task(scene.radii[0], threads), scene.goals()
            strikes = first_strikes(training.learner, task, goals)
            first_misses = task.judge(strikes, goals).distance
            outcomes = []
            for convention in CONVENTIONS:
                # a policy that misses again and again takes long: tighter radii under the first convention only
                radii = scene.radii if convention == MAIN_CONVENTION else scene.radii[:1]
                training.learner.generator.manual_seed(self.seed)  # whatever was drawn before
                found = trials_within(
                    training.learner,
                    self._task(min(radii), threads),
                    goals,
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
        from whiptool.rl.task import StrikeTask

        scene = self.scene
        return StrikeTask(
            scene.rollout(threads),
            scene.region(radius),
            observation=self.observation,
            reward=self.reward,
            t_stay=scene.t_stay,
        )

    def _fresh(self, threads: int | None):
        """A learner that knows nothing, and its training."""
        torch = optional("torch", self.method)

        from whiptool.rl.actor_critic import make_learner
        from whiptool.rl.learner import OffPolicyLearner
        from whiptool.rl.settings import TrainingPlan, settings_for
        from whiptool.rl.training import Training

        task = self._task(self.scene.radii[0], threads)
        generator = torch.Generator().manual_seed(self.seed)
        learner = make_learner(self.method, settings_for(self.method, **dict(self.settings)), task, generator)
        relabels = isinstance(learner, OffPolicyLearner) and self.observation == "goal"
        plan = TrainingPlan(self.episodes, self.trials, self.random_episodes, self.hindsight if relabels else 0)
        return Training(learner, task, plan)

    def trained(self, folder: Path | None, threads: int | None) -> tuple[Any, dict[str, Any], str]:
        """Return the learner's training, resumed from the checkpoint in a folder if there is one; its history, with
        `rewards` (mean of each episode) and `seconds`; and a note if it diverged, else "": then the learner is that of
        the last checkpoint.
        """
        from whiptool.rl.learner import Diverged

        with Checkpoint.within(folder, self.key) as checkpoint:
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
                note = f"training ended after {counted(training.done, 'episode')}: {error}"
            return training, history, note


def trials_within(
    learner: Learner,
    task: StrikeTask,
    targets: np.ndarray | Goals,
    radii: tuple[float, ...],
    *,
    cap: int,
    convention: str,
) -> dict[float, tuple[np.ndarray, np.ndarray]]:
    """For each hit radius [m], return trials to the first hit of the B targets, (B,), `cap` without a hit, and whether
    each was hit, (B,), see `trials_to_hit`. The strikes do not depend on the radius; the task's radius is the smallest.
    """
    from whiptool.rl.policy import trials_to_hit

    goals = replace(task.as_goals(targets), hit_radius=task.hit_radius)
    count = len(goals.positions)
    found = {radius: (np.full(count, cap), np.zeros(count, bool)) for radius in radii}
    made = np.zeros(count, int)  # strikes at each

    def on_strikes(lanes: np.ndarray, judged: Judged) -> None:
        made[lanes] += 1
        for radius, (trials, hit) in found.items():
            within = replace(goals.rows(lanes), hit_radius=radius)
            near = within.hit_by(judged.approach) & ~judged.lost & ~hit[lanes]
            for i in np.flatnonzero(near & ~judged.hit) if task.limits.of_candidates else ():
                near[i] = task.within_limits(judged.strikes[i])  # the task checks whole trajectories of hits only
            new = lanes[near]
            trials[new], hit[new] = made[new], True

    trials_to_hit(learner, task, goals, cap=cap, convention=convention, on_strikes=on_strikes)
    return found


class Checkpoint:
    """Checkpoint of a training, in the file `path`, and of its history, in another."""

    def __init__(self, path: Path) -> None:
        self.path, self.history = path, path.with_suffix(".history.json")

    @classmethod
    @contextmanager
    def within(cls, folder: Path | None, name: str) -> Iterator[Checkpoint]:
        """Yield a checkpoint in `folder`, or in a temporary folder if `folder` is None or does not exist."""
        if folder is not None and folder.is_dir():
            yield cls(folder / f"{name}.pt")
            return
        with TemporaryDirectory() as temporary:
            yield cls(Path(temporary) / f"{name}.pt")

    def load(self, training) -> dict[str, Any]:
        """Restore a training in place, and return its history: mean reward of every episode so far, and seconds."""
        from whiptool.rl.training import load_checkpoint

        if self.path.exists() and self.history.exists():
            with parsing(self.history, "JSON"):
                history = read_json(self.history)
                rewards = float_array("rewards", history["rewards"]).tolist()
                seconds = number("seconds", history["seconds"])
            if len(rewards) >= int(load_checkpoint(self.path)["done"]):
                training.load(self.path)
                return {"rewards": rewards[: training.done], "seconds": seconds}
        return {"rewards": [], "seconds": 0.0}

    def save(self, training, history: dict[str, Any]) -> None:
        """Write the history, then the training; if only the history is written, `load` drops its excess entries."""
        write_whole(self.history, json.dumps(history, allow_nan=False))
        training.save(self.path)
