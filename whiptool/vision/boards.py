"""Calibration boards: where their corners are, and where an image shows them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol

import numpy as np

from whiptool.errors import InputError
from whiptool.recording.opencv import opencv


@dataclass(frozen=True, eq=False)
class Corners:
    """Corners of a board that an image shows.

    Args:
        ids: Indices of the corners in the board's `points`, (P,).
        pixels: Their positions in the image, (P, 2).
    """

    ids: np.ndarray
    pixels: np.ndarray


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
    """Return the inner corners of a checkerboard [pixels], (columns x rows, 2), row by row from the upper left.

    Args:
        image: Image, (H, W, 3) or (H, W) uint8.
        corners: Number of inner corners along a row, and of rows; one odd and one even, so that the orientation is
            unique.

    Raises:
        InputError: The image shows no such board.
    """
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
