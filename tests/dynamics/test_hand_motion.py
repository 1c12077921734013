"""The hand of an arm in space while its joints move, beside forward kinematics and differences."""

from __future__ import annotations

import numpy as np

from whiptool.dynamics.hand_motion import hand_motion
from whiptool.models import preset
from whiptool.models.kinematics import arm_frames
from whiptool.models.spatial_arm import SpatialArm

ARM = preset("ur5e").arm
assert isinstance(ARM, SpatialArm)
RNG = np.random.default_rng(0)
START, RATE, GROWTH = (RNG.uniform(-1, 1, (3, 5, 6)) * np.array([2.0, 3.0, 9.0])[:, None, None]).tolist()


def moved(t: float):
    """Joints' positions, speeds and accelerations of five motions, (5, 6) each."""
    q, v, a = np.array(START), np.array(RATE), np.array(GROWTH)
    return q + v * t + a * t**2 / 2, v + a * t, a


def test_the_hand_is_where_forward_kinematics_has_it_and_moves_as_differences_say():
    found, frame = hand_motion(ARM, *moved(0.0)), arm_frames(ARM, *moved(0.0)[:2])[-1]
    np.testing.assert_allclose(found.place, frame.origin, atol=1e-12)
    np.testing.assert_allclose(found.inputs[:, :9].reshape(-1, 3, 3).swapaxes(1, 2), frame.rotation, atol=1e-12)
    np.testing.assert_allclose(found.inputs[:, 9:12], frame.spin, atol=1e-12)
    np.testing.assert_allclose(found.inputs[:, 12:15], frame.velocity, atol=1e-12)
    h = 1e-5
    before, after = (arm_frames(ARM, *moved(t)[:2])[-1] for t in (-h, h))
    np.testing.assert_allclose(found.inputs[:, 15:18], (after.spin - before.spin) / (2 * h), atol=1e-6)
    np.testing.assert_allclose(found.inputs[:, 18:], (after.velocity - before.velocity) / (2 * h), atol=1e-6)


def test_derivatives_are_differences():
    joints, h = moved(0.0), 1e-6
    slopes = hand_motion(ARM, *joints).by_joints
    for order in range(3):
        for joint in range(6):
            step = np.zeros((3, 5, 6))
            step[order, :, joint] = h
            up, down = (hand_motion(ARM, *(x + sign * s for x, s in zip(joints, step))) for sign in (1, -1))
            changes = [np.hstack([x.inputs, x.place]) for x in (up, down)]
            np.testing.assert_allclose(slopes[:, :, order, joint], (changes[0] - changes[1]) / (2 * h), atol=2e-7)
