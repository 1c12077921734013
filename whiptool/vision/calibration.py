"""Where the strike plane lies in an image: a homography from known points or a checkerboard, sub-pixel."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from whiptool.errors import InputError
from whiptool.recording.lens import undistort
from whiptool.recording.opencv import opencv
from whiptool.vision.camera_model import apply_homography

_LARGEST_CONDITION = 1e4  # of the design matrix in normalised coordinates; four corners of a rectangle have about 3


@dataclass(frozen=True, eq=False)
class PlaneCalibration:
    """Metres on the strike plane from pixels.

    Args:
        homography: Metres from (undistorted) pixels, homogeneous, (3, 3), its last entry 1.
        residual: Root mean square distance of the known points, in the image [pixels]; 0 for four points.
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
        """Points on the strike plane [m], (..., 2), that pixels (..., 2) show."""
        return apply_homography(self.homography, undistort(pixels, self.camera_matrix, self.distortion))


def calibrate_points(
    pixels: np.ndarray,
    metres: np.ndarray,
    *,
    camera_matrix: np.ndarray | None = None,
    distortion: Sequence[float] = (),
) -> PlaneCalibration:
    """From at least four known points of the strike plane, no three of four on a line.

    Args:
        pixels: Positions in the image, (P, 2).
        metres: Positions on the strike plane [m], (P, 2).
        camera_matrix, distortion: Camera matrix and distortion of the lens, if it distorts; see `PlaneCalibration`.

    Raises:
        InputError: Too few points, shapes that differ, values that are not finite, or points that fix no homography.
    """
    pixels, metres = np.asarray(pixels, float), np.asarray(metres, float)
    for name, value in (("pixels", pixels), ("metres", metres)):
        if value.ndim != 2 or value.shape[1] != 2 or len(value) != len(pixels) or not np.isfinite(value).all():
            raise InputError(name, f"shape {value.shape}", "finite numbers of shape (P, 2), one per known point")
    if len(pixels) < 4:
        raise InputError("pixels", f"{len(pixels)} points", "at least four known points")
    straight = undistort(pixels, camera_matrix, distortion)
    for name, value in (("pixels", straight), ("metres", metres)):
        _refuse_degenerate(name, value)
    # The errors are the image's, so the fit is from metres to pixels
    forward, _ = opencv().findHomography(metres, straight, 0)
    if forward is None or not np.isfinite(forward).all() or abs(np.linalg.det(forward)) < 1e-12:
        raise InputError("pixels", pixels.tolist(), "points that one homography carries onto the plane")
    missed = apply_homography(forward, metres) - straight
    H = np.linalg.inv(forward)
    return PlaneCalibration(
        homography=H / H[2, 2],
        residual=float(np.sqrt((missed**2).sum(axis=1).mean())),
        camera_matrix=None if camera_matrix is None else np.asarray(camera_matrix, float),
        distortion=tuple(float(x) for x in distortion),
    )


def _refuse_degenerate(name: str, points: np.ndarray) -> None:
    """A homography needs four points of which no three are on a line: the null space of its equations tells."""
    spread = np.sqrt(((points - points.mean(axis=0)) ** 2).sum(axis=1).mean())
    if spread > 0:
        x, y = ((points - points.mean(axis=0)) / spread).T
        # Equations of the homography that carries the points onto themselves: degenerate points allow others as well
        one, none = np.ones_like(x), np.zeros_like(x)
        rows = np.concatenate(
            [
                np.stack([x, y, one, none, none, none, -x * x, -x * y, -x], axis=1),
                np.stack([none, none, none, x, y, one, -y * x, -y * y, -y], axis=1),
            ]
        )
        values = np.linalg.svd(rows, compute_uv=False)
        if len(values) > 7 and values[0] < _LARGEST_CONDITION * values[7]:
            return
    raise InputError(
        name, points.tolist(), "four points of which no three lie on a line", "spread them over the whole strike plane"
    )


def find_checkerboard(image: np.ndarray, *, corners: tuple[int, int]) -> np.ndarray:
    """Inner corners of a checkerboard [pixels], (columns x rows, 2), row by row from the upper left.

    Args:
        image: (H, W, 3) or (H, W) of uint8.
        corners: Inner corners along a row, and rows of them; one number odd and one even, so that the board has but
            one way to lie (with its first corner's square of the same colour either way, it may be seen half turned).

    Raises:
        InputError: There is no such board in the image.
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


def calibrate_checkerboard(
    image: np.ndarray,
    *,
    corners: tuple[int, int],
    square: float,
    origin: Sequence[float],
    angle: float = 0.0,
    camera_matrix: np.ndarray | None = None,
    distortion: Sequence[float] = (),
) -> PlaneCalibration:
    """From an image of a checkerboard that lies in the strike plane.

    Args:
        image: (H, W, 3) or (H, W) of uint8.
        corners: Inner corners along a row, and rows of them.
        square: Side of a square [m].
        origin: Position of the first corner (upper left) on the strike plane [m], (2,).
        angle: Angle by which the board's rows are turned from x toward y [rad].
        camera_matrix, distortion: Camera matrix and distortion of the lens, if it distorts; see `PlaneCalibration`.

    Raises:
        InputError: No such board is seen, or a number is out of range.
    """
    if not 0 < square < np.inf:
        raise InputError("square", square, "a side > 0 m")
    pixels = find_checkerboard(image, corners=corners)
    column, row = np.meshgrid(np.arange(corners[0]), np.arange(corners[1]))
    local = square * np.stack([column.ravel(), -row.ravel()], axis=1)  # rows go down, y goes up
    c, s = np.cos(angle), np.sin(angle)
    metres = np.asarray(origin, float) + local @ np.array([[c, s], [-s, c]])
    return calibrate_points(pixels, metres, camera_matrix=camera_matrix, distortion=distortion)
