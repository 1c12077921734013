"""Calibration of the strike plane: a homography from known points or a board, with sub-pixel accuracy."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol

import numpy as np

from whiptool.errors import InputError
from whiptool.recording.camera import opencv, to_plane, undistort
from whiptool.recording.homography import homography_from_points


@dataclass(frozen=True, eq=False)
class Corners:
    """Corners of a board that an image shows."""

    ids: np.ndarray  # indices of the corners in the board's `points`, (P,)
    pixels: np.ndarray  # their positions in the image, (P, 2)


class Board(Protocol):
    """A flat board with corners that can be found in images."""

    @property
    def points(self) -> np.ndarray:
        """All corners in the board's frame (x along its rows, y down its columns, z into it) [m], (P, 3)."""
        ...

    def find(self, image: np.ndarray) -> Corners:
        """Return the corners that an image (H, W, 3) or (H, W) uint8 shows; empty if there is no board."""
        ...


@dataclass(frozen=True)
class Checkerboard:
    """A checkerboard. It is only detected if it is completely visible, and its first row has to be the upper one.

    Args:
        corners: Number of inner corners along a row, and of rows; one odd and one even.
        square: Side of a square [m].

    Raises:
        InputError: A number is out of range.
    """

    corners: tuple[int, int]
    square: float

    def __post_init__(self) -> None:
        if len(self.corners) != 2 or min(self.corners) < 3 or sum(self.corners) % 2 == 0:
            raise InputError("corners", self.corners, "two numbers >= 3, one odd and one even")
        _check_side("square", self.square)

    @property
    def points(self) -> np.ndarray:
        """Inner corners, row by row [m], (P, 3)."""
        return _grid(*self.corners, self.square)

    def find(self, image: np.ndarray) -> Corners:
        """Return all inner corners, or no corners if the board is not completely visible."""
        try:
            pixels = find_checkerboard(image, corners=self.corners)
        except InputError:
            return Corners(np.zeros(0, int), np.zeros((0, 2)))
        return Corners(np.arange(len(pixels)), pixels)


@dataclass(frozen=True)
class CharucoBoard:
    """A ChArUco board: a checkerboard with a marker in every white square, which is also detected partly and rotated.

    Args:
        squares: Number of squares along a row, and of rows.
        square: Side of a square [m].
        marker: Side of a marker [m].
        dictionary: Dictionary of the markers, by its name in OpenCV.

    Raises:
        InputError: A number is out of range, or the dictionary does not exist.
    """

    squares: tuple[int, int]
    square: float
    marker: float
    dictionary: str = "DICT_4X4_50"

    def __post_init__(self) -> None:
        if len(self.squares) != 2 or min(self.squares) < 3:
            raise InputError("squares", self.squares, "two numbers >= 3")
        _check_side("square", self.square)
        if not 0 < self.marker < self.square:
            raise InputError("marker", self.marker, f"a side > 0 m and smaller than a square's, {self.square:g} m")
        if not hasattr(opencv().aruco, self.dictionary):
            raise InputError("dictionary", self.dictionary, "the name of one in cv2.aruco, such as DICT_4X4_50")

    @property
    def points(self) -> np.ndarray:
        """Inner corners, row by row [m], (P, 3); the first is one square from the board's edges."""
        columns, rows = self.squares
        return _grid(columns - 1, rows - 1, self.square)

    @cached_property
    def _drawn(self) -> Any:
        aruco = opencv().aruco
        dictionary = aruco.getPredefinedDictionary(getattr(aruco, self.dictionary))
        return aruco.CharucoBoard(self.squares, self.square, self.marker, dictionary)

    def find(self, image: np.ndarray) -> Corners:
        """Return the corners that the image shows."""
        cv2 = opencv()
        grey = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY) if image.ndim == 3 else image
        pixels, ids, _, _ = cv2.aruco.CharucoDetector(self._drawn).detectBoard(grey)
        if ids is None or not len(ids):
            return Corners(np.zeros(0, int), np.zeros((0, 2)))
        return Corners(np.ravel(ids), np.reshape(pixels, (-1, 2)).astype(float))

    def draw(self, pixels_per_square: int) -> np.ndarray:
        """Return the board as an image to print, without a margin, uint8 (rows, columns)."""
        columns, rows = self.squares
        return self._drawn.generateImage((columns * pixels_per_square, rows * pixels_per_square))


def _check_side(name: str, side: float) -> None:
    if not 0 < side < np.inf:
        raise InputError(name, side, "a side > 0 m")


def _grid(columns: int, rows: int, side: float) -> np.ndarray:
    x, y = np.meshgrid(np.arange(columns), np.arange(rows))
    return side * np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)


def find_checkerboard(image: np.ndarray, *, corners: tuple[int, int]) -> np.ndarray:
    """Return the inner corners of a checkerboard in an image, (H, W, 3) or (H, W) uint8, [pixels], (columns x rows, 2),
    row by row from the upper left. `corners` are their numbers along a row, and of rows: one odd and one even, so that
    the orientation is unique."""
    cv2 = opencv()
    grey = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY) if image.ndim == 3 else image
    found, at = cv2.findChessboardCornersSB(grey, corners, flags=cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_ACCURACY)
    if not found:
        raise InputError("image", f"{grey.shape[1]} x {grey.shape[0]}", f"a whole checkerboard of {corners} corners")
    at = at.reshape(-1, 2)
    grid = at.reshape(corners[1], corners[0], 2)
    steps = np.concatenate([np.diff(grid, axis=0).reshape(-1, 2), np.diff(grid, axis=1).reshape(-1, 2)])
    window = max(1, int(np.hypot(*steps.T).min() / 4))  # stays clear of the neighbouring corners
    at = cv2.cornerSubPix(
        grey,
        at.astype(np.float32),
        (window, window),
        (-1, -1),
        (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 40, 1e-3),
    ).reshape(-1, 2)
    # The order may run either way round: begin at the end that is further up and to the left
    return at.astype(float)[:: 1 if at[0].sum() <= at[-1].sum() else -1]


@dataclass(frozen=True, eq=False)
class PlaneCalibration:
    """Conversion of pixels to metres on the strike plane."""

    homography: np.ndarray  # from undistorted pixels to metres, (3, 3), with last entry 1
    residual: float = 0.0  # root mean square error of the known points in the image [pixels]; 0 for four points
    camera_matrix: np.ndarray | None = None  # intrinsics [pixels], (3, 3); needed only with a distortion
    distortion: tuple[float, ...] = ()  # of OpenCV's model (k1, k2, p1, p2[, k3[, k4, k5, k6]]); empty: none

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
        raise InputError("image", f"{image.shape[1]} x {image.shape[0]}", f"an image that shows the board, {board}")
    local = board.points[view.ids, :2] * [1, -1]  # its rows go down, y goes up
    c, s = np.cos(angle), np.sin(angle)
    metres = np.asarray(origin, float) + local @ np.array([[c, s], [-s, c]])
    return calibrate_points(view.pixels, metres, camera_matrix=camera_matrix, distortion=distortion)
