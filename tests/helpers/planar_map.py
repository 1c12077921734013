"""A striker of the published whip and a region of goals with arrival angles, small enough for tests."""

from __future__ import annotations

import numpy as np

from whiptool.goals.arrival_rule import ArrivalRule
from whiptool.goals.zone import Disc
from whiptool.impedance import ConstantImpedance, Controller
from whiptool.models import preset
from whiptool.rollout import CompiledRollout
from whiptool.strike_map import GoalRegion, Striker

AIMED = GoalRegion(Disc((1.3, 0.0), 0.2), ArrivalRule(angle=(-np.pi, np.pi), speed=1.0), 0.03)
POINTS = GoalRegion(Disc((1.3, 0.0), 0.2), hit_radius=0.02)


def striker(limits=None) -> Striker:
    """The paper's arm and whip under constant impedance."""
    rollout = CompiledRollout(preset("lemon2024"), Controller(ConstantImpedance()), timestep=5e-4)
    return Striker(rollout, limits=limits)


def random_strikes(one: Striker, count: int, seed: int = 0) -> np.ndarray:
    """Uniformly random strikes."""
    return one.bounds.sample(np.random.default_rng(seed), count)
