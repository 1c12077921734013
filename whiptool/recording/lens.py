"""Lenses that distort: Brown and Conrady's model, as in OpenCV, there and back, and its derivatives."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from whiptool.recording.opencv import opencv

COEFFICIENTS = (0, 4, 5, 8)  # how many there are: k1, k2, p1, p2[, k3[, k4, k5, k6]]


def distort(flat: np.ndarray, distortion: tuple[float, ...]) -> np.ndarray:
    """Return normalised image coordinates (..., 2) after a lens's distortion (OpenCV's coefficients)."""
    if not distortion:
        return flat
    x, y = np.moveaxis(flat, -1, 0)
    _, _, p1, p2, *_ = distortion
    r2 = x**2 + y**2
    above, below, _, _ = _radial(r2, distortion)
    radial = above / below
    u = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x**2)
    v = y * radial + p1 * (r2 + 2 * y**2) + 2 * p2 * x * y
    return np.stack([u, v], axis=-1)


def distortion_slopes(flat: np.ndarray, distortion: tuple[float, ...]) -> np.ndarray:
    """Return the derivatives of `distort` by the undistorted coordinates, (..., 2, 2); entry [i, j] is of output i by
    input j.
    """
    if not distortion:
        return np.broadcast_to(np.eye(2), (*flat.shape, 2))
    x, y = np.moveaxis(flat, -1, 0)
    _, _, p1, p2, *_ = distortion
    above, below, by_above, by_below = _radial(x**2 + y**2, distortion)
    radial = above / below
    slope = 2 * (by_above - radial * by_below) / below  # of the radial factor by x, over x
    across = x * y * slope + 2 * p1 * x + 2 * p2 * y
    u_x = radial + x**2 * slope + 2 * p1 * y + 6 * p2 * x
    v_y = radial + y**2 * slope + 6 * p1 * y + 2 * p2 * x
    return np.stack([np.stack([u_x, across], axis=-1), np.stack([across, v_y], axis=-1)], axis=-2)


def _radial(r2: np.ndarray, distortion: tuple[float, ...]) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return the radial factor's numerator and denominator, and the derivatives of both by r^2."""
    k1, k2, _, _, k3, k4, k5, k6 = (*distortion, *(0.0,) * (8 - len(distortion)))
    above, below = 1 + r2 * (k1 + r2 * (k2 + r2 * k3)), 1 + r2 * (k4 + r2 * (k5 + r2 * k6))
    return above, below, k1 + r2 * (2 * k2 + 3 * r2 * k3), k4 + r2 * (2 * k5 + 3 * r2 * k6)


def undistort(
    pixels: np.ndarray, camera_matrix: np.ndarray | None = None, distortion: Sequence[float] = ()
) -> np.ndarray:
    """Return pixels (..., 2) corrected for a lens's distortion."""
    pixels = np.asarray(pixels, float)
    if not len(distortion) or camera_matrix is None or not pixels.size:
        return pixels
    cv2 = opencv()
    precise = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 50, 1e-9)
    flat = cv2.undistortImagePoints(
        pixels.reshape(-1, 1, 2), np.asarray(camera_matrix, float), np.array(distortion, float), None, precise
    )
    return flat.reshape(pixels.shape)
