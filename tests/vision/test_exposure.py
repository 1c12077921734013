"""The camera's map and its measurement model, on straight and even flights in closed form."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from whiptool.recording.camera import before_plane, camera_preset
from whiptool.vision.exposure import expose, measurement_sigma

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
