"""From pixels to metres in the strike plane: homographies, made from a matrix, four points, or a scale.

Pixel (0, 0) is the centre of the image's first pixel, u goes right, v down, as in OpenCV.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from whiptool.errors import InputError


def checked_homography(matrix: np.ndarray) -> np.ndarray:
    """A homography (3, 3) that maps pixels to metres, as it was given.

    Raises:
        InputError: It has another shape, is not finite, or maps the plane to a line.
    """
    matrix = np.asarray(matrix, float)
    if matrix.shape != (3, 3) or not np.isfinite(matrix).all():
        raise InputError("homography", f"shape {matrix.shape}", "3 x 3 finite numbers, row by row")
    # rows and columns have different units: balance both before the determinant says anything
    rows = matrix / np.maximum(np.abs(matrix).max(axis=1, keepdims=True), 1e-300)
    balanced = rows / np.maximum(np.abs(rows).max(axis=0, keepdims=True), 1e-300)
    if abs(np.linalg.det(balanced)) < 1e-9:
        raise InputError("homography", matrix.tolist(), "a matrix that can be inverted")
    return matrix


def homography_from_scale(scale: float, origin: np.ndarray) -> np.ndarray:
    """Of a camera that looks straight at the plane: `scale` [m/pixel], the shoulder at pixel `origin`, y up.

    Raises:
        InputError: The scale is not above 0.
    """
    if not 0 < scale < np.inf:
        raise InputError("scale", scale, "metres per pixel, > 0")
    u, v = origin
    return np.array([[scale, 0, -scale * u], [0, -scale, scale * v], [0, 0, 1.0]])


def homography_from_points(pixels: ArrayLike | None, metres: ArrayLike | None) -> np.ndarray:
    """From n >= 4 points whose places in the plane are known; both arguments of shape (n, 2).

    Least squares of the direct linear transform, points centred and scaled first (Hartley 1997).

    Raises:
        InputError: There are too few points, or three of four lie on one line.
    """
    pixels, metres = np.array(pixels, float), np.array(metres, float)
    if pixels.shape != metres.shape or pixels.ndim != 2 or pixels.shape[1] != 2 or len(pixels) < 4:
        raise InputError("known_points", f"shapes {pixels.shape}, {metres.shape}", "at least 4 pixels and their metres")
    if not (np.isfinite(pixels).all() and np.isfinite(metres).all()):
        raise InputError("known_points", "NaN or infinite", "finite numbers")
    (a, to_a), (b, to_b) = _normalized(pixels), _normalized(metres)
    zero, one = np.zeros(len(a)), np.ones(len(a))
    u, v, x, y = *a.T, *b.T
    system = np.concatenate(
        [
            np.stack([u, v, one, zero, zero, zero, -x * u, -x * v, -x], axis=1),
            np.stack([zero, zero, zero, u, v, one, -y * u, -y * v, -y], axis=1),
        ]
    )  # (2 n, 9)
    _, values, vectors = np.linalg.svd(system)
    in_a_line = InputError("known_points", pixels.tolist(), "four points of which no three lie on one line")
    if values[7] < 1e-6 * values[0]:
        raise in_a_line
    try:
        return checked_homography(np.linalg.inv(to_b) @ vectors[-1].reshape(3, 3) @ to_a)
    except InputError:
        raise in_a_line from None


def to_plane(homography: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    """Places in the plane [m] of pixels, both (..., 2); NaN stays NaN, and beyond the plane's horizon becomes NaN."""
    h = np.asarray(pixels, float) @ homography[:, :2].T + homography[:, 2]  # (..., 3)
    front = h[..., 2:] * np.sign(homography[2, 2] or 1.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(front > 0, h[..., :2] / h[..., 2:], np.nan)


def metres_per_pixel(homography: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    """Root mean square of the map's two local stretches [m/pixel], (...), at pixels (..., 2)."""
    pixels = np.asarray(pixels, float)
    w = pixels @ homography[2, :2] + homography[2, 2]
    place = to_plane(homography, pixels)
    jacobian = (homography[:2, :2] - place[..., :, None] * homography[2, :2]) / w[..., None, None]  # (..., 2, 2)
    return np.sqrt((jacobian**2).sum(axis=(-2, -1)) / 2)


def _normalized(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points with mean 0 and mean distance sqrt 2, and the matrix (3, 3) that makes them so."""
    mean = points.mean(axis=0)
    size = np.hypot(*(points - mean).T).mean()
    if not size > 0:
        raise InputError("known_points", points.tolist(), "different points")
    s = np.sqrt(2) / size
    return (points - mean) * s, np.array([[s, 0, -s * mean[0]], [0, s, -s * mean[1]], [0, 0, 1]])
