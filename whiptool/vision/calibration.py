"""Where the strike plane lies in an image: a homography from known points or a board, sub-pixel."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from whiptool.errors import InputError
from whiptool.recording.homography import homography_from_points, to_plane
from whiptool.recording.lens import undistort
from whiptool.vision.boards import Board


@dataclass(frozen=True, eq=False)
class PlaneCalibration:
    """Conversion of pixels to metres on the strike plane.

    Args:
        homography: Homography from undistorted pixels to metres, (3, 3), with last entry 1.
        residual: Root mean square error of the known points in the image [pixels]; 0 for four points.
        camera_matrix: Intrinsics [pixels], (3, 3); needed only with a lens distortion.
        distortion: Coefficients of OpenCV's model (k1, k2, p1, p2[, k3[, k4, k5, k6]]); empty: none.

    Raises:
        InputError: A distortion without a camera matrix.
    """

    homography: np.ndarray
    residual: float = 0.0
    camera_matrix: np.ndarray | None = None
    distortion: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        if self.distortion and self.camera_matrix is None:
            raise InputError("camera_matrix", None, "the intrinsics, (3, 3), wherever there is a lens distortion")

    def to_plane(self, pixels: np.ndarray) -> np.ndarray:
        """Return the points on the strike plane [m], (..., 2), of pixels (..., 2)."""
        return to_plane(self.homography, undistort(pixels, self.camera_matrix, self.distortion))


def calibrate_points(
    pixels: np.ndarray,
    metres: np.ndarray,
    *,
    camera_matrix: np.ndarray | None = None,
    distortion: Sequence[float] = (),
) -> PlaneCalibration:
    """Calibrate from at least four known points of the strike plane; of four points, no three may be on a line.

    Args:
        pixels: Positions in the image, (P, 2).
        metres: Positions on the strike plane [m], (P, 2).
        camera_matrix, distortion: Camera matrix and distortion of the lens, if it distorts; see `PlaneCalibration`.

    Raises:
        InputError: There are too few points, shapes differ, values are not finite, or the points do not determine a
            homography.
    """
    straight = undistort(pixels, camera_matrix, distortion)
    H = homography_from_points(straight, metres)
    missed = to_plane(np.linalg.inv(H), metres) - straight
    return PlaneCalibration(
        homography=H / H[2, 2],
        residual=float(np.sqrt((missed**2).sum(axis=1).mean())),
        camera_matrix=None if camera_matrix is None else np.asarray(camera_matrix, float),
        distortion=tuple(float(x) for x in distortion),
    )


def calibrate_board(
    image: np.ndarray,
    board: Board,
    *,
    origin: Sequence[float],
    angle: float = 0.0,
    camera_matrix: np.ndarray | None = None,
    distortion: Sequence[float] = (),
) -> PlaneCalibration:
    """Calibrate the strike plane with an image of a board that lies in it.

    Args:
        image: (H, W, 3) or (H, W) of uint8.
        board: The board.
        origin: Position of the board's first corner on the strike plane [m], (2,).
        angle: Rotation of the board's rows from x toward y [rad].
        camera_matrix, distortion: Camera matrix and distortion of the lens, if it distorts; see `PlaneCalibration`.

    Raises:
        InputError: The image shows no such board, or too little of it.
    """
    view = board.find(image)
    if not len(view.ids):
        raise InputError("image", f"{image.shape[1]} x {image.shape[0]}", f"one that shows the board, {board}")
    local = board.points[view.ids, :2] * [1, -1]  # its rows go down, y goes up
    c, s = np.cos(angle), np.sin(angle)
    metres = np.asarray(origin, float) + local @ np.array([[c, s], [-s, c]])
    return calibrate_points(view.pixels, metres, camera_matrix=camera_matrix, distortion=distortion)
