"""Where arm and whip are drawn: at MuJoCo's bodies, and where forward kinematics puts them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from space_swing import places, swing
from spatial_arms import of_universal_nodes

from whiptool.models import preset
from whiptool.viz.drawn_posture import arm_and_whip, as_mujoco_shows, at_times

LEMON, UR5E = preset("lemon2024"), of_universal_nodes("ur5e")
PATH = swing(UR5E)


def test_arm_and_whip_stand_where_mujoco_has_them():
    q = PATH.q[::100]
    arm, whip = arm_and_whip(UR5E, q)
    assert arm.shape == (len(q), 8, 3)
    assert whip.shape == (len(q), UR5E.whip.N + 1, 3)
    for k in range(len(q)):
        its_arm, its_whip = places(UR5E, q[k])
        np.testing.assert_allclose(arm[k], its_arm, atol=1e-12)
        np.testing.assert_allclose(whip[k], its_whip, atol=1e-12)


def test_in_the_plane_arm_and_whip_meet_at_the_hand():
    """The arm stretched forward, the whip straight down behind it."""
    q = np.zeros(LEMON.n)
    q[0], q[2] = np.pi / 2, -np.pi / 2
    arm, whip = arm_and_whip(LEMON, q)
    reach = LEMON.arm.per_link("length").sum()
    np.testing.assert_allclose(arm[:, 1], 0, atol=1e-15)
    np.testing.assert_allclose(arm[:, 0], np.cumsum([0, *LEMON.arm.per_link("length")]))
    np.testing.assert_array_equal(arm[-1], whip[0])
    np.testing.assert_allclose(whip[:, 0], reach)
    np.testing.assert_allclose(whip[:, 1], -np.cumsum([0, *LEMON.whip.per_node("l")]), atol=1e-15)


def test_rows_between_instants_change_linearly():
    t = np.array([0.0, 1.0, 3.0])
    x = np.array([[0.0, 5.0], [2.0, 5.0], [6.0, 1.0]])
    found = at_times(np.array([0.5, 2.0, 3.0]), t, x)
    np.testing.assert_allclose(found, [[1, 5], [4, 3], [6, 1]])


@pytest.mark.parametrize("model", [LEMON, UR5E], ids=["hinges", "universal"])
def test_what_mujoco_has_joints_for_stays_as_it_is(model):
    q = np.random.default_rng(0).normal(size=(2, model.n))
    shown, same = as_mujoco_shows(model, q)
    assert shown is model
    assert same is q


def test_rods_are_shown_where_they_are():
    rods = replace(UR5E, whip=replace(UR5E.whip, joints="rod", node_inertia=0.0))
    q = PATH.q[::100]
    _, whip = arm_and_whip(UR5E, q)
    directions = np.diff(whip, axis=1) / UR5E.whip.per_node("l")[:, None]
    state = np.concatenate([q[:, : UR5E.arm.n], directions.reshape(len(q), -1)], axis=1)
    np.testing.assert_allclose(arm_and_whip(rods, state)[1], whip, atol=1e-12)
    shown, angles = as_mujoco_shows(rods, state)
    for k in range(len(q)):
        np.testing.assert_allclose(places(shown, angles[k])[1], whip[k], atol=1e-9)
