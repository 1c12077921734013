"""Conversion of pixels to metres in the strike plane: homographies from a matrix, known points, or a scale.

Pixel (0, 0) is the centre of the image's first pixel, u goes right, v down, as in OpenCV.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from whiptool.errors import InputError
from whiptool.models.numbers import float_array
from whiptool.recording.camera import to_plane

_LARGEST_CONDITION = 1e4  # of the design matrix in normalised coordinates; four corners of a rectangle have about 3


def checked_homography(matrix: np.ndarray) -> np.ndarray:
    """Return a homography (3, 3) from pixels to metres; refuse one that has another shape, is not finite, or maps the
    plane to a line."""
    matrix = float_array("homography", matrix)
    if matrix.shape != (3, 3) or not np.isfinite(matrix).all():
        raise InputError("homography", f"shape {matrix.shape}", "3 x 3 finite numbers, row by row")
    # rows and columns have different units: balance both before the determinant says anything
    rows = matrix / np.maximum(np.abs(matrix).max(axis=1, keepdims=True), 1e-300)
    balanced = rows / np.maximum(np.abs(rows).max(axis=0, keepdims=True), 1e-300)
    if abs(np.linalg.det(balanced)) < 1e-9:
        raise InputError("homography", matrix.tolist(), "a matrix that can be inverted")
    return matrix


def homography_from_scale(scale: float, origin: np.ndarray) -> np.ndarray:
    """Return the homography (3, 3) from pixels to metres of a camera that looks perpendicularly at the plane, from its
    scale [m/pixel] and the pixel (2,) of the shoulder, the origin of the plane; y is up."""
    if isinstance(scale, bool) or not 0 < scale < np.inf:
        raise InputError("scale", scale, "metres per pixel, > 0")
    u, v = origin
    return np.array([[scale, 0, -scale * u], [0, -scale, scale * v], [0, 0, 1.0]])


def homography_from_points(pixels: ArrayLike | None, metres: ArrayLike | None) -> np.ndarray:
    """Return the homography (3, 3) from n >= 4 points with known pixels and positions in the plane [m], (n, 2) each; of
    four points, no three may lie on one line.

    It is found by the direct linear transform of centred and scaled points (Hartley 1997). For more than four points it
    minimises the squared distances in the image, because the errors are those of pixels.
    """
    pixels, metres = float_array("pixels", pixels), float_array("metres", metres)
    for name, points in (("pixels", pixels), ("metres", metres)):
        if points.ndim != 2 or points.shape[1:] != (2,) or len(points) != len(pixels) or not np.isfinite(points).all():
            raise InputError(name, f"shape {points.shape}", "finite numbers of shape (n, 2), one row per known point")
    if len(pixels) < 4:
        raise InputError("pixels", f"{len(pixels)} points", "at least four known points")
    (seen, to_seen), (placed, to_placed) = _normalized("pixels", pixels), _normalized("metres", metres)
    flat = np.linalg.svd(_equations(placed, seen))[2][-1]
    if len(pixels) > 4:
        from scipy.optimize import least_squares  # a third of what a command imports

        flat = least_squares(lambda h: (to_plane(h.reshape(3, 3), placed) - seen).ravel(), flat, xtol=1e-15).x
    return checked_homography(np.linalg.inv(np.linalg.inv(to_seen) @ flat.reshape(3, 3) @ to_placed))


def metres_per_pixel(homography: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    """Return the local scale of the homography at pixels (..., 2) [m/pixel], (...): the root mean square over both
    directions.
    """
    pixels = np.asarray(pixels, float)
    w = pixels @ homography[2, :2] + homography[2, 2]
    place = to_plane(homography, pixels)
    jacobian = (homography[:2, :2] - place[..., :, None] * homography[2, :2]) / w[..., None, None]  # (..., 2, 2)
    return np.sqrt((jacobian**2).sum(axis=(-2, -1)) / 2)


def _normalized(name: str, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points with mean 0 and mean distance sqrt 2, and the matrix (3, 3) that makes them so; refuses points that fix no
    homography, because more than one carries them onto themselves."""
    mean = points.mean(axis=0)
    size = np.hypot(*(points - mean).T).mean()
    if size > 0:
        s = np.sqrt(2) / size
        found = (points - mean) * s
        values = np.linalg.svd(_equations(found, found), compute_uv=False)
        if values[0] < _LARGEST_CONDITION * values[7]:
            return found, np.array([[s, 0, -s * mean[0]], [0, s, -s * mean[1]], [0, 0, 1]])
    rule = "four points of which no three lie on one line"
    raise InputError(name, points.tolist(), rule, "spread them over the whole strike plane")


def _equations(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """The equations, (2 n, 9), of a homography that carries points a onto points b, (n, 2) each."""
    zero, one = np.zeros(len(a)), np.ones(len(a))
    u, v, x, y = *a.T, *b.T
    return np.concatenate(
        [
            np.stack([u, v, one, zero, zero, zero, -x * u, -x * v, -x], axis=1),
            np.stack([zero, zero, zero, u, v, one, -y * u, -y * v, -y], axis=1),
        ]
    )
