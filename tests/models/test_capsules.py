"""Capsules: along an axis, around a box, and what is none."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from whiptool.errors import InputError
from whiptool.models.capsules import Capsule, checked_capsules
from whiptool.models.kinematics import rotation_about


def distance(capsule: Capsule, point: np.ndarray) -> float:
    """From the capsule's axis [m], by many points of it."""
    along = np.linspace(capsule.start, capsule.end, 2001)
    return float(np.linalg.norm(along - point, axis=1).min())


def test_a_capsule_lies_along_the_z_axis_of_its_frame():
    R, p = rotation_about((0.6, 0.0, 0.8), 0.7), np.array([0.1, -0.2, 0.3])
    capsule = Capsule.along(R, p, 0.25, 0.05)
    np.testing.assert_allclose(capsule.start, p - 0.25 * R[:, 2])
    np.testing.assert_allclose(capsule.end, p + 0.25 * R[:, 2])
    assert (capsule.length, capsule.radius) == (pytest.approx(0.5), 0.05)


@pytest.mark.parametrize("halves", [(0.3, 0.1, 0.05), (0.1, 0.4, 0.05), (0.02, 0.1, 0.2)])
def test_a_box_is_in_the_capsule_around_it_and_no_smaller_one_holds_it(halves):
    R, p = rotation_about((0.0, 0.6, 0.8), 1.1), np.array([0.1, -0.2, 0.3])
    capsule = Capsule.around_box(R, p, np.array(halves))
    corners = [p + R @ (np.array(signs) * halves) for signs in itertools.product((-1, 1), repeat=3)]
    assert max(distance(capsule, corner) for corner in corners) == pytest.approx(capsule.radius, rel=1e-6)
    assert capsule.length == pytest.approx(2 * max(halves))


def test_what_is_no_capsule():
    with pytest.raises(InputError, match="radius: got -1"):
        Capsule((0, 0, 0), (0, 0, 1), -1)
    with pytest.raises(InputError, match="start: got"):
        Capsule((0, 0), (0, 0, 1), 1)
    with pytest.raises(InputError, match="base: got"):
        checked_capsules("base", [(0, 0, 0)])
