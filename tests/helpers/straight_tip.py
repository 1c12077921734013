"""A toy rollout whose tips fly straight and evenly, its library of strikes, and tracks that are known."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from whiptool.interception.library import Library
from whiptool.interception.target_tracks import TargetTrack, find_motion
from whiptool.models import preset
from whiptool.models.strike import StrikeBounds, strike_names
from whiptool.strike_map.striker import Striker

MODEL = preset("lemon2024")
NAMES = strike_names(MODEL.arm)
LOWER, UPPER = np.array([-1.0, 0.0, 0.0, 0.0, 0.5]), np.array([0.0, 1.0, 2.0, 1.0, 1.5])
PUSH = np.array([[0.3, -0.1, 0.4, 0.2, 0.0], [0.0, 0.2, -0.1, 0.5, 0.0]])  # of a strike's numbers on the tip [m]
SPEED = np.array([3.0, 1.0])  # of every tip [m/s]


class Straight:
    """A rollout whose tips all fly straight and evenly: `tip(tau) = PUSH u + SPEED (tau - 0.5)`."""

    model, prescribed, space = MODEL, False, SimpleNamespace(kind="joint")

    def tip_path(self, strikes, *, t_stay, rate, names=()):
        t = np.arange(int((strikes[:, -1].max() + t_stay) * rate + 1e-9) + 1) / rate
        path = (strikes @ PUSH.T)[:, None] + SPEED * (t[:, None] - 0.5)
        path = np.where(t[:, None] <= strikes[:, -1, None, None] + t_stay + 1e-9, path, np.nan)
        slope = np.tile(PUSH[:, [NAMES.index(name) for name in names]], (*path.shape[:2], 1, 1))
        return t, path, slope

    def peaks_and_path(self, strikes, *, t_stay, rate):
        _, path, _ = self.tip_path(strikes, t_stay=t_stay, rate=rate)
        return SimpleNamespace(diverged=strikes[:, 0] > 5), path


def library(strikes: np.ndarray, rollout: Straight | None = None) -> Library:
    rollout = rollout or Straight()
    t, path, _ = rollout.tip_path(strikes, t_stay=0.3, rate=250.0)
    velocity = np.gradient(path, 1 / 250, axis=1)
    owner, at = np.nonzero(np.isfinite(path[..., 0]))
    striker = Striker(rollout, bounds=StrikeBounds(tuple(LOWER), tuple(UPPER)), limits=None, t_stay=0.3)
    return Library(striker, np.ones(5, bool), strikes, owner, t[at], path[owner, at], velocity[owner, at])


MIDDLE = np.array([[-0.5, 0.5, 1.0, 0.5, 1.0]])
HOME = (MIDDLE @ PUSH.T)[0]  # where its tip is at tau = 0.5


def known(*numbers: float) -> TargetTrack:
    return TargetTrack.known(find_motion("straight" if len(numbers) == 4 else "still"), np.array(numbers))
