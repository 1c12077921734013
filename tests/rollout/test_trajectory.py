"""Trajectories tell the same as outcomes, and are saved without pickle."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from rich_model import COMPUTED, CONTROLLERS, LEMON

from whiptool.models.strike import Strike, default_bounds
from whiptool.rollout import CompiledRollout
from whiptool.rollout.trajectory import Trajectory

TARGET = np.array([1.3, 0.0])
STRIKES = default_bounds(LEMON.arm).sample(np.random.default_rng(5), 40)


@pytest.mark.parametrize(
    "controller",
    [pytest.param(x, marks=[pytest.mark.heavy] * (name in ("all options", "held"))) for name, x in CONTROLLERS.items()],
    ids=CONTROLLERS,
)
def test_trajectory_and_outcome_tell_the_same(controller):
    rollout = CompiledRollout(LEMON, controller, timestep=2.5e-4)
    near = rollout.approach(STRIKES[:5], TARGET, t_stay=0.3)
    for i, (vector, path) in enumerate(zip(STRIKES, rollout.trajectories(STRIKES[:5], t_stay=0.3), strict=False)):
        single = rollout.trajectory(Strike.from_vector(vector), t_stay=0.3)
        np.testing.assert_array_equal(path.q, single.q)
        again = path.approach(TARGET)
        assert path.t[-1] == pytest.approx(vector[-1] + 0.3)
        for name in COMPUTED:
            np.testing.assert_allclose(getattr(again, name)[0], getattr(near, name)[i], atol=1e-9)
        np.testing.assert_allclose(np.gradient(path.tip, path.t, axis=0)[1:-1], path.tip_velocity[1:-1], atol=0.5)


def test_trajectories_are_saved_without_pickle(tmp_path):
    path = CompiledRollout(LEMON, CONTROLLERS["oiac"]).trajectory(Strike.from_vector(STRIKES[0]), t_stay=0.1)
    path.save(tmp_path / "strike.npz")
    again = Trajectory.load(tmp_path / "strike.npz")
    for field in dataclasses.fields(path):
        np.testing.assert_array_equal(getattr(again, field.name), getattr(path, field.name))
