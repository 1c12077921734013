"""Cameras in space against OpenCV's projection, and their limits."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from whiptool.errors import InputError
from whiptool.recording.space_camera import SpaceCamera, looking_at

cv2 = pytest.importorskip("cv2", reason="needs the extra `vision`")
RNG = np.random.default_rng(3)
K = np.array([[610.0, 0, 420.5], [0, 605.0, 238.0], [0, 0, 1]])
EIGHT = (0.1, -0.2, 1e-3, -8e-4, 0.05, 0.02, 0.01, -0.03)
LENSES = [EIGHT[:n] for n in (0, 4, 5, 8)]
POINTS = RNG.uniform(-0.5, 0.5, (40, 3))


def camera(lens=()) -> SpaceCamera:
    position = np.array([2.0, -1.5, 0.8])
    R = Rotation.from_rotvec([0.02, -0.05, 0.3]).as_matrix() @ looking_at(position, [0, 0, 0])
    return SpaceCamera("left", 848, 480, K, R, position, lens)


@pytest.mark.parametrize("lens", LENSES, ids=len)
def test_pixels_are_where_opencv_has_them(lens):
    seen = camera(lens)
    vector, _ = cv2.Rodrigues(seen.rotation)
    theirs, _ = cv2.projectPoints(POINTS, vector, -seen.rotation @ seen.position, K, np.array(lens))
    np.testing.assert_allclose(seen.project(POINTS), theirs[:, 0], atol=1e-9)


@pytest.mark.parametrize("lens", LENSES, ids=len)
def test_a_pixel_looks_at_the_point_that_it_shows(lens):
    seen = camera(lens)
    away = POINTS - seen.position
    expected = away / np.linalg.norm(away, axis=1, keepdims=True)
    np.testing.assert_allclose(seen.sights(seen.project(POINTS)), expected, atol=1e-7)


def test_what_is_seen_is_before_the_camera_and_within_its_image():
    seen = camera()
    ahead = seen.position + 3 * seen.rotation[2]
    behind = seen.position - 3 * seen.rotation[2]
    beside = ahead + 5 * seen.rotation[0]
    np.testing.assert_array_equal(seen.sees(np.stack([ahead, behind, beside])), [True, False, False])
    np.testing.assert_allclose(seen.project(ahead), seen.principal_point, atol=1e-9)
    assert np.isnan(seen.project(behind)).all()


def test_a_camera_that_looks_at_a_point_stands_upright():
    R = looking_at(np.array([1.0, 2.0, 0.5]), np.array([0.0, 0.0, 0.7]))
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(R) == pytest.approx(1)
    assert R[0, 2] == pytest.approx(0)  # its rows are level
    assert R[1, 2] < 0  # down is down
    np.testing.assert_allclose(np.cross(R[2], [-1.0, -2.0, 0.2]), 0, atol=1e-12)
    with pytest.raises(InputError, match="straight above or below"):
        looking_at(np.zeros(3), np.array([0, 0, 1.0]))


def test_rows_are_read_one_after_the_other():
    rolling = SpaceCamera("r", 848, 480, K, np.eye(3), np.zeros(3), readout=0.015)
    np.testing.assert_allclose(rolling.row_delay(np.array([0.0, 240.0, 480.0])), [0, 0.0075, 0.015])


@pytest.mark.parametrize(
    ("changed", "told"),
    [
        ({"width": 0}, "width: got 0"),
        ({"readout": -1.0}, "readout"),
        ({"exposure": np.nan}, "exposure"),
        ({"camera_matrix": np.eye(2)}, r"camera_matrix: .* shape \(3, 3\)"),
        ({"camera_matrix": np.diag([-600.0, 600, 1])}, "fx and fy > 0"),
        ({"rotation": 2 * np.eye(3)}, "a rotation matrix"),
        ({"rotation": np.diag([1.0, 1, -1])}, "a rotation matrix"),
        ({"position": (0.0, 0)}, "position"),
        ({"distortion": (0.1, 0.2)}, "distortion: .* 0, 4, 5, 8"),
    ],
)
def test_what_is_no_camera_is_refused(changed, told):
    pose = {"rotation": np.eye(3), "position": np.zeros(3)}
    whole = {"name": "x", "width": 848, "height": 480, "camera_matrix": K, **pose}
    with pytest.raises(InputError, match=told):
        SpaceCamera(**(whole | changed))


@pytest.mark.parametrize("lens", LENSES, ids=len)
def test_slopes_are_those_of_differences(lens):
    """Pixels by places, through every lens."""
    seen = camera(lens)
    points = np.random.default_rng(3).uniform([-0.2, -0.7, -0.1], [1.2, 0.7, 1.3], (20, 3))
    steps = 1e-6 * np.eye(3)
    differences = [(seen.project(points + step) - seen.project(points - step)) / 2e-6 for step in steps]
    np.testing.assert_allclose(seen.slopes(points), np.stack(differences, axis=-1), rtol=1e-5, atol=1e-3)
