"""A hand without an arm: its joints hold it where motion capture saw it, without jumps."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

from whiptool.errors import InputError
from whiptool.models.free_hand import hand_joints
from whiptool.models.kinematics import arm_frames


def turning(first: Rotation, by: np.ndarray, count: int = 50) -> np.ndarray:
    """Poses of a hand that turns by a rotation vector and moves along."""
    way = Slerp([0, 1], Rotation.concatenate([first, Rotation.from_rotvec(by) * first]))(np.linspace(0, 1, count))
    places = np.linspace([0.1, -0.2, 0.3], [0.5, 0.4, -0.1], count)
    return np.hstack([places, way.as_quat()])


@pytest.mark.parametrize("seed", range(8))
def test_the_joints_hold_the_hand_where_it_was_seen(seed):
    """Whichever way it points, and while it turns by 100 degrees; quaternions may change their sign."""
    rng = np.random.default_rng(seed)
    axis = rng.normal(size=3)
    poses = turning(Rotation.random(rng=rng), np.deg2rad(100) * axis / np.linalg.norm(axis))
    poses[::3, 3:] *= -1
    arm, joints = hand_joints(poses)
    hand = arm_frames(arm, joints)[-1]
    np.testing.assert_allclose(hand.origin, poses[:, :3], atol=1e-12)
    np.testing.assert_allclose(hand.rotation, Rotation.from_quat(poses[:, 3:]).as_matrix(), atol=1e-12)
    assert np.abs(np.diff(joints, axis=0)).max() < 0.3


def test_a_hand_that_turns_all_ways_is_refused():
    poses = np.hstack([np.zeros((200, 3)), Rotation.random(200, rng=np.random.default_rng(0)).as_quat()])
    with pytest.raises(InputError, match="turns of the hand"):
        hand_joints(poses)
