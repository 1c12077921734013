"""Trajectories tell the same as outcomes, and are saved without pickle."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from rich_model import COMPUTED, CONTROLLERS, LEMON

from whiptool.models import Model, preset
from whiptool.models.robots import rope
from whiptool.models.spatial_arm import JointLimits, SpatialArm, SpatialLink
from whiptool.models.strike import Strike, default_bounds
from whiptool.models.trajectory import Trajectory
from whiptool.rollout import CompiledRollout

TARGET = np.array([1.3, 0.0])
_BODY = {"mass": 1.0, "com": (0, 0, 0), "inertia": (0.1, 0.1, 0.1, 0, 0, 0), "axis": (0, 1, 0)}
_RAIL = SpatialLink(**_BODY, position=(0, 0, 0), kind="prismatic", limits=JointLimits((-1, 1)))
_LINKS = _RAIL, SpatialLink(**_BODY, position=(0, 0, -0.3))
SLIDING = Model(rope(3), SpatialArm(_LINKS, joints=("rail", "wrist"), hand_position=(0, 0, -0.2)))
STRIKES = default_bounds(LEMON.arm).sample(np.random.default_rng(5), 40)


@pytest.mark.parametrize(
    "controller",
    [pytest.param(x, marks=[pytest.mark.slow] * (name in ("all options", "held"))) for name, x in CONTROLLERS.items()],
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


@pytest.mark.parametrize(
    ("model", "some"),
    [
        (
            LEMON,
            ["q.shoulder [rad]", "v.whip[11] [rad/s]", "tau.elbow [N m]", "K.shoulder.elbow [N m/rad]"],
        ),
        (preset("nah2023"), ["q.whip[24][1] [rad]", "B.elbow.elbow [N m s/rad]", "tip_velocity.z [m/s]"]),
        (preset("ur5e"), ["q.wrist_3 [rad]", "q.whip[0].x [1]", "v.whip[19].z [1/s]", "q_d.shoulder_pan [rad]"]),
        (SLIDING, ["q.rail [m]", "v_d.rail [m/s]", "tau.rail [N]", "K.rail.rail [N/m]", "B.rail.wrist [N s/rad]"]),
    ],
)
def test_columns_have_the_joints_names_and_their_units(model, some):
    T, n, a, d = 2, model.coordinates, model.arm.n, model.dimension
    chain, arm, gains, tip = np.ones((T, n)), np.ones((T, a)), np.ones((T, a, a)), np.ones((T, d))
    path = Trajectory(np.arange(2.0), chain, chain, arm, arm, arm, gains, gains, tip, tip, names=model.coordinate_names)
    header = path.to_csv().splitlines()[0].split(",")
    assert header[0] == "t [s]"
    assert len(set(header)) == len(header) == 1 + 2 * n + 3 * a + 2 * a * a + 2 * d
    assert set(some) <= set(header)
    assert list(path.columns()) == [name.split(" [")[0] for name in header]
    assert "q[0]" in dataclasses.replace(path, names=()).columns()
