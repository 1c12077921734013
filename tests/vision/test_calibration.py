"""The strike plane's calibration against a pinhole camera and a drawn checkerboard."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from whiptool.errors import InputError
from whiptool.recording.camera import before_plane, camera_preset, undistort
from whiptool.vision.calibration import (
    CharucoBoard,
    Checkerboard,
    PlaneCalibration,
    calibrate_board,
    calibrate_points,
    find_checkerboard,
)

cv2 = pytest.importorskip("cv2", reason="needs the extra `vision`")
CHARUCO = CharucoBoard((7, 5), 0.04, 0.03)


def carried(image: np.ndarray, H: np.ndarray, size=(848, 480)) -> np.ndarray:
    """The image under a homography of its pixels, on a grey ground."""
    return cv2.warpPerspective(image, H, size, flags=cv2.INTER_AREA, borderValue=128)


def through(H: np.ndarray, points: np.ndarray) -> np.ndarray:
    x = np.column_stack([points, np.ones(len(points))]) @ H.T
    return x[:, :2] / x[:, 2:]


def test_a_part_of_a_charuco_board_tells_which_corners_it_has():
    drawn = CHARUCO.draw(60)  # corners of squares lie between pixels: at 60 k - 0.5
    H = np.array([[0.9, 0.2, 90], [-0.25, 1.0, 110], [2e-4, 1e-4, 1]])
    found = CHARUCO.find(carried(drawn, H))
    assert len(found.ids) == 24
    expected = through(H, 60 * (CHARUCO.points[found.ids, :2] / CHARUCO.square + 1) - 0.5)
    np.testing.assert_allclose(found.pixels, expected, atol=0.3)
    hidden = carried(drawn, H)
    hidden[:, :300] = 128
    part = CHARUCO.find(hidden)
    assert 4 < len(part.ids) < 24
    np.testing.assert_allclose(part.pixels, expected[np.searchsorted(found.ids, part.ids)], atol=0.3)


def test_a_checkerboard_is_found_whole_or_not_at_all():
    board = Checkerboard((6, 5), 0.05)
    squares = np.kron(np.indices((6, 7)).sum(axis=0) % 2, np.ones((50, 50)))
    drawn = np.pad((255 * squares).astype(np.uint8), 50, constant_values=255)
    found = board.find(np.stack([drawn] * 3, axis=-1))
    np.testing.assert_allclose(found.pixels, 50 * (board.points[:, :2] / board.square + 2) - 0.5, atol=0.3)
    np.testing.assert_array_equal(found.ids, np.arange(30))
    drawn[:, :180] = 128
    assert len(board.find(drawn).ids) == 0


def test_no_board_gives_no_corners():
    assert len(CHARUCO.find(np.full((100, 100), 128, np.uint8)).ids) == 0


@pytest.mark.parametrize(
    ("made", "told"),
    [
        (lambda: Checkerboard((6, 4), 0.05), "corners"),
        (lambda: Checkerboard((6, 5), 0.0), "square"),
        (lambda: CharucoBoard((2, 5), 0.04, 0.03), "squares"),
        (lambda: CharucoBoard((7, 5), 0.04, 0.05), "marker"),
        (lambda: CharucoBoard((7, 5), 0.04, 0.03, "DICT_NONE"), "dictionary"),
    ],
)
def test_what_is_no_board_is_refused(made, told):
    with pytest.raises(InputError, match=told):
        made()


pytest.importorskip("cv2", reason="needs the extra `vision`")

TURN = Rotation.from_rotvec((0.15, -0.25, 0.1)).as_matrix()
CAMERA = camera_preset("d435-color").replace(**before_plane((0.4, 0.1, 2.9), TURN))
POINTS = np.random.default_rng(0).uniform(-1, 1, (30, 2))


@pytest.mark.parametrize("count", [4, 30])
def test_known_points_give_the_plane(count):
    found = calibrate_points(CAMERA.project(POINTS[:count]), POINTS[:count])
    np.testing.assert_allclose(found.to_plane(CAMERA.project(POINTS)), POINTS, atol=1e-5)
    assert found.homography[2, 2] == 1
    assert found.residual < 1e-4
    assert found.camera_matrix is None


def test_the_residual_is_the_root_mean_square_distance_in_the_image():
    """By hand: the map from metres to pixels of the calibration itself, and the distances that it leaves."""
    rng = np.random.default_rng(1)
    pixels = CAMERA.project(POINTS) + rng.normal(0, 2.0, (30, 2))
    found = calibrate_points(pixels, POINTS)
    back = np.linalg.inv(found.homography)
    x = np.column_stack([POINTS, np.ones(30)]) @ back.T
    missed = x[:, :2] / x[:, 2:] - pixels
    assert found.residual == pytest.approx(np.sqrt((missed**2).sum() / 30), rel=1e-6)
    assert found.residual == pytest.approx(2 * np.sqrt(2) * np.sqrt(1 - 8 / 60), rel=0.2)


def distort(pixels: np.ndarray, lens: tuple[float, ...]) -> np.ndarray:
    """Brown and Conrady's model, as OpenCV documents it: k1, k2, p1, p2, k3."""
    k1, k2, p1, p2, k3 = lens
    x, y = ((pixels - CAMERA.principal_point) / CAMERA.focal_lengths).T
    r2 = x**2 + y**2
    radial = 1 + k1 * r2 + k2 * r2**2 + k3 * r2**3
    u = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x**2)
    v = y * radial + p1 * (r2 + 2 * y**2) + 2 * p2 * x * y
    return np.stack([u, v], axis=1) * CAMERA.focal_lengths + CAMERA.principal_point


