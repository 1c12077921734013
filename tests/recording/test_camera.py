"""Cameras against OpenCV's projection, before the plane and anywhere; their limits, and their files."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from whiptool.errors import InputError
from whiptool.recording.camera import (
    CAMERAS,
    Camera,
    before_plane,
    camera_preset,
    looking_at,
    pinhole,
    read_cameras,
    to_plane,
    write_cameras,
)

cv2 = pytest.importorskip("cv2", reason="needs the extra `vision`")
RNG = np.random.default_rng(3)
K = np.array([[610.0, 0, 420.5], [0, 605.0, 238.0], [0, 0, 1]])
EIGHT = (0.1, -0.2, 1e-3, -8e-4, 0.05, 0.02, 0.01, -0.03)
LENSES = [EIGHT[:n] for n in (0, 4, 5, 8)]
POINTS = RNG.uniform(-0.5, 0.5, (40, 3))


def camera(lens=()) -> Camera:
    position = np.array([2.0, -1.5, 0.8])
    R = Rotation.from_rotvec([0.02, -0.05, 0.3]).as_matrix() @ looking_at(position, [0, 0, 0])
    return Camera("left", 848, 480, K, R, position, lens)


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
    rolling = Camera("r", 848, 480, K, np.eye(3), np.zeros(3), readout=0.015)
    np.testing.assert_allclose(rolling.row_delay(np.array([0.0, 240.0, 480.0])), [0, 0.0075, 0.015])


@pytest.mark.parametrize(
    ("changed", "told"),
    [
        ({"width": 0}, "width: got 0"),
        ({"readout": -1.0}, "readout"),
        ({"kind": "x-ray"}, "kind: .* color or infrared"),
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
        Camera(**(whole | changed))


@pytest.mark.parametrize("lens", LENSES, ids=len)
def test_slopes_are_those_of_differences(lens):
    """Pixels by places, through every lens."""
    seen = camera(lens)
    points = np.random.default_rng(3).uniform([-0.2, -0.7, -0.1], [1.2, 0.7, 1.3], (20, 3))
    steps = 1e-6 * np.eye(3)
    differences = [(seen.project(points + step) - seen.project(points - step)) / 2e-6 for step in steps]
    np.testing.assert_allclose(seen.slopes(points), np.stack(differences, axis=-1), rtol=1e-5, atol=1e-3)


@pytest.mark.parametrize("name", CAMERAS)
def test_a_camera_before_the_plane_agrees_with_opencv_and_comes_back(name):
    """In the plane's own axes (x, up, toward the camera), with the camera's pose composed by hand."""
    turn, place = Rotation.from_rotvec((0.12, -0.2, 0.3)).as_matrix(), np.array([0.4, 0.3, 2.8])
    settings = camera_preset(name).replace(**before_plane(place, turn))
    points = np.random.default_rng(1).uniform(-1, 1, (50, 3))
    R = turn @ np.diag([1.0, -1.0, -1.0])
    rvec, _ = cv2.Rodrigues(R)
    expected, _ = cv2.projectPoints(points, rvec, -R @ place, settings.camera_matrix, np.zeros(4))
    in_world = np.stack([points[:, 0], -points[:, 2], points[:, 1]], axis=1)
    np.testing.assert_allclose(settings.project(in_world), expected[:, 0], atol=1e-9)
    plane = points[:, :2]
    np.testing.assert_allclose(settings.project(plane), settings.project(in_world * [1, 0, 1]), atol=1e-12)
    np.testing.assert_allclose(settings.to_plane(settings.project(plane)), plane, atol=1e-12)
    forward, _ = cv2.findHomography(settings.project(plane), plane, 0)
    np.testing.assert_allclose(forward / forward[2, 2], settings.homography, rtol=1e-6, atol=1e-9)
    assert np.isnan(settings.project(np.array([0.4, -9.0, 0.3]))).all()  # behind the camera


def test_presets_have_the_field_of_view_of_the_data_sheet():
    for name, across, fps, shutter in (("d435-color", 69, 60, True), ("d435-infrared", 90, 90, False)):
        settings = camera_preset(name)
        assert np.rad2deg(2 * np.arctan(settings.width / 2 / settings.focal_lengths[0])) == pytest.approx(
            across, abs=1.5
        )
        assert (settings.fps, settings.width, settings.height) == (fps, 848, 480)
        assert (settings.readout > 0) is shutter
        assert settings.distance == 3.5


def test_a_camera_behind_the_plane_or_looking_away_is_refused():
    for position, turn in (((0, 0, -1), np.eye(3)), ((0, 0, 1), Rotation.from_rotvec((0, np.pi, 0)).as_matrix())):
        with pytest.raises(InputError, match="a camera in front of the plane that faces it"):
            before_plane(position, turn)
    with pytest.raises(InputError, match="d435-color"):
        camera_preset("kinect")


def test_a_plane_that_faces_the_camera_has_its_scale():
    """By hand: 3 m ahead, a pixel beside the axis is 3 m over the focal length aside."""
    seen = Camera("x", 848, 480, pinhole(600, 500, 400, 200), np.eye(3), np.zeros(3))
    found = to_plane(seen.facing(3.0), np.array([[400.0, 200.0], [401.0, 200.0], [400.0, 201.0]]))
    np.testing.assert_allclose(found, [[0, 0], [3 / 600, 0], [0, -3 / 500]], atol=1e-15)


def test_cameras_are_the_same_if_all_their_numbers_are():
    assert camera() == camera()
    assert camera() != camera().replace(fps=61.0)
    assert camera() != camera(EIGHT)


PLACE = np.array([2.0, -1.5, 0.8])
LEFT = Camera("left", 848, 480, K, looking_at(PLACE, (0, 0, 1 / 3)), PLACE, (0.1, -0.2, 1e-3, -8e-4), 90.0, 2e-3, 0.01)
RIGHT = Camera("right", 640, 480, K, looking_at(-PLACE, (0, 0, 1 / 3)), -PLACE)


def test_a_file_gives_back_the_cameras(tmp_path):
    file = tmp_path / "cameras.toml"
    write_cameras(file, {"left": LEFT, "right": RIGHT})
    read = read_cameras(file)
    assert list(read) == ["left", "right"]
    points = np.random.default_rng(0).uniform(-0.5, 0.5, (9, 3))
    for camera in (LEFT, RIGHT):
        np.testing.assert_array_equal(read[camera.name].project(points), camera.project(points))
        for name in ("width", "height", "fps", "exposure", "readout", "distortion", "name"):
            assert getattr(read[camera.name], name) == getattr(camera, name)


@pytest.mark.parametrize(
    ("changed", "told"),
    [
        (lambda text: "a = 1", r"cameras\.toml: got 'a'"),
        (lambda text: "[", "valid TOML"),
        (lambda text: text.replace("width = 848", ""), r"cameras\.left\.width: got None"),
        (lambda text: text.replace("width", "wide"), r"cameras\.left\.wide"),
        (lambda text: text.replace("width = 848", "width = 0"), r"cameras\.left\.width: got 0"),
        (lambda text: text.replace("width = 848", 'width = "a"'), r"cameras\.left"),
        (lambda text: text.replace("848", '848\nname = "x"'), r"cameras\.left"),
    ],
)
def test_what_is_no_file_of_cameras_gets_one_line(changed, told, tmp_path):
    file = tmp_path / "cameras.toml"
    write_cameras(file, {"left": LEFT})
    file.write_text(changed(file.read_text()))
    with pytest.raises(InputError, match=told) as error:
        read_cameras(file)
    assert "\n" not in str(error.value)
