"""Algorithm 1: train a learner by episodes; a killed run can be resumed with the same result.

At intervals the policy strikes once at each of some held-out goals; the best policy of a training is kept.
"""

from __future__ import annotations

import copy
import io
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from whiptool.errors import InputError
from whiptool.given_files import parsing, whole_file
from whiptool.goals.goals import Goals
from whiptool.rl import hindsight
from whiptool.rl.learner import Learner, OffPolicyLearner, Transitions
from whiptool.rl.policy import EVERY, Best, Policy, Score, score
from whiptool.rl.settings import TrainingPlan
from whiptool.rl.task import StrikeTask
from whiptool.whole_files import write_whole


@dataclass(frozen=True)
class TrainingEpisode:
    """Results of one episode.

    Args:
        number: Number of the episode, from 1.
        strikes: Number of strikes so far.
        mean_reward: Mean reward of its trials (Fig. 7).
        share_hit: Fraction of its trials that hit.
        diverged: Number of strikes that diverged so far.
        losses: Losses by name; empty while nothing is learned.
        held_out: Score of the policy at held-out goals; None in most episodes.
        best: Whether that score is the best so far.
    """

    number: int
    strikes: int
    mean_reward: float
    share_hit: float
    diverged: int
    losses: dict[str, float]
    held_out: Score | None = None
    best: bool = False

    def scalars(self) -> dict[str, float]:
        """Return the values for TensorBoard, by name."""
        whole = {"mean_reward": self.mean_reward, "share_hit": self.share_hit}
        held_out = {} if self.held_out is None else asdict(self.held_out)
        parts = {"loss": self.losses, "held_out": held_out}
        return whole | {f"{part}/{name}": x for part, values in parts.items() for name, x in values.items()}


