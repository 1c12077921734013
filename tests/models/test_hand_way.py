"""The hand's way from pose to pose: against SciPy's interpolation of rotations, and its slopes against differences."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

from whiptool.models import ArmLink, ArmParameters, preset
from whiptool.models.hand_way import HandWay
from whiptool.models.inverse_kinematics import HandKinematics
from whiptool.models.rotations import rotation_vector

RNG = np.random.default_rng(8)
SHARE = np.array([0.0, 0.2, 0.7, 1.0])
PLANE = HandKinematics(ArmParameters((ArmLink(0.3, 0.2),) * 3), np.array([0.2, 0.9, 0.7]), orientation=True)
PANDA = HandKinematics(preset("panda").arm, np.array([0, -0.5, 0, -2.0, 0, 1.7, 0.7]), orientation=True)
each = pytest.mark.parametrize("kinematics", [PLANE, PANDA], ids=["plane", "space"])


def rotations_of(way: HandWay, share: np.ndarray = SHARE) -> np.ndarray:
    """Rotations at shares of a way that has some."""
    rotations = way.at(share).rotation
    assert rotations is not None
    return rotations


def test_orientations_turn_evenly_about_one_axis_by_the_shortest_way():
    ends = RNG.normal(size=(4, 2, 6))
    way = HandWay(PANDA, ends)
    poses = way.at(SHARE)
    for i in range(4):
        rotations = Rotation.from_rotvec(ends[i, :, 3:]) * Rotation.from_matrix(PANDA.upright)
        np.testing.assert_allclose(rotations_of(way)[i], Slerp([0, 1], rotations)(SHARE).as_matrix(), atol=1e-12)
    np.testing.assert_allclose(poses.place, ends[:, :1, :3] + SHARE[:, None] * (ends[:, 1:] - ends[:, :1])[..., :3])


def test_a_hand_in_the_plane_turns_by_the_difference_of_its_angles_more_than_half_a_turn_too():
    way = HandWay(PLANE, np.array([[0.1, 0.2, -2.0], [0.3, -0.2, 2.5]]))
    np.testing.assert_allclose(way.motion, [0.2, -0.4, 4.5])
    angle = rotation_vector(rotations_of(way, np.array([0.5])) @ PLANE.upright.T)[0]
    np.testing.assert_allclose(angle, [0, -0.25, 0], atol=1e-12)


def test_without_orientation_there_is_only_a_place():
    way = HandWay(HandKinematics(preset("panda").arm, PANDA.posture), np.array([[0.1, 0.2, 0.3], [0.4, 0.1, 0.3]]))
    assert way.at(SHARE).rotation is None
    np.testing.assert_allclose(way.motion, [0.3, -0.1, 0.0])


@each
def test_slopes_against_differences(kinematics):
    m, d, h = kinematics.size, kinematics.dimension, 1e-6
    ends = 0.7 * RNG.normal(size=(3, 2, m))
    way = HandWay(kinematics, ends)
    slopes, of_start, of_turns = way.slopes(SHARE), way.start_slopes(), way.turn_slopes()[1]
    for j in range(2 * m):
        step = np.zeros(2 * m)
        step[j] = h
        before, after = (HandWay(kinematics, ends + sign * step.reshape(2, m)) for sign in (-1, 1))
        moved = after.at(SHARE).place - before.at(SHARE).place
        turned = rotation_vector(rotations_of(after) @ np.swapaxes(rotations_of(before), -1, -2))
        change = np.concatenate([moved, turned], axis=-1) @ kinematics.rows.T / (2 * h)
        np.testing.assert_allclose(slopes[..., j], change, atol=1e-7)
        if j % m >= d:
            k = j % m - d + (j // m) * (m - d)
            at_start = rotations_of(after)[:, 0] - rotations_of(before)[:, 0]
            np.testing.assert_allclose(of_start[..., k], at_start / (2 * h), atol=1e-7)
            np.testing.assert_allclose(of_turns[..., k], (after.turns - before.turns) / (2 * h), atol=1e-7)
