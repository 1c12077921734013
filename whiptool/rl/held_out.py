"""How good a policy is at goals that it is not trained at, by which a training keeps the best of its policies."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from whiptool.goals.arrival_rule import sample_goals
from whiptool.goals.goals import Goals
from whiptool.rl.learner import Learner
from whiptool.rl.policy import first_strikes
from whiptool.rl.task import StrikeTask

EVERY, GOALS = 5, 100  # episodes between two scores; goals of each


@dataclass(frozen=True)
class Score:
    """Result of a policy's first strikes, one at each held-out goal.

    Args:
        share_hit: Fraction of the goals that are hit, 0 to 1.
        mean_cost: Mean cost of the strikes [m], see `Goals.cost`; for goals that are points, the mean miss distance.
    """

    share_hit: float
    mean_cost: float

    def better_than(self, other: Score | None) -> bool:
        """Whether it has more hits than another score, or as many with a smaller cost."""
        return other is None or (self.share_hit, -self.mean_cost) > (other.share_hit, -other.mean_cost)


@dataclass(frozen=True)
class Best:
    """The best policy of a training so far.

    Args:
        episode: Episode after which it was found.
        score: Score at the held-out goals.
        actor: State of the actor network.
    """

    episode: int
    score: Score
    actor: dict[str, Any]

    def table(self) -> dict[str, Any]:
        """Return it as a dict, as it is stored in files."""
        return {"episode": self.episode, "score": asdict(self.score), "actor": self.actor}

    @classmethod
    def of_table(cls, table: dict[str, Any]) -> Best:
        """Return the policy that `table` described."""
        return cls(int(table["episode"]), Score(**table["score"]), table["actor"])


def held_out_goals(task: StrikeTask, seed: int) -> Goals:
    """Return goals in a task's zone, different from those drawn with the same seed for tests."""
    return sample_goals(task.zone, task.arrival, task.hit_radius, GOALS, np.random.default_rng([seed, 1]))


def score(learner: Learner, task: StrikeTask, goals: Goals) -> Score:
    """Return the score of a policy's mean actions at goals; no random numbers are drawn, and the task is not
    changed."""
    judged = task.judge(first_strikes(learner, task, goals), goals)
    return Score(float(judged.hit.mean()), float(judged.cost.mean()))
