"""Places of targets: one for all or one each, and what has another shape."""

from __future__ import annotations

import numpy as np
import pytest

from whiptool.errors import InputError
from whiptool.goals.target import Target
from whiptool.rollout.points import target_points


@pytest.mark.parametrize("place", [(1.1, 0.2), (1.1, 0.2, -0.3)])
def test_one_place_is_that_of_all(place: tuple[float, ...]):
    d = len(place)
    for target in (Target(place), place, list(place), np.array(place)):
        assert target_points(target, 3, d).tolist() == [list(place)] * 3


def test_each_has_its_own():
    places = np.random.default_rng(0).normal(size=(4, 3))
    np.testing.assert_array_equal(target_points(places, 4, 3), places)
    np.testing.assert_array_equal(target_points(places.tolist(), 4, 3), places)
    assert target_points(np.array([[1, 2]]), 1).dtype == float


def test_as_many_as_coordinates_are_one_each():
    """Two strikes in the plane: rows are strikes."""
    assert target_points(np.array([[1.0, 2.0], [3.0, 4.0]]), 2).tolist() == [[1, 2], [3, 4]]


@pytest.mark.parametrize(
    ("target", "count", "dimension", "message"),
    [
        (np.zeros((3, 2)), 2, 2, r"shape \(3, 2\).*in the plane, shape \(2,\), or one each, \(2, 2\)"),
        (np.zeros(3), 2, 2, r"shape \(3,\).*in the plane"),
        (Target((1.0, 2.0)), 5, 3, r"shape \(2,\).*in space, shape \(3,\), or one each, \(5, 3\)"),
        (np.array(1.0), 2, 2, r"shape \(\)"),
    ],
)
def test_other_shapes_are_refused(target, count: int, dimension: int, message: str):
    with pytest.raises(InputError, match=f"target: got .*{message}"):
        target_points(target, count, dimension)
