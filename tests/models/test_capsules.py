"""Capsules and distances of segments: against coal's shapes, and by hand for points and parallel segments."""

from __future__ import annotations

import itertools

import coal
import numpy as np
import pytest

from whiptool.errors import InputError
from whiptool.models.capsules import DIRECTIONS, Capsule, checked_capsules, nearest_points
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


@pytest.mark.parametrize("kind", ["box", "cylinder", "capsule", "points", "plate"])
def test_the_shape_around_points_holds_them_and_is_as_thick_as_it_says(kind):
    """Points of a simple shape get that shape, within their spacing; the distance to coal's solid is 0 for each."""
    rng = np.random.default_rng(1)
    R, p = rotation_about((0.0, 0.6, 0.8), 1.1), np.array([0.1, -0.2, 0.3])
    angle = np.linspace(0, 2 * np.pi, 200, endpoint=False)
    circle = np.stack([0.05 * np.cos(angle), 0.05 * np.sin(angle), 0 * angle], axis=1)
    ball, up = 0.05 * DIRECTIONS, np.array([0.0, 0.0, 0.2])
    own = {
        "box": np.array(list(itertools.product((-0.1, 0.1), (-0.05, 0.05), (-0.2, 0.2)))),
        "cylinder": np.vstack([circle + up / 2, circle - up / 2]),
        "capsule": np.vstack([ball + up, ball - up]),
        "points": rng.normal(size=(50, 3)) * [0.1, 0.2, 0.05],
        "plate": np.array(list(itertools.product((-0.1, 0.1), (-0.05, 0.05), (0.0,)))),
    }[kind]
    shape = Capsule.around(own @ R.T + p, [np.eye(3), R])
    assert (shape.width is not None, shape.flat) == (kind in ("box", "points", "plate"), kind == "cylinder")
    pose = coal.Transform3s(shape.rotation, (np.array(shape.start) + shape.end) / 2)
    for point in own @ R.T + p:
        at = coal.Transform3s(np.eye(3), point)
        apart = coal.distance(shape.solid(), pose, coal.Sphere(1e-6), at, coal.DistanceRequest(), coal.DistanceResult())
        assert apart < 1e-6
    thicker = shape.beyond(own @ R.T + p)
    assert thicker < {"box": 1e-9, "cylinder": 1e-3, "capsule": 1e-3, "plate": 6e-4}.get(kind, np.inf)
    assert kind != "points" or thicker > 0.02


def test_what_is_no_capsule():
    with pytest.raises(InputError, match="radius: got -1"):
        Capsule((0, 0, 0), (0, 0, 1), -1)
    with pytest.raises(InputError, match="start: got"):
        Capsule((0, 0), (0, 0, 1), 1)
    with pytest.raises(InputError, match="base: got"):
        checked_capsules("base", [(0, 0, 0)])
