"""Rotations of symbols: against SciPy's, at no turn too, and what is left of a turn against the quaternions'."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from whiptool.dynamics.turns import rotation_left, turned_by
from whiptool.models import rotations

V, S = ca.SX.sym("v", 3), ca.SX.sym("s")
TURNED = ca.Function("turned", [V, S], [turned_by(V, S), ca.jacobian(ca.vec(turned_by(V, S)), V)])
A, B = ca.SX.sym("a", 3, 3), ca.SX.sym("b", 3, 3)
LEFT = ca.Function("left", [A, B], [rotation_left(A, B)])


@pytest.mark.parametrize("size", [0.0, 1e-9, 1e-4, 0.7, 3.0])
def test_a_share_of_a_rotation_vector_and_its_derivatives(size):
    vector, share, h = size * np.array([0.0, 0.6, -0.8]), 0.4, 1e-6
    found, slopes = (x.full() for x in TURNED(vector, share))
    np.testing.assert_allclose(found, rotations.rotation_of(share * vector), atol=1e-14)
    for column, step in zip(slopes.T, h * np.eye(3), strict=True):
        after, before = (rotations.rotation_of(share * (vector + sign * step)) for sign in (1, -1))
        np.testing.assert_allclose(column.reshape(3, 3).T, (after - before) / (2 * h), atol=1e-8)


def test_what_is_left_is_twice_the_quaternions_vector_part():
    pairs = Rotation.random(40, np.random.default_rng(3)).as_matrix().reshape(20, 2, 3, 3)
    for wanted, present in pairs:
        found = LEFT(wanted, present).full().ravel()
        np.testing.assert_allclose(found, rotations.rotation_left(wanted, present), atol=1e-9)
    np.testing.assert_allclose(LEFT(np.eye(3), np.eye(3)).full(), 0, atol=1e-15)
    assert np.isfinite(LEFT(np.diag([1.0, -1.0, -1.0]), np.eye(3)).full()).all()  # half a turn
