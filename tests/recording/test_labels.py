"""Labels that were exchanged or swallowed are found, and those that were not are left alone."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from whiptool.recording import StrikeRecording
from whiptool.recording.camera import Camera
from whiptool.recording.labels import check_labels, put_back

NAMES = ("tip", "node8", "node4", "handle")
T = np.arange(0, 0.8, 1 / 120)
SIGMA = 1e-3


def swung(seed: int = 0) -> StrikeRecording:
    """Four markers on a rod of a metre that turns faster and faster, and whose axis turns, too."""
    rng = np.random.default_rng(seed)
    angle, tilt = 8 * T**2 + rng.uniform(0, 6), 2 * T
    along = np.stack([np.cos(angle), np.sin(angle) * np.cos(tilt), np.sin(angle) * np.sin(tilt)], axis=1)
    points = along[:, None] * np.array([1.0, 0.7, 0.4, 0.1])[:, None]
    return StrikeRecording(T, points + rng.normal(0, SIGMA, points.shape), NAMES, sigma=np.array(SIGMA))


def exchanged(recording: StrikeRecording, first: int, last: int, *columns: int) -> StrikeRecording:
    """The columns, each in the place of the one before it, from one frame to before another."""
    points = recording.points.copy()
    points[first:last, list(columns)] = points[first:last, [*columns[1:], columns[0]]]
    return dataclasses.replace(recording, points=points)


@pytest.mark.parametrize("seed", range(5))
def test_labels_that_stay_are_left_alone(seed):
    found = check_labels(swung(seed))
    assert found.kept
    assert str(found) == "all labels stay with their markers"
    np.testing.assert_array_equal(found.order, np.tile(np.arange(4), (len(T), 1)))


def test_two_labels_are_exchanged_for_good():
    whole = swung()
    found = check_labels(exchanged(whole, 50, len(T), 0, 2))
    (one,) = found.exchanges
    assert one.t == pytest.approx(T[50])
    assert set(zip(one.before, one.markers, strict=True)) == {("tip", "node4"), ("node4", "tip")}
    assert "tip became node4" in str(found)
    assert "at 0.417 s" in str(found)
    np.testing.assert_array_equal(put_back(exchanged(whole, 50, len(T), 0, 2), found).points, whole.points)


def test_depth_goes_with_its_label():
    """As a camera on the axis sees them, a metre of the rod being 200 pixels."""
    whole = swung()
    view = Camera("left", 640, 480, np.diag([200.0, 200.0, 1.0]), np.eye(3), np.zeros(3))
    depth = np.tile([1.0, 2.0, 3.0, 4.0], (len(T), 1))
    pixels = 250 + 200 * whole.points[..., :2]
    seen = dataclasses.replace(whole, points=pixels, view=view, sigma=0.2, t_points=None, depth=depth)
    bad = exchanged(seen, 50, len(T), 0, 2)
    swapped = depth.copy()
    swapped[50:, [0, 2]] = swapped[50:, [2, 0]]
    bad = dataclasses.replace(bad, depth=swapped)
    back = put_back(bad, check_labels(bad))
    np.testing.assert_array_equal(back.depth, depth)
    np.testing.assert_array_equal(back.points, pixels)


def test_labels_come_back():
    """Three labels move round and back: two exchanges, and points and their errors as they were."""
    whole = swung()
    sigma = np.broadcast_to([1e-3, 2e-3, 3e-3, 4e-3], whole.seen.shape)
    whole = dataclasses.replace(whole, sigma=sigma)
    bad = exchanged(whole, 30, 60, 0, 1, 2)
    moved = sigma.copy()
    moved[30:60, [0, 1, 2]] = moved[30:60, [1, 2, 0]]
    bad = dataclasses.replace(bad, sigma=moved)
    found = check_labels(bad)
    assert [round(one.t * 120) for one in found.exchanges] == [30, 60]
    assert len(found.exchanges[0].markers) == 3
    mended = put_back(bad, found)
    np.testing.assert_array_equal(mended.points, whole.points)
    np.testing.assert_array_equal(mended.sigma, whole.sigma)


def test_an_exchange_in_a_gap_of_some_frames_is_found():
    whole = swung()
    points = exchanged(whole, 42, len(T), 0, 3).points.copy()
    points[40:42, [0, 3]] = np.nan
    found = check_labels(dataclasses.replace(whole, points=points))
    assert [round(one.t * 120) for one in found.exchanges] == [42]


def test_markers_that_pass_each_other_closely_are_not_accused():
    """Paths that cross within the noise: whose label is whose, no motion tells."""
    x = np.stack([np.stack([T, 2e-3 + 0 * T], -1), np.stack([0.8 - T, 0 * T], -1)], axis=1)
    noisy = x + np.random.default_rng(1).normal(0, SIGMA, x.shape)
    assert not check_labels(StrikeRecording(T, noisy, ("a", "b"), sigma=np.array(SIGMA))).exchanges


def test_a_marker_that_swallows_another_is_told_and_both_are_left_out():
    whole = swung()
    points = whole.points.copy()
    points[20:31, 1] = points[20:31, 0] + np.random.default_rng(2).normal(0, SIGMA / 2, (11, 3))
    bad = dataclasses.replace(whole, points=points)
    found = check_labels(bad)
    (one,) = found.swallowed
    assert set(one.markers) == {"tip", "node8"}
    assert (round(one.start * 120), round(one.end * 120)) == (20, 30)
    mended = put_back(bad, found)
    assert np.isnan(mended.points[20:31, :2]).all()
    np.testing.assert_array_equal(mended.points[:, 2:], whole.points[:, 2:])
    np.testing.assert_array_equal(mended.points[31:], whole.points[31:])


def test_two_names_of_one_place_are_meant_so():
    whole = swung()
    points = whole.points.copy()
    points[:, 3] = points[:, 2]
    assert check_labels(dataclasses.replace(whole, points=points)).kept