def test_a_lens_is_taken_out_before_anything_else():
    lens = (0.12, -0.25, 1e-3, -5e-4, 0.05)
    straight = CAMERA.project(POINTS)
    seen = distort(straight, lens)
    assert np.abs(seen - straight).max() > 3
    np.testing.assert_allclose(undistort(seen, CAMERA.camera_matrix, lens), straight, atol=1e-4)
    found = calibrate_points(seen, POINTS, camera_matrix=CAMERA.camera_matrix, distortion=lens)
    np.testing.assert_allclose(found.to_plane(seen), POINTS, atol=1e-5)
    assert found.distortion == lens
    grid = seen.reshape(5, 6, 2)
    assert undistort(grid, CAMERA.camera_matrix, lens).shape == (5, 6, 2)
    np.testing.assert_array_equal(undistort(seen), seen)
    np.testing.assert_array_equal(undistort(seen, CAMERA.camera_matrix), seen)
    assert undistort(np.zeros((0, 2)), CAMERA.camera_matrix, lens).shape == (0, 2)
    with pytest.raises(InputError, match="camera_matrix"):
        PlaneCalibration(np.eye(3), distortion=lens)


@pytest.mark.parametrize(
    "metres",
    [
        np.stack([np.arange(4.0), np.arange(4.0)], axis=1),
        np.array([[0.0, 0], [1, 0], [2, 0], [0, 1]]),
        np.tile([1.0, 2.0], (4, 1)),
        POINTS[[0, 0, 1, 2]],
    ],
)
def test_points_that_fix_no_plane_are_refused(metres):
    square = np.array([[0.0, 0], [100, 0], [100, 100], [0, 100]])
    with pytest.raises(InputError, match=r"metres.*no three lie on one line"):
        calibrate_points(square, metres)
    with pytest.raises(InputError, match=r"pixels.*no three lie on one line"):
        calibrate_points(metres, square)


def test_a_small_square_far_from_the_origin_fixes_a_plane():
    """Only how the points lie to each other counts."""
    square = np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]])
    found = calibrate_points(1000 + 20 * square, 30 + 0.1 * square)
    np.testing.assert_allclose(found.to_plane(np.array([1010.0, 1010.0])), [30.05, 30.05], atol=1e-3)


def test_points_are_checked():
    pixels = CAMERA.project(POINTS)
    for a, b in ((pixels[:3], POINTS[:3]), (pixels, POINTS[:9]), (pixels * np.nan, POINTS), (pixels[:, :1], POINTS)):
        with pytest.raises(InputError):
            calibrate_points(a, b)


COLUMNS, ROWS, SQUARE, ORIGIN, ANGLE = 7, 4, 0.1, np.array([-0.2, 0.3]), 0.2


@pytest.fixture(scope="module")
def board() -> np.ndarray:
    """A checkerboard in the strike plane as the camera sees it: every pixel's place on the plane, nine rays each."""
    image = np.zeros((CAMERA.height, CAMERA.width))
    c, s = np.cos(ANGLE), np.sin(ANGLE)
    for du in (-1 / 3, 0, 1 / 3):
        for dv in (-1 / 3, 0, 1 / 3):
            u, v = np.meshgrid(np.arange(CAMERA.width) + du, np.arange(CAMERA.height) + dv)
            x, y = np.moveaxis(CAMERA.to_plane(np.stack([u, v], axis=-1)) - ORIGIN, -1, 0)
            along, down = (c * x + s * y) / SQUARE, (s * x - c * y) / SQUARE  # from the first inner corner
            dark = (np.floor(along) + np.floor(down)) % 2 == 0
            on = (along > -1) & (along < COLUMNS) & (down > -1) & (down < ROWS)
            image += np.where(on & dark, 20, 220) / 9
    return np.repeat(image.round().astype(np.uint8)[..., None], 3, axis=2)


def test_a_checkerboard_gives_the_plane(board):
    found = calibrate_board(board, Checkerboard((COLUMNS, ROWS), SQUARE), origin=ORIGIN, angle=ANGLE)
    np.testing.assert_allclose(found.to_plane(CAMERA.project(POINTS / 2)), POINTS / 2, atol=2e-3)
    assert found.residual < 0.1
    with pytest.raises(InputError, match=r"image: got '120 x 90'.*shows the board"):
        calibrate_board(board[:90, :120], Checkerboard((COLUMNS, ROWS), SQUARE), origin=ORIGIN)


def test_corners_come_row_by_row_from_the_upper_left(board):
    column, row = np.meshgrid(np.arange(COLUMNS), np.arange(ROWS))
    local = SQUARE * np.stack([column.ravel(), -row.ravel()], axis=1)
    c, s = np.cos(ANGLE), np.sin(ANGLE)
    expected = CAMERA.project(
        ORIGIN + np.stack([c * local[:, 0] - s * local[:, 1], s * local[:, 0] + c * local[:, 1]], axis=1)
    )
    for image in (board, board[..., 0]):
        np.testing.assert_allclose(find_checkerboard(image, corners=(COLUMNS, ROWS)), expected, atol=0.25)
    with pytest.raises(InputError, match=r"whole checkerboard of \(9, 6\)"):
        find_checkerboard(board[:90, :120], corners=(9, 6))
