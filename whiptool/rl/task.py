"""The task of the learners: strike at targets of a zone, given an observation (Algorithm 1).

One step is one strike. Several lanes (sub-environments) run in parallel, each with a goal: a target and, if required,
direction and speed of the tip's arrival. Their strikes are simulated as one batch. A lane keeps its goal until it is
hit (terminated) or after `strikes` strikes (truncated).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from whiptool.dynamics.posture import start_posture
from whiptool.errors import InputError
from whiptool.goals.arrival_rule import GoalRegion, as_region
from whiptool.goals.goals import Goals
from whiptool.goals.zone import Zone, check_fits
from whiptool.limits.all_limits import AllLimits, distance_beyond, limits_given
from whiptool.limits.limits import Limits
from whiptool.models.kinematics import joint_points
from whiptool.models.numbers import number, whole
from whiptool.models.parameters import Model
from whiptool.models.strike import T_STAY, StrikeBounds, default_bounds
from whiptool.models.trajectory import Approach, Trajectory
from whiptool.rollout.compiled import CompiledRollout

OBSERVATIONS = ("tip", "relative", "goal")
OLD_OBSERVATIONS = {"paper": "tip"}  # names that older runs hold, and what they are called now
SPEED_SCALE = 10.0  # [m/s], brings the tip's velocity to the size of one for networks


def reward(cost: np.ndarray, hit: np.ndarray) -> np.ndarray:
    """Return the rewards (Eq. 17) of strikes, any shape: 50 for a hit, else -5 d within 0.1 m and -10 d farther away.

    A hit radius other than the paper's 0.06 m only changes which strikes are hits.

    Args:
        cost: Miss distance d [m], or `Goals.cost` if a direction or speed is required.
        hit: Whether each strike hits, see `Goals.hit`.
    """
    return np.where(hit, 50.0, np.where(cost <= 0.1, -5.0, -10.0) * cost)  # Eq. 17


def log_reward(cost: np.ndarray, hit_radius: float) -> np.ndarray:
    """Return rewards -log(cost / hit radius), with the ratio at least 0.3, which rank near misses better than
    `reward`."""
    return -np.log(np.maximum(cost / hit_radius, 0.3))


REWARDS = ("paper", "log")


def resting_points(model: Model, bounds: StrikeBounds) -> np.ndarray:
    """Return the positions [m] of the m joints and nodes before the first strike, in d dimensions, (m, d).

    In the plane the arm hangs straight down; in space it is in the middle of the box of start postures.
    """
    if model.dimension == 2:
        return joint_points(model, np.zeros(model.n))
    middle = np.mean(bounds.box, axis=0)[None, : model.arm.n]
    return joint_points(model, start_posture(model, middle)[0])


@dataclass(frozen=True)
class Judged:
    """Results of B strikes, each at its own goal.

    Args:
        strikes: Strike vectors, (B, n_act).
        approach: Closest approaches of the strikes.
        distance: Miss distances [m], (B,); a penalty for strikes that diverged or exceed the limits.
        cost: `Goals.cost` [m], (B,), with the same penalty; for goals without direction and speed, the distance.
        hit: Whether each strike hits, (B,), see `Goals.hit`.
        diverged: Whether a strike diverged, (B,).
        refused: Limit that a strike exceeds, as in `Outcome.refused`, (B,); empty: none.
    """

    strikes: np.ndarray
    approach: Approach
    distance: np.ndarray
    cost: np.ndarray
    hit: np.ndarray
    diverged: np.ndarray
    refused: np.ndarray

    @property
    def lost(self) -> np.ndarray:
        """Whether a strike has no true miss distance because it diverged or was refused, (B,)."""
        return self.diverged | (self.refused != "")


@dataclass(frozen=True)
class TaskStep:
    """Result of one strike in each of B lanes (sub-environments).

    Args:
        obs: Observation after the strike, (B, n_obs).
        reward: Reward, (B,).
        truncated: Whether a lane's number of strikes is used up without a hit, (B,).
        judged: Outcomes of the strikes.
    """

    obs: np.ndarray
    reward: np.ndarray
    truncated: np.ndarray
    judged: Judged

    @property
    def hit(self) -> np.ndarray:
        """Whether each lane's goal was hit, which terminates its episode, (B,)."""
        return self.judged.hit

    @property
    def approach(self) -> Approach:
        """The strikes' closest approaches."""
        return self.judged.approach


