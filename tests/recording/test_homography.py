"""From pixels to metres: homographies against a pinhole camera, stretches against differences."""

from __future__ import annotations

import numpy as np
import pytest
from recordings import H, to_pixels
from scipy.spatial.transform import Rotation

from whiptool.errors import InputError
from whiptool.recording.camera import to_plane
from whiptool.recording.homography import (
    checked_homography,
    homography_from_points,
    homography_from_scale,
    metres_per_pixel,
)

INTRINSIC = np.array([[600.0, 0, 320.0], [0, 620.0, 240.0], [0, 0, 1.0]])
TURN = Rotation.from_euler("xyz", [0.2, -0.3, 0.1]).as_matrix() @ np.diag([1.0, -1.0, -1.0])
PLACE = np.array([0.3, -0.2, 3.0])


def pixels(points: np.ndarray) -> np.ndarray:
    """Where a camera sees points of the plane z = 0, by projecting each."""
    in_camera = (np.column_stack([points, np.zeros(len(points))]) - PLACE) @ TURN.T @ INTRINSIC.T
    return in_camera[:, :2] / in_camera[:, 2:]


POINTS = np.random.default_rng(0).uniform(-1, 1, (12, 2))


@pytest.mark.parametrize("count", [4, 12])
def test_known_points_give_the_cameras_map(count):
    H = homography_from_points(pixels(POINTS[:count]), POINTS[:count])
    np.testing.assert_allclose(to_plane(H, pixels(POINTS)), POINTS, atol=1e-9)


def test_many_points_average_their_errors():
    rng = np.random.default_rng(1)
    points = rng.uniform(-1, 1, (400, 2))
    H = homography_from_points(pixels(points) + rng.normal(0, 0.5, (400, 2)), points)
    assert np.abs(to_plane(H, pixels(POINTS)) - POINTS).max() < 1e-3  # half a pixel is 2.5 mm


def test_a_straight_look_has_a_scale():
    H = homography_from_scale(0.002, np.array([100.0, 50.0]))
    np.testing.assert_allclose(
        to_plane(H, np.array([[100, 50], [110, 50], [100, 60]])), [[0, 0], [0.02, 0], [0, -0.02]]
    )
    assert metres_per_pixel(H, np.array([7.0, 9.0])) == pytest.approx(0.002)
    for bad in (0.0, -1.0, np.nan, np.inf):
        with pytest.raises(InputError, match="scale"):
            homography_from_scale(bad, np.zeros(2))


def test_stretch_is_the_mean_square_of_the_local_maps():
    """Jacobian by differences; its two singular values' root mean square."""
    H = homography_from_points(pixels(POINTS), POINTS) * -3.0  # of either sign and any size
    h = 1e-3
    for at in (np.array([100.0, 50.0]), np.array([500.0, 400.0])):
        J = np.stack([(to_plane(H, at + h * e) - to_plane(H, at - h * e)) / (2 * h) for e in np.eye(2)], axis=1)
        singular = np.linalg.svd(J, compute_uv=False)
        assert metres_per_pixel(H, at) == pytest.approx(np.sqrt((singular**2).mean()), rel=1e-5)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_beyond_the_horizon_there_is_no_plane(sign):
    H = sign * np.array([[1.0, 0, 0], [0, 1.0, 0], [-0.01, 0, 1.0]])  # the horizon is at u = 100
    found = to_plane(H, np.array([[50.0, 10.0], [99.0, 0.0], [100.0, 0.0], [150.0, 0.0], [np.nan, 0.0]]))
    np.testing.assert_allclose(found[:2], [[100.0, 20.0], [9900.0, 0.0]])
    assert np.isnan(found[2:]).all()


def test_maps_that_are_none_are_refused():
    good = np.diag([1e-3, 1e-3, 1.0])
    np.testing.assert_array_equal(checked_homography(good), good)
    tiny = np.array([[1e-9, 0, 3.0], [0, 1e-9, 2.0], [0, 0, 1.0]])  # units differ by nine orders: fine
    np.testing.assert_array_equal(checked_homography(tiny), tiny)
    for bad in (
        np.ones((3, 3)),
        np.zeros((3, 3)),
        np.eye(2),
        good * np.nan,
        np.array([[1.0, 2, 0], [2, 4, 0], [0, 0, 1]]),
    ):
        with pytest.raises(InputError, match="homography"):
            checked_homography(bad)
    line = np.stack([np.arange(5.0), 2 * np.arange(5.0)], axis=1)
    for a, b in ((line, POINTS[:5]), (POINTS[:5], line), (np.zeros((5, 2)), POINTS[:5])):
        with pytest.raises(InputError, match=r"pixels|metres"):
            homography_from_points(a, b)
    corner = np.array([[0.0, 0], [1, 0], [2, 0], [0, 1]])  # three of four in a line
    with pytest.raises(InputError, match="three lie on one line"):
        homography_from_points(corner, np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]]))
    for a, b in ((POINTS[:3], POINTS[:3]), (POINTS[:5], POINTS[:4]), (POINTS[:5] * np.nan, POINTS[:5])):
        with pytest.raises(InputError, match=r"pixels|metres"):
            homography_from_points(a, b)


def test_homography_from_points():
    metres = np.array([[0, 0], [1, 0.1], [1.1, 1], [-0.1, 0.9]])
    np.testing.assert_allclose(
        to_plane(homography_from_points(to_pixels(metres), metres), [[300, 200]]),
        to_plane(H, [[300, 200]]),
    )
    around = 300 + 1e-4 * np.array([[0, 0], [1, 0], [0, 1]])
    p = to_plane(H, around)
    stretch = np.sqrt(((p[1:] - p[0]) ** 2).sum() / 2) / 1e-4
    np.testing.assert_allclose(metres_per_pixel(H, around[0]), stretch, rtol=1e-5)
    with pytest.raises(InputError, match="one line"):
        homography_from_points(np.array([[0, 0], [1, 1], [2, 2], [5, 0]]), metres)
    assert np.isnan(to_plane(np.array([[1, 0, 0], [0, 1, 0], [0, -1, 100.0]]), [[0.0, 101.0]])).all()
