"""Paths of tip and hand with their velocities, of each engine, against trajectories and kinematics."""

from __future__ import annotations

import numpy as np
import pytest

from whiptool.errors import InputError
from whiptool.models import preset
from whiptool.models.kinematics import arm_frames
from whiptool.rollout import CompiledRollout
from whiptool.throws.release import RATE

LEMON = preset("lemon2024")
STRIKE = np.array([[-0.9, 1.4, 1.7, 1.4, 0.45]])


def test_both_engines_agree():
    found = []
    for engine in ("scalar", "interpreter"):
        rollout = CompiledRollout(LEMON, engine=engine, timestep=5e-4)
        found.append(rollout.release_path(STRIKE, t_stay=0.05, rate=RATE, names=("q_sf", "D")))
    (states, slopes, _), (others, other_slopes, _) = found
    assert states == pytest.approx(others, abs=1e-9)
    assert slopes == pytest.approx(other_slopes, abs=1e-7)


def test_the_hand_is_where_the_joints_put_it():
    rollout = CompiledRollout(LEMON)
    states, _, _ = rollout.release_path(STRIKE, t_stay=0.05, rate=RATE, by_hand=True)
    path = rollout.trajectory(STRIKE, t_stay=0.05)
    times = np.arange(0, 0.45, 0.05)
    q = np.stack([np.interp(times, path.t, x) for x in path.q[:, :2].T], axis=1)
    hand = arm_frames(LEMON.arm.in_space(), q)[-1].origin[:, [0, 2]]
    seen = states[0, np.round(times * RATE).astype(int)]
    assert seen[:, :2] == pytest.approx(hand, abs=1e-4)
    around = states[0, :, :2]
    assert states[0, 1:-1, 2:] == pytest.approx((around[2:] - around[:-2]) * RATE / 2, abs=0.02)


def test_the_interpreter_does_not_follow_the_hand():
    with pytest.raises(InputError, match="to follow the hand"):
        CompiledRollout(LEMON, engine="interpreter").release_path(STRIKE, rate=RATE, by_hand=True)