class StrikeTask:
    """The task of a learner, in a batch of lanes (sub-environments) with one goal each.

    Args:
        rollout: Simulator.
        zone: Region of the goals: zone, required arrival of the tip, and hit radius; or a zone of targets that are
            points. None: the paper's disc, in space a ball.
        observation: `tip`: tip position and velocity at the closest approach of the last strike; `relative`: the same
            with the position relative to the target; `goal`: as `tip`, with target position and, if required,
            direction. Before the first strike the tip is at rest, see `resting_points`.
        reward: `paper` (Eq. 17) or `log` (see `log_reward`).
        strikes: Number of strikes at one target after which an episode is truncated.
        t_stay: Time after the movement during which the tip is followed [s].
        bounds: Box of the strikes, onto which actions in [-1, 1] are mapped.
        limits: Limits that strikes have to keep, as in `Objective`: the box is reduced to the position limits, strikes
            are shortened so that the commanded path keeps its limits, and a strike that still exceeds a limit is
            refused: it does not count as a hit, and its miss distance is a penalty.

    Raises:
        InputError: The observation is unknown, or a number is out of range.
    """

    def __init__(
        self,
        rollout: CompiledRollout,
        zone: Zone | GoalRegion | None = None,
        *,
        observation: str = "goal",
        reward: str = "paper",
        strikes: int = 100,
        t_stay: float = T_STAY,
        bounds: StrikeBounds | None = None,
        limits: Limits | Sequence[Limits] | Literal["default"] | None = "default",
    ) -> None:
        if observation not in OBSERVATIONS:
            now = OLD_OBSERVATIONS.get(observation)
            raise InputError("observation", observation, ", ".join(OBSERVATIONS), f"it is called {now}" if now else "")
        if reward not in REWARDS:
            raise InputError("reward", reward, ", ".join(REWARDS))
        self._reward = reward
        d = rollout.model.dimension
        self.rollout, self.observation = rollout, observation
        self.region = as_region(zone, rollout.model)
        self.zone, self.arrival = self.region.zone, self.region.rule
        self.hit_radius = check_fits(self.zone, rollout.model, self.region.hit_radius)
        self.arrival.check_dimension(rollout.model)
        self.strikes, self.t_stay = whole("strikes", strikes), number("t_stay", t_stay, low=0)
        given = limits_given(limits, rollout.model, prescribed=rollout.prescribed)
        self.limits = AllLimits(given, by_joints=rollout.space.kind == "joint")
        self.bounds = self.limits.narrowed(bounds or default_bounds(rollout.model.arm))
        self.lower, self.upper = self.bounds.box
        self.n_act = len(self.lower)
        self.n_obs = 2 * d + (d * (1 + self.arrival.directed) if observation == "goal" else 0)
        self.resting = resting_points(rollout.model, self.bounds)
        self.resting_tip = self.resting[-1]
        self.n_strikes = self.n_diverged = 0
        self.goals, self.counts = self.draw(np.empty((0, self.n_uniform))), np.empty(0, int)
        farthest = float(np.abs(self.zone.box).max())
        self.penalty = math.hypot(rollout.model.farthest_miss((farthest,) * d), self.goals.largest_cost)

    @property
    def targets(self) -> np.ndarray:
        """Positions of the lanes' targets, (B, d) [m]."""
        return self.goals.positions

    @property
    def n_uniform(self) -> int:
        """Number of uniform random numbers from which a goal is drawn."""
        return self.zone.dimension + 1 + self.arrival.drawn

    def draw(self, uniform: np.ndarray) -> Goals:
        """Return goals from uniform random numbers in [0, 1), (B, n_uniform)."""
        of_place, of_arrival = np.split(uniform, [self.zone.dimension + 1], axis=1)
        return self.arrival.goals(self.zone.place(of_place), self.hit_radius, of_arrival)

    def as_goals(self, targets: np.ndarray | Goals) -> Goals:
        """Return goals unchanged, or positions (B, d) [m] as goals with the task's required arrival.

        Raises:
            InputError: The task draws directions, and only positions are given.
        """
        if isinstance(targets, Goals):
            return targets
        return self.arrival.goals_at(np.array(targets, float), self.hit_radius)

    def reset(self, targets: np.ndarray | Goals) -> np.ndarray:
        """Give every lane a goal, see `as_goals`, and return the observations before the first strike (B, n_obs)."""
        self.goals = self.as_goals(targets)
        self.counts = np.zeros(len(self.targets), int)
        return self.first_look(self.goals)

    def renew(self, obs: np.ndarray, lanes: np.ndarray, targets: np.ndarray | Goals) -> np.ndarray:
        """Give one of the new `targets` to each lane that is True in `lanes`, (B,), and return `obs` (B, n_obs) with
        the observations of these lanes before their first strikes.
        """
        new = self.as_goals(targets)
        self.goals, self.counts[lanes] = self.goals.with_rows(lanes, new), 0
        obs = obs.copy()
        obs[lanes] = self.first_look(new)
        return obs

    def keep(self, lanes: np.ndarray) -> None:
        """Continue only with the lanes that are True in `lanes`, (B,)."""
        self.goals, self.counts = self.goals.rows(lanes), self.counts[lanes]

    def step(self, actions: np.ndarray) -> TaskStep:
        """Make one strike in every lane by actions (B, n_act), which are clipped to [-1, 1]; return the results."""
        judged = self.judge(self.to_strikes(actions), self.goals)
        self.n_strikes += len(actions)
        self.n_diverged += int(judged.diverged.sum())
        self.counts += 1
        return TaskStep(
            obs=self.look(judged, self.goals),
            reward=self.reward(judged.cost, judged.hit),
            truncated=~judged.hit & (self.counts >= self.strikes),
            judged=judged,
        )

    def judge(self, strikes: np.ndarray, goals: Goals) -> Judged:
        """Simulate strikes (B, n_act), and return their results at B goals."""
        approach = self.rollout.approach(strikes, goals.positions, t_stay=self.t_stay)
        wild, hit = approach.diverged | ~np.isfinite(approach.distance), goals.hit_by(approach)
        candidates = np.flatnonzero(hit & ~wild)
        beyond, by = self.limits.judged(strikes, approach, self._trajectory, candidates=candidates)
        refused = (beyond > 0) & ~wild
        penalty = distance_beyond(self.penalty, np.where(refused, beyond, 0.0))
        distance = np.where(wild | refused, penalty, approach.distance)
        velocity = np.where((wild | refused)[:, None], 0.0, approach.velocity)
        cost = np.where(wild | refused, penalty, goals.cost(distance, velocity))
        return Judged(strikes, approach, distance, cost, hit & ~refused, wild, np.where(refused, by, ""))

    def within_limits(self, strike: np.ndarray) -> bool:
        """Whether the whole trajectory of a strike (n_act,) keeps the limits."""
        return not self.limits or self.limits.violation(self._trajectory(strike)) <= 0

    def _trajectory(self, strike: np.ndarray) -> Trajectory:
        return self.rollout.trajectory(self.rollout.space.strike(strike), t_stay=self.t_stay)

    def reward(self, cost: np.ndarray, hit: np.ndarray) -> np.ndarray:
        """Return the task's rewards for costs [m] and hits, any shape; see `reward` and `log_reward`."""
        return reward(cost, hit) if self._reward == "paper" else log_reward(cost, self.hit_radius)

    def to_strikes(self, actions: np.ndarray) -> np.ndarray:
        """Return the strike vectors of actions, (B, n_act)."""
        return self.admissible(self.lower + (np.clip(actions, -1, 1) + 1) / 2 * (self.upper - self.lower))

    def admissible(self, strikes: np.ndarray) -> np.ndarray:
        """Return strikes (B, n_act), shortened so that commanded paths keep their limits."""
        return self.limits.admissible(strikes, self.bounds) if self.limits.commands else strikes

    def first_look(self, targets: np.ndarray | Goals) -> np.ndarray:
        """Return the observations before the first strike at each goal, (B, n_obs)."""
        goals = self.as_goals(targets)
        tip = np.broadcast_to(self.resting_tip, goals.positions.shape)
        return self.observe(tip, np.zeros_like(tip), goals)

    def look(self, judged: Judged, targets: np.ndarray | Goals) -> np.ndarray:
        """Return the observations after strikes, (B, n_obs); for strikes that diverged or were refused, the
        observations before the first strike.
        """
        goals = self.as_goals(targets)
        obs = self.observe(judged.approach.tip, judged.approach.velocity, goals)
        wild = judged.lost | ~np.isfinite(obs).all(axis=1)
        obs[wild] = self.first_look(goals.rows(wild))
        return obs

    def observe(self, tip: np.ndarray, velocity: np.ndarray, goals: Goals) -> np.ndarray:
        """Return the observations (B, n_obs) for tip positions [m] and velocities [m/s], (B, d) each."""
        where = tip - goals.positions if self.observation == "relative" else tip
        return np.concatenate([where, velocity, *self._shown(goals)], axis=1)

    def with_goals(self, obs: np.ndarray, goals: Goals) -> np.ndarray:
        """Return observations of the kind `goal` (B, n_obs) with other goals inserted."""
        return np.concatenate([obs[:, : 2 * self.zone.dimension], *self._shown(goals)], axis=1)

    def _shown(self, goals: Goals) -> list[np.ndarray]:
        """What the observation shows of goals: nothing, or places, and directions if they are asked for."""
        parts = [goals.positions, goals.directions] if self.observation == "goal" else []
        return [part for part in parts if part is not None]

    def normalise(self, obs: np.ndarray) -> np.ndarray:
        """Return observations (B, n_obs) scaled for networks: targets by the zone's centre and half width, tip
        positions by the zone's centre and largest width (at least 1 m), velocities by 10 m/s.
        """
        lower, upper = self.zone.box
        centre, half = (lower + upper) / 2, (upper - lower) / 2
        size = max(1.0, 2 * float(half.max()))  # tips come from everywhere
        d = len(centre)
        where, velocity, target, direction = np.split(obs, [d, 2 * d, 3 * d], axis=1)
        parts = [where / size if self.observation == "relative" else (where - centre) / size, velocity / SPEED_SCALE]
        if self.observation == "goal":
            parts += [(target - centre) / half, direction]
        return np.concatenate(parts, axis=1)
