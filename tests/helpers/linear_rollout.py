"""Instead of physics: everything that a strike comes to is a simple function of its numbers, with exact derivatives."""

from __future__ import annotations

import numpy as np

from whiptool.models import preset
from whiptool.models.strike import StrikeBounds
from whiptool.models.trajectory import Approach
from whiptool.rollout.interface import ApproachSlopes, Rollout

BOUNDS = StrikeBounds((-2.0, -2.0, -2.0, -2.0, 0.5), (2.0, 2.0, 2.0, 2.0, 2.0))
LEAST = np.array([1.0, 0.5, -0.4, 0.3, 1.2])  # the strike without effort
BASE = np.array([1.0, 2.0])  # torques [N m] at a third number of 0


class LinearRollout(Rollout):
    """The tip is at the first two numbers, its velocity the next two and a push forward; effort is the squared distance
    from a strike; the largest torques grow and fall with the third number. A first number above `wild` diverges."""

    model, engine, timestep = preset("lemon2024"), "linear", 1.0

    def __init__(self, wild: float = np.inf) -> None:
        self.wild, self.rolled, self.slopes_taken = wild, 0, 0

    def trajectory(self, strike, *, t_stay=0.3):
        raise NotImplementedError("there are no joints")

    def approach(self, strikes, target, *, t_stay=0.3) -> Approach:
        self.rolled += len(strikes)
        away = strikes - LEAST
        turned = np.stack([strikes[:, 2], -strikes[:, 2]], axis=1)
        return Approach(
            distance=np.linalg.norm(strikes[:, :2] - target, axis=1),
            time=strikes[:, -1],
            velocity=strikes[:, 2:4] + np.array([3.0, 0.0]),
            tip=strikes[:, :2].copy(),
            max_joint_speed=np.ones((len(strikes), 2)),
            max_torque=BASE + turned,
            diverged=strikes[:, 0] > self.wild,
            effort=np.stack([(away[:, :3] ** 2).sum(axis=1), (away[:, 3:] ** 2).sum(axis=1)], axis=1),
        )

    def slopes(self, strikes, target, *, t_stay=0.3, names=None):
        self.slopes_taken += len(strikes)
        near, B = self.approach(strikes, target, t_stay=t_stay), len(strikes)
        tip, velocity, effort, torque = np.zeros((4, B, 2, 5))
        tip[:, [0, 1], [0, 1]] = 1
        velocity[:, [0, 1], [2, 3]] = 1
        effort[:, 0, :3], effort[:, 1, 3:] = 2 * (strikes - LEAST)[:, :3], 2 * (strikes - LEAST)[:, 3:]
        torque[:, :, 2] = [1, -1]
        away = (near.tip - target) / np.maximum(near.distance, 1e-300)[:, None]
        return near, ApproachSlopes(np.einsum("bd,bdm->bm", away, tip), tip, velocity, effort, torque)
