"""The task that learners learn: strike at targets of a zone, seeing what an observation shows (Algorithm 1).

One step is one strike. Many lanes run side by side, each with its own target, their strikes rolled out as one batch. A
lane keeps its target until it is hit (terminated) or struck at `strikes` times (truncated).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from whiptool.dynamics.posture import start_posture
from whiptool.errors import InputError
from whiptool.models.parameters import Model, number, whole
from whiptool.models.strike import T_STAY, StrikeBounds, default_bounds
from whiptool.rollout.compiled import CompiledRollout
from whiptool.rollout.trajectory import Approach, joint_points
from whiptool.target import HIT_RADIUS
from whiptool.zone import Zone, check_dimension, usual_disc

OBSERVATIONS = ("paper", "relative", "goal")
SPEED_SCALE = 10.0  # [m/s], brings the tip's velocity to the size of one for networks


def reward(distance: np.ndarray, hit_radius: float) -> np.ndarray:
    """Eq. 17 for miss distances d [m]: 50 for a hit, -5 d within 0.1 m, -10 d farther away; any shape.

    A hit radius other than the paper's 0.06 m moves the first threshold only.
    """
    return np.where(distance <= hit_radius, 50.0, np.where(distance <= 0.1, -5.0, -10.0) * distance)  # Eq. 17


def log_reward(distance: np.ndarray, hit_radius: float) -> np.ndarray:
    """-log of the miss distance in hit radii, no better than a third of one: says how near a near miss was."""
    return -np.log(np.maximum(distance / hit_radius, 0.3))


REWARDS = {"paper": reward, "log": log_reward}


def resting_points(model: Model, bounds: StrikeBounds) -> np.ndarray:
    """Return where joints and nodes are before the first strike [m], (m, d).

    In the plane the arm hangs, too; in space it stands in the middle of the postures from which strikes start.
    """
    if model.dimension == 2:
        return joint_points(model, np.zeros(model.n))
    middle = np.mean(bounds.box, axis=0)[None, : model.arm.n]
    return joint_points(model, start_posture(model, middle)[0])


@dataclass(frozen=True)
class Step:
    """Results of a batch of strikes, one per lane; B lanes.

    Args:
        obs: What is seen after the strike, (B, n_obs).
        reward: Of the task's kind, (B,).
        hit: Whether the target was hit: the lane's trial has terminated, (B,).
        truncated: Whether its number of strikes is used up without a hit, (B,).
        approach: The strikes' closest approaches.
    """

    obs: np.ndarray
    reward: np.ndarray
    hit: np.ndarray
    truncated: np.ndarray
    approach: Approach


class StrikeTask:
    """A batch of lanes, in each of which strikes are made at one target.

    Args:
        rollout: Simulator.
        zone: Where targets are drawn.
        observation: `paper`: tip position and velocity at the closest approach; `relative`: the same, measured from
            the target; `goal`: the first, and the target. Before the first strike the whip hangs at rest from the
            arm; see `resting_points`.
        reward: `paper` (Eq. 17) or `log` (see `log_reward`).
        hit_radius: [m]
        strikes: Strikes at one target before it is given up.
        t_stay: [s]
        bounds: Box of the strikes; actions in [-1, 1] cover it.

    Raises:
        InputError: The observation is unknown, or a number is out of range.
    """

    def __init__(
        self,
        rollout: CompiledRollout,
        zone: Zone | None = None,
        *,
        observation: str = "goal",
        reward: str = "paper",
        hit_radius: float = HIT_RADIUS,
        strikes: int = 100,
        t_stay: float = T_STAY,
        bounds: StrikeBounds | None = None,
    ) -> None:
        if observation not in OBSERVATIONS:
            raise InputError("observation", observation, ", ".join(OBSERVATIONS))
        if reward not in REWARDS:
            raise InputError("reward", reward, ", ".join(REWARDS))
        self._reward = REWARDS[reward]
        d = rollout.model.dimension
        self.rollout, self.zone, self.observation = rollout, zone or usual_disc(d), observation
        check_dimension(self.zone, rollout.model)
        self.hit_radius = number("hit radius", hit_radius, low=0, strict=True)
        self.strikes, self.t_stay = whole("strikes", strikes), number("t_stay", t_stay, low=0)
        self.bounds = bounds or default_bounds(rollout.model.arm)
        self.lower, self.upper = self.bounds.box
        self.n_act = len(self.lower)
        self.n_obs = 3 * d if observation == "goal" else 2 * d
        farthest = float(np.abs(self.zone.box).max())
        self.penalty = rollout.model.farthest_miss((farthest,) * d)
        self.resting = resting_points(rollout.model, self.bounds)
        self.resting_tip = self.resting[-1]
        self.n_strikes = self.n_diverged = 0
        self.targets, self.counts = np.empty((0, d)), np.empty(0, int)

    def reset(self, targets: np.ndarray) -> np.ndarray:
        """Give every lane a target, (B, d) [m], before its first strike; the observations (B, n_obs)."""
        self.targets, self.counts = np.array(targets, float), np.zeros(len(targets), int)
        return self.first_look(self.targets)

    def renew(self, obs: np.ndarray, lanes: np.ndarray, targets: np.ndarray) -> np.ndarray:
        """The observations with new targets (b, d) in the lanes of a mask (B,) that ended."""
        self.targets[lanes], self.counts[lanes] = targets, 0
        obs = obs.copy()
        obs[lanes] = self.first_look(targets)
        return obs

    def step(self, actions: np.ndarray) -> Step:
        """Strike once in every lane; actions (B, n_act), clipped to [-1, 1]."""
        approach, distance = self.approach(self.to_strikes(actions), self.targets)
        self.counts += 1
        hit = distance <= self.hit_radius
        return Step(
            obs=self.look(approach, self.targets),
            reward=self.reward(distance),
            hit=hit,
            truncated=~hit & (self.counts >= self.strikes),
            approach=approach,
        )

    def approach(self, strikes: np.ndarray, targets: np.ndarray) -> tuple[Approach, np.ndarray]:
        """Closest approaches of strikes (B, n_act) to targets (B, d), and miss distances, a penalty if diverged."""
        approach = self.rollout.approach(strikes, targets, t_stay=self.t_stay)
        wild = approach.diverged | ~np.isfinite(approach.distance)
        self.n_strikes += len(strikes)
        self.n_diverged += int(wild.sum())
        return approach, np.where(wild, self.penalty, approach.distance)

    def reward(self, distance: np.ndarray) -> np.ndarray:
        """Return the rewards of miss distances [m], any shape."""
        return self._reward(distance, self.hit_radius)

    def to_strikes(self, actions: np.ndarray) -> np.ndarray:
        """Return the strike vectors of actions, (B, n_act)."""
        return self.lower + (np.clip(actions, -1, 1) + 1) / 2 * (self.upper - self.lower)

    def first_look(self, targets: np.ndarray) -> np.ndarray:
        """Return the observations before the first strike at each target, (B, n_obs)."""
        tip = np.broadcast_to(self.resting_tip, targets.shape)
        return self._observe(tip, np.zeros_like(targets), targets)

    def look(self, approach: Approach, targets: np.ndarray) -> np.ndarray:
        """Return the observations after strikes, (B, n_obs); after a diverged one, those before the first."""
        obs = self._observe(approach.tip, approach.velocity, targets)
        wild = approach.diverged | ~np.isfinite(obs).all(axis=1)
        obs[wild] = self.first_look(targets[wild])
        return obs

    def _observe(self, tip: np.ndarray, velocity: np.ndarray, targets: np.ndarray) -> np.ndarray:
        where = tip - targets if self.observation == "relative" else tip
        parts = [where, velocity, targets] if self.observation == "goal" else [where, velocity]
        return np.concatenate(parts, axis=1)

    def normalise(self, obs: np.ndarray) -> np.ndarray:
        """Observations for networks: positions from the zone's centre in units of its half width, speeds in 10 m/s."""
        lower, upper = self.zone.box
        centre, half = (lower + upper) / 2, (upper - lower) / 2
        size = max(1.0, 2 * float(half.max()))  # tips come from everywhere
        where, velocity, target = np.split(obs, [len(centre), 2 * len(centre)], axis=1)
        parts = [where / size if self.observation == "relative" else (where - centre) / size, velocity / SPEED_SCALE]
        if self.observation == "goal":
            parts.append((target - centre) / half)
        return np.concatenate(parts, axis=1)
