"""Boards are found where they are drawn."""

from __future__ import annotations

import numpy as np
import pytest

from whiptool.errors import InputError
from whiptool.vision.boards import CharucoBoard, Checkerboard

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
