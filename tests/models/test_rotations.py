"""Rotations and their vectors: against SciPy's interpolation, closed forms, and differences."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from whiptool.models.rotations import quaternion_of, rotation_left, rotation_of, rotation_vector, skew, turning

RNG = np.random.default_rng(4)


def test_vectors_come_back_from_their_rotations():
    vectors = RNG.uniform(-1.7, 1.7, (3, 5, 3))  # shorter than pi
    np.testing.assert_allclose(rotation_vector(rotation_of(vectors)), vectors, atol=1e-12)
    np.testing.assert_allclose(skew(vectors[0]) @ [1, 2, 3], np.cross(vectors[0], [1, 2, 3]), atol=1e-15)


def test_quaternions_turn_vectors_as_their_rotations_do_and_have_one_sign():
    R = Rotation.random(20, np.random.default_rng(1)).as_matrix()
    x, y, z, w = quaternion_of(R).T
    assert (w >= 0).all()
    np.testing.assert_allclose(x**2 + y**2 + z**2 + w**2, 1, atol=1e-14)
    turned = np.array([w**2 + x**2 - y**2 - z**2, 2 * (x * y + w * z), 2 * (x * z - w * y)]).T  # of (1, 0, 0)
    np.testing.assert_allclose(turned, R[:, :, 0], atol=1e-14)


@pytest.mark.parametrize("angle", [0.0, 1e-6, 0.3, 2.0, 3.1])
def test_what_is_left_is_along_the_axis_and_twice_the_sine_of_half_the_angle(angle):
    axis, present = np.array([2.0, -1.0, 2.0]) / 3, Rotation.random(None, np.random.default_rng(2)).as_matrix()
    left = rotation_left(rotation_of(angle * axis) @ present, present)
    np.testing.assert_allclose(left, 2 * np.sin(angle / 2) * axis, atol=1e-14)


@pytest.mark.parametrize("size", [0.0, 1e-6, 0.5, 2.5])
def test_a_rotation_vectors_change_turns_as_differences_say(size):
    vector, h = size * np.array([0.6, 0.0, -0.8]), 1e-6
    found = turning(vector)
    for column, step in zip(found.T, h * np.eye(3), strict=True):
        turned = rotation_of(vector + step) @ rotation_of(vector - step).T
        np.testing.assert_allclose(column, rotation_vector(turned) / (2 * h), atol=1e-8)
