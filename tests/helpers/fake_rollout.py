"""Instead of physics: a tip that flies straight from the origin, so that every closest approach has a closed form."""

from __future__ import annotations

import numpy as np

from whiptool.models import preset
from whiptool.models.trajectory import Approach
from whiptool.rollout.interface import Rollout

SPEED = 2.0  # [m/s]


class StraightFlight(Rollout):
    """The first angle of a strike is the tip's direction; a strike whose second angle is too large diverges."""

    model, engine, timestep = preset("lemon2024"), "straight", 1.0

    def __init__(self, wild_above: float = 0.9) -> None:
        self.wild_above, self.rolled = wild_above, []

    def trajectory(self, strike, *, t_stay=0.3):
        raise NotImplementedError("a straight flight has no joints")

    def directions(self, strikes: np.ndarray) -> np.ndarray:
        return np.stack([np.cos(strikes[:, 0]), np.sin(strikes[:, 0])], axis=1)

    def approach(self, strikes: np.ndarray, targets: np.ndarray, *, t_stay: float) -> Approach:
        self.rolled.append(len(strikes))
        targets = np.broadcast_to(targets, (len(strikes), self.model.dimension))
        direction = self.directions(strikes)
        along = np.clip((targets * direction).sum(axis=1), 0, SPEED * (strikes[:, -1] + t_stay))
        tip = along[:, None] * direction
        distance = np.linalg.norm(tip - targets, axis=1)
        wild = strikes[:, 1] > self.wild_above
        peaks = np.abs(strikes[:, :2])
        return Approach(
            distance=np.where(wild, np.nan, distance),
            time=along / SPEED,
            tip=tip,
            velocity=SPEED * direction,
            max_joint_speed=peaks,
            max_torque=2 * peaks,
            diverged=wild,
        )

    def tip_path(self, strikes: np.ndarray, *, t_stay: float, rate: float):
        ends = strikes[:, -1] + t_stay
        t = np.arange(int(ends.max() * rate) + 1) / rate
        paths = SPEED * t[None, :, None] * self.directions(strikes)[:, None]
        paths[t[None] > ends[:, None]] = np.nan
        paths[strikes[:, 1] > self.wild_above, 1:] = np.nan
        return t, paths, None


class StraightFlightInSpace(StraightFlight):
    """The same in space: the first angle of a strike is the tip's azimuth, the third its height."""

    model = preset("nah2023")

    def directions(self, strikes: np.ndarray) -> np.ndarray:
        azimuth, height = strikes[:, 0], strikes[:, 2]
        level = np.cos(height)
        return np.stack([level * np.cos(azimuth), level * np.sin(azimuth), np.sin(height)], axis=1)
