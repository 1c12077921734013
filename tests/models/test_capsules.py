"""Capsules and distances of segments: against coal's shapes, and by hand for points and parallel segments."""

from __future__ import annotations

import itertools

import coal
import numpy as np
import pytest
from scipy.optimize import nnls

from whiptool.errors import InputError
from whiptool.models.capsules import Capsule, checked_capsules, nearest_points
from whiptool.models.kinematics import rotation_about


def coal_distance(start, end, other_start, other_end) -> float:
    shapes = []
    for a, b in ((start, end), (other_start, other_end)):
        length = float(np.linalg.norm(b - a))
        z = (b - a) / length
        x = np.cross(np.eye(3)[np.abs(z).argmin()], z)
        x /= np.linalg.norm(x)
        pose = coal.Transform3s(np.column_stack([x, np.cross(z, x), z]), (a + b) / 2)
        shapes += [coal.Capsule(0.0, length), pose]
    return coal.distance(*shapes, coal.DistanceRequest(), coal.DistanceResult())


def test_random_segments_are_as_far_apart_as_coal_s():
    rng = np.random.default_rng(0)
    ends = rng.normal(size=(4, 200, 3))
    ends[1, :50] = ends[0, :50] + 1e-5 * rng.normal(size=(50, 3)) + (ends[3] - ends[2])[:50]  # nearly parallel
    one, two = nearest_points(*ends)
    found = np.linalg.norm(two - one, axis=-1)
    np.testing.assert_allclose(found, [coal_distance(*x) for x in np.moveaxis(ends, 1, 0)], atol=1e-8)


@pytest.mark.parametrize(
    ("ends", "distance"),
    [
        (((0, 0, 0), (0, 0, 0), (3, 4, 0), (3, 4, 0)), 5.0),  # two points
        (((0, 0, 0), (0, 0, 0), (-1, 2, 0), (1, 2, 0)), 2.0),  # a point and a segment
        (((-1, 2, 0), (1, 2, 0), (5, 2, 0), (5, 2, 0)), 4.0),
        (((0, 0, 0), (1, 0, 0), (0.5, 3, 0), (2, 3, 0)), 3.0),  # parallel, beside each other
        (((0, 0, 0), (1, 0, 0), (4, 4, 0), (9, 4, 0)), 5.0),  # parallel, one behind the other
        (((-1, 0, 0), (1, 0, 0), (0, -1, 0.25), (0, 1, 0.25)), 0.25),  # crossing
        (((-1, 0, 0), (1, 0, 0), (0, -1, 0), (0, 1, 0)), 0.0),
    ],
)  # fmt: skip
def test_by_hand(ends, distance):
    one, two = nearest_points(*np.array(ends, float))
    assert np.linalg.norm(two - one) == pytest.approx(distance, abs=1e-15)


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


@pytest.mark.parametrize("flat", [False, True])
def test_the_hull_of_points_is_as_far_from_a_point_as_their_mixtures_are(flat):
    """The nearest point of the hull by non-negative least squares; points in a plane get a thickness of 1 mm."""
    rng, thick = np.random.default_rng(1), 1e-3 * flat
    for _ in range(20):
        R = rotation_about(np.array([0.0, 0.6, 0.8]), float(rng.uniform(-3, 3)))
        points = (rng.normal(size=(60, 3)) * [0.1, 0.2, 0.0 if flat else 0.05]) @ R.T + rng.normal(size=3)
        shape = Capsule.around(points)
        assert max(distance(shape, corner) for corner in np.array(shape.hull)) <= shape.radius + 1e-6
        assert not shape.exact
        assert shape.inner_radius < 0
        turned = shape.turned(R)
        assert np.array(turned.hull) == pytest.approx(np.array(shape.hull) @ R.T)
        pose = coal.Transform3s(shape.rotation, (np.array(shape.start) + shape.end) / 2)
        for other in points.mean(axis=0) + rng.normal(size=(5, 3)):
            shares, _ = nnls(np.vstack([points.T, 1e4 * np.ones(60)]), np.array([*other, 1e4]))
            apart = float(np.linalg.norm(points.T @ shares - other))
            at, request = coal.Transform3s(np.eye(3), other), coal.DistanceRequest()
            mine = coal.distance(shape.solid(), pose, coal.Sphere(1e-9), at, request, coal.DistanceResult())
            if apart > 1e-2:
                assert apart - thick - 1e-5 < mine < apart + 1e-5


@pytest.mark.parametrize("extents", [(0.1, 0.2, 0.0), (0.1, 0.0, 0.0), (0.0, 0.0, 0.0)])
def test_things_without_thickness_have_a_hull(extents):
    points = np.array(list(itertools.product(*((-x, x) for x in extents))))
    solid = Capsule.around(points).solid()
    assert solid.computeVolume() == pytest.approx(np.prod([2 * max(x, 5e-4) for x in extents]), rel=1e-6)


def test_what_is_no_capsule():
    with pytest.raises(InputError, match="radius: got -1"):
        Capsule((0, 0, 0), (0, 0, 1), -1)
    with pytest.raises(InputError, match="start: got"):
        Capsule((0, 0), (0, 0, 1), 1)
    corners = ((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 2))
    for bad in (corners[:3], corners, ((0, 0, 3), *corners[:3])):
        with pytest.raises(InputError, match=r"hull: got '[34] corners'; allowed: four corners or more inside"):
            Capsule((0, 0, 0), (0, 0, 1), 1.0 - 1e-3 * (bad is corners), hull=bad)
    assert Capsule((0, 0, 0), (0, 0, 1), 1.0, hull=corners).hull == corners
    for bad in (3, (3, 4), ((1, 2), (3, 4))):
        with pytest.raises(InputError, match="hull: got"):
            Capsule((0, 0, 0), (0, 0, 1), 1, hull=bad)
    with pytest.raises(InputError, match="base: got"):
        checked_capsules("base", [(0, 0, 0)])