class Training:
    """A training: learner, task, plan, and its current state.

    Args:
        learner: Learner from `make_learner`, whose generator draws all random numbers.
        task: Task to learn.
        plan: Length of the training.
        held_out: Goals by which the best policy is selected; None: no best policy is kept.

    Raises:
        InputError: Hindsight is requested for a learner without replay buffer, or with an observation without the
            target.
    """

    def __init__(self, learner: Learner, task: StrikeTask, plan: TrainingPlan, held_out: Goals | None = None) -> None:
        if plan.hindsight and (not isinstance(learner, OffPolicyLearner) or task.observation != "goal"):
            raise InputError(
                "hindsight",
                plan.hindsight,
                "0, unless the learner has a replay buffer (sac, td3, ddpg) and the observation is goal",
            )
        self.learner, self.task, self.plan, self.held_out = learner, task, plan, held_out
        self.done = 0
        self.best: Best | None = None
        self.obs = task.reset(task.draw(self._uniform(plan.trials, task.n_uniform)))

    def run(
        self,
        on_episode: Callable[[TrainingEpisode], None] | None = None,
        *,
        episodes: int | None = None,
        max_seconds: float | None = None,
    ) -> list[TrainingEpisode]:
        """Train to the end of the plan, or until `episodes` further episodes or `max_seconds` have passed, if given.

        Returns:
            Results of these episodes.

        Raises:
            Diverged: A loss is not finite.
        """
        last = self.plan.episodes if episodes is None else min(self.plan.episodes, self.done + episodes)
        start, seen = time.monotonic(), []
        while self.done < last and (max_seconds is None or time.monotonic() - start < max_seconds):
            seen.append(self.episode())
            if on_episode is not None:
                on_episode(seen[-1])
        return seen

    def episode(self) -> TrainingEpisode:
        """Make one strike in every lane (sub-environment), update the learner unless strikes are still random, and
        return the results.
        """
        task, lanes = self.task, self.plan.trials
        explore = self.done < self.plan.random_episodes
        seen = self._tensor(task.normalise(self.obs))
        if explore:
            actions = self._tensor(2 * self._uniform(lanes, task.n_act) - 1)
        else:
            actions = self.learner.act(seen)
        struck = actions.numpy().astype(float)
        step = task.step(struck)
        new = Transitions(
            obs=seen,
            action=actions,
            reward=self._tensor(step.reward),
            next_obs=self._tensor(task.normalise(step.obs)),
            terminated=self._tensor(step.hit),
        )
        if self.plan.hindsight:
            self._relabel(struck, self.obs)
        losses = self.learner.learn(new, update=not explore)
        over = step.hit | step.truncated
        fresh = task.draw(self._uniform(lanes, task.n_uniform))
        self.obs = task.renew(step.obs, over, fresh.rows(over))
        self.done += 1
        held_out = self._score()
        return TrainingEpisode(
            number=self.done,
            strikes=self.done * lanes,
            mean_reward=float(step.reward.mean()),
            share_hit=float(step.hit.mean()),
            diverged=task.n_diverged,
            losses=losses,
            held_out=held_out,
            best=held_out is not None and self.best is not None and self.best.episode == self.done,
        )

    def _score(self) -> Score | None:
        """Strike at the held-out goals where it is time to, and keep the policy if it is the best."""
        if self.held_out is None or self.done <= self.plan.random_episodes or self.done % EVERY:
            return None
        found = score(self.learner, self.task, self.held_out)
        if found.better_than(None if self.best is None else self.best.score):
            self.best = Best(self.done, found, copy.deepcopy(self.learner.actor.state_dict()))
        return found

    def policy(self) -> Policy:
        """Return the best policy, or the last if no best policy was stored; its weights are loaded into the learner."""
        if self.best is not None:
            self.learner.actor.load_state_dict(self.best.actor)
        return Policy(self.learner, self.task)

    def _relabel(self, actions: np.ndarray, obs: np.ndarray) -> None:
        """Show the learner the same strikes at other goals (see `hindsight`)."""
        task, learner = self.task, self.learner
        assert isinstance(learner, OffPolicyLearner)
        strikes, width = task.to_strikes(actions), hindsight.uniforms(task.zone, task.arrival)
        _, paths, _ = task.rollout.tip_path(strikes, t_stay=task.t_stay, rate=hindsight.RATE)
        for _ in range(self.plan.hindsight):
            uniform = self._uniform(len(paths), width)
            goals = hindsight.new_goals(paths, task.zone, task.arrival, task.hit_radius, uniform)
            if goals.only_points and not task.limits:
                came = hindsight.judged_by_path(paths, goals)
            else:
                came = hindsight.judged_by_rollout(task, strikes, goals)
            learner.replay.add(
                Transitions(
                    obs=self._tensor(task.normalise(task.with_goals(obs, goals)))[came.known],
                    action=self._tensor(actions)[came.known],
                    reward=self._tensor(task.reward(came.cost, came.hit))[came.known],
                    next_obs=self._tensor(task.normalise(task.observe(came.tip, came.velocity, goals)))[came.known],
                    terminated=self._tensor(came.hit)[came.known],
                )
            )

    def _uniform(self, *shape: int) -> np.ndarray:
        return torch.rand(shape, generator=self.learner.generator, dtype=torch.float64).numpy()

    @staticmethod
    def _tensor(array: np.ndarray) -> Tensor:
        return torch.as_tensor(array, dtype=torch.float32)

    def _identity(self) -> dict:
        """What has to be equal in a file and in the training that takes it up: not for how many episodes it is."""
        settings = {k: list(v) if isinstance(v, tuple) else v for k, v in asdict(self.learner.settings).items()}
        sizes = [self.learner.n_obs, self.learner.n_act]
        name = type(self.learner).__name__
        plan = {name: value for name, value in asdict(self.plan).items() if name != "episodes"}
        same = {"plan": plan, "learner_kind": name, "settings": settings, "sizes": sizes}
        asked = self.task.arrival.table()
        return same if asked is None else {**same, "arrival": asked}  # of points, as checkpoints have always been

    def _lanes(self) -> dict[str, np.ndarray]:
        """What differs between the goals of the lanes, by its name in a checkpoint."""
        goals = self.task.goals
        rows = {"targets": goals.positions, "directions": goals.directions, "sights": goals.sights}
        return {name: x for name, x in rows.items() if x is not None}

    def save(self, path: Path | str) -> None:
        """Write a checkpoint; the previous file is only replaced when the new one is complete.

        Raises:
            OSError: The file cannot be written; the previous one is kept.
        """
        task = self.task
        state = {
            **self._identity(),
            "learner": self.learner.state_dict(),
            "done": self.done,
            "obs": torch.as_tensor(self.obs),
            **{name: torch.as_tensor(rows) for name, rows in self._lanes().items()},
            "counts": torch.as_tensor(task.counts),
            "strikes": [task.n_strikes, task.n_diverged],
        }
        if self.best is not None:
            state["best"] = self.best.table()
        _write(path, state)

    def save_best(self, path: Path | str) -> None:
        """Write the best policy; the previous file is only replaced when the new one is complete.

        Raises:
            OSError: The file cannot be written; the previous one is kept.
        """
        assert self.best is not None
        _write(path, {**self._identity(), **self.best.table()})

    def load(self, path: Path | str) -> None:
        """Restore the state of a checkpoint, or only the policy from a file of a best policy.

        Raises:
            InputError: The file is damaged, or of another plan.
        """
        path = Path(path)
        state = load_checkpoint(path)
        if isinstance(state.get("plan"), dict):
            state["plan"].pop("episodes", None)  # older files have it
        for part, value in self._identity().items():
            if state.get(part) != value:
                raise InputError(str(path), f"{part} {state.get(part)}", f"a checkpoint of {part} {value}")
        if "learner" not in state:
            with parsing(path, "policy"):
                self.best = Best.of_table(state)
                self.learner.actor.load_state_dict(self.best.actor)
            return
        with parsing(path, "checkpoint"):  # of other shapes or without a part
            self.learner.load_state_dict(state["learner"])
            self.done, self.obs = int(state["done"]), state["obs"].numpy()
            rows = {name: state[name].numpy() for name in self._lanes()}
            self.task.goals = replace(self.task.goals, positions=rows.pop("targets"), **rows)
            self.task.counts = state["counts"].numpy()
            self.task.n_strikes, self.task.n_diverged = map(int, state["strikes"])
            self.best = Best.of_table(state["best"]) if "best" in state else None


def _write(path: Path | str, state: dict[str, Any]) -> None:
    """Write tensors and numbers as a whole file."""
    buffer = io.BytesIO()  # PyTorch's error for a full disk is not an OSError
    torch.save(state, buffer)
    write_whole(path, buffer.getvalue())


def load_checkpoint(path: Path) -> dict:
    """Return a checkpoint's tensors and numbers, without executing code in the file.

    Raises:
        InputError: The file does not exist, or is not a checkpoint.
    """
    whole_file(path, "checkpoint")
    try:
        state = torch.load(path, weights_only=True)
        if not isinstance(state, dict):
            raise TypeError(f"it holds a {type(state).__name__}")
        return state
    except Exception as error:  # torch names no exception for what is damaged
        raise InputError(
            "checkpoint", str(path), "a whole file that whiptool train wrote", f"reason: {str(error)[:160]}"
        ) from None
