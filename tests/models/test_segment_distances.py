"""Distances of segments: against coal's capsules, and by hand where segments are points or parallel."""

from __future__ import annotations

import coal
import numpy as np
import pytest

from whiptool.models.segment_distances import nearest_points


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
