"""The camera's map and its measurement model, on straight and even flights in closed form."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from space_films import LEFT, by_opencv

from whiptool.recording.camera import BASELINE, SUBPIXEL, before_plane, camera_preset
from whiptool.vision.exposure import (
    expose,
    measurement_sigma,
    stereo_depth,
)

TURN = Rotation.from_rotvec((0.15, -0.25, 0.1)).as_matrix()
PLAIN = camera_preset("d435-color")  # 3.5 m before the plane, looking straight at it
TILTED = PLAIN.replace(**before_plane((0.4, 0.1, 2.9), TURN))
T = np.linspace(-0.5, 1.5, 4001)


def flight(velocity: tuple[float, float]) -> np.ndarray:
    """From (0.1, -0.2) at time 0."""
    return np.array([0.1, -0.2]) + T[:, None] * np.array(velocity)


def test_a_straight_look_scales_and_turns_y_down():
    points = np.array([[0.0, -0.2], [0.5, 0.3], [-1.0, 0.0]])
    per_metre = 609.0 / 3.5
    expected = [423.5, 239.5] + (points - [0.0, -0.2]) * [per_metre, -per_metre]
    np.testing.assert_allclose(PLAIN.project(points), expected)
    np.testing.assert_allclose(PLAIN.to_plane(expected), points, atol=1e-12)
    assert PLAIN.scale(np.array([0.5, 0.3])) == pytest.approx(per_metre)
    before = PLAIN.project(np.array([0.5, -1.0, -0.2]))  # a metre before the plane
    np.testing.assert_allclose(before, [423.5 + 0.5 * 609.0 / 2.5, 239.5])
    assert np.isnan(PLAIN.project(np.array([0.0, -3.6, 0.0]))).all()


def test_a_tilted_look_goes_there_and_back():
    points = np.random.default_rng(0).uniform(-1, 1, (4, 5, 2))
    assert TILTED.project(points).shape == (4, 5, 2)
    np.testing.assert_allclose(TILTED.to_plane(TILTED.project(points)), points, atol=1e-12)
    assert TILTED.homography[2, 2] == 1
    ahead = np.array([0.0, 0.0, 1.0]) @ TILTED.rotation  # where it looks
    depth = (np.array([0.3, 0.0, 0.2]) - TILTED.position) @ ahead
    assert TILTED.scale(np.array([0.3, 0.2])) == pytest.approx(609.0 / depth)


def test_a_global_shutter_sees_the_middle_of_an_even_flight():
    camera = PLAIN.replace(readout=0.0, exposure=8e-3)
    starts = np.array([0.1, 0.2, 0.35])
    seen = expose(camera, T, flight((3.0, -4.0)), starts)
    np.testing.assert_allclose(seen.t_points, starts + 4e-3)
    np.testing.assert_allclose(seen.duration, 8e-3)
    np.testing.assert_allclose(seen.points, np.array([0.1, -0.2]) + (starts + 4e-3)[:, None] * [3.0, -4.0], atol=1e-9)
    np.testing.assert_allclose(seen.pixels, camera.project(seen.points), atol=1e-6)
    np.testing.assert_allclose(seen.speed, 5.0, rtol=1e-6)


@pytest.mark.parametrize("down", [6.0, -6.0, 0.0])
def test_a_rolling_shutter_sees_longer_what_runs_along_with_its_rows(down):
    """Row and time agree when it opens and closes: `row(t) = row(0) + v t`, `t = start + readout row / height`."""
    v = down * 609.0 / 3.5  # [pixels/s]
    row = 239.5
    per_row = 15e-3 / 480
    opened = (0.0 + per_row * row) / (1 - per_row * v)
    closed = (4e-3 + per_row * row) / (1 - per_row * v)
    seen = expose(PLAIN, T, flight((0.0, -down)), np.array([0.0]))
    np.testing.assert_allclose(seen.t_points, (opened + closed) / 2, rtol=1e-6)
    np.testing.assert_allclose(seen.duration, 4e-3 / (1 - per_row * v), rtol=1e-6)
    np.testing.assert_allclose(seen.points[0], [0.1, -0.2 - down * (opened + closed) / 2], atol=1e-6)
    np.testing.assert_allclose(seen.speed, abs(down), atol=1e-6)


def test_a_point_rests_before_and_after_its_path():
    camera = PLAIN.replace(readout=0.0)
    seen = expose(camera, T, flight((1.0, 0.0)), np.array([-2.0, 3.0]))
    np.testing.assert_allclose(seen.points, [[-0.4, -0.2], [1.6, -0.2]])
    np.testing.assert_allclose(seen.speed, 0)


def test_errors_have_a_floor_and_a_share_of_the_blur():
    """0.04 pixels at rest, and 0.004 of the blur: in metres on the plane."""
    for settings in (PLAIN, camera_preset("d435-infrared")):
        metre = settings.focal_lengths[0] / 3.5
        blur = 20.0 * settings.exposure * metre
        assert measurement_sigma(settings, 0.0) * metre == pytest.approx(0.04)
        assert measurement_sigma(settings, 20.0) * metre == pytest.approx(np.sqrt(0.04**2 + (0.004 * blur) ** 2))


FOCAL = LEFT.focal_lengths[0]


def seen_by_a_pair(depth: float, count: int = 40_000) -> np.ndarray:
    """Depths [m] of a point before two cameras 50 mm apart, whose pixels err by 0.08 together, from their disparity."""
    left = dataclasses.replace(LEFT, distortion=())
    right = dataclasses.replace(left, position=left.position + 0.05 * left.rotation[0])
    place = left.position + left.rotation.T @ np.array([0.1, -0.2, 1.0]) * depth
    u = [by_opencv(camera, place[None])[0, 0] for camera in (left, right)]
    assert u[0] > u[1]
    errors = np.random.default_rng(0).normal(0, 0.08 / np.sqrt(2), (2, count))
    return FOCAL * 0.05 / ((u[0] + errors[0]) - (u[1] + errors[1]))


@pytest.mark.parametrize("depth", [0.8, 1.6, 3.2])
def test_the_error_is_that_of_a_pair_of_cameras(depth):
    measured = seen_by_a_pair(depth)
    assert LEFT.depth_error(depth) == pytest.approx(measured.std(), rel=0.02)
    assert LEFT.depth_error(depth) == pytest.approx(depth**2 * 0.08 / (430.0 * 0.05))
    simulated = stereo_depth(LEFT, np.full(40_000, depth), np.random.default_rng(1))
    np.testing.assert_allclose(
        np.quantile(simulated, [0.02, 0.5, 0.98]), np.quantile(measured, [0.02, 0.5, 0.98]), rtol=2e-3
    )


def test_the_error_shrinks_with_a_longer_baseline_and_finer_disparity():
    usual = LEFT.depth_error(2.0)
    assert (BASELINE, SUBPIXEL) == (0.05, 0.08)
    assert LEFT.depth_error(2.0, baseline=0.1) == pytest.approx(usual / 2)
    assert LEFT.depth_error(2.0, subpixel=0.02) == pytest.approx(usual / 4)


def test_what_is_too_far_or_was_not_there_has_no_depth():
    """At 300 m the disparity is less than its error."""
    found = stereo_depth(LEFT, np.array([np.nan, *np.full(200, 300.0)]), np.random.default_rng(0))
    assert np.isnan(found[0])
    assert 0.1 < np.mean(found[1:] == 0) < 0.4
    assert (found[1:] >= 0).all()
