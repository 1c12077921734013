"""Points in space from two or more cameras that saw them at the same time.

For display, and for frames that no model of the whip explains. A fit compares the model with each camera's own pixels,
at that camera's own times, so that it needs none of this.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from whiptool.errors import InputError
from whiptool.recording.camera import Camera

_ROUNDS = 6  # Gauss-Newton from the point nearest to all sights: quadratic, so that these do
_NARROWEST = 1e-4  # smallest eigenvalue over the number of sights: about the squared sine of half the angle between two


@dataclass(frozen=True, eq=False)
class Triangulated:
    """Triangulated points in space, and their accuracy.

    Args:
        points: Positions [m], (..., 3); NaN if fewer than two cameras saw the point, or all from nearly the same
            direction.
        residual: Root mean square reprojection error [pixels], (...).
        covariance: Covariance of each point [m^2], (..., 3, 3), for errors of one pixel in each coordinate of each
            camera.
    """

    points: np.ndarray
    residual: np.ndarray
    covariance: np.ndarray


def triangulate(cameras: Sequence[Camera], pixels: np.ndarray) -> Triangulated:
    """Return the points that minimise the squared reprojection errors, summed over the cameras.

    Args:
        cameras: C cameras, at least two.
        pixels: Measured pixels of the points in each camera, with lens distortion, (C, ..., 2); NaN where not seen.

    Raises:
        InputError: There are fewer than two cameras, or `pixels` has another shape.
    """
    pixels = np.asarray(pixels, float)
    if len(cameras) < 2:
        raise InputError("cameras", len(cameras), "two or more")
    if pixels.ndim < 2 or len(pixels) != len(cameras) or pixels.shape[-1] != 2:
        raise InputError("pixels", f"shape {pixels.shape}", f"shape ({len(cameras)}, ..., 2), one row per camera")
    shape = pixels.shape[1:-1]
    flat = pixels.reshape(len(cameras), -1, 2)
    seen = np.asarray(np.isfinite(flat).all(axis=-1))  # (C, P)
    straight = np.stack(
        [c.undistorted(np.where(s[:, None], p, 0.0)) for c, p, s in zip(cameras, flat, seen, strict=True)]
    )
    points, wide = _nearest_to_sights(cameras, flat, seen)
    known = wide & (seen.sum(axis=0) > 1)
    points[~known] = np.nan
    for _ in range(_ROUNDS):
        r, J = _residuals(cameras, points, straight, seen)
        points = points + np.linalg.solve(_normal(J, known), -np.einsum("cpij,cpi->pj", J, r)[..., None])[..., 0]
    r, J = _residuals(cameras, points, straight, seen)
    covariance = np.where(known[:, None, None], np.linalg.inv(_normal(J, known)), np.nan)
    residual = np.where(known, np.sqrt((r**2).sum(axis=(0, 2)) / np.maximum(seen.sum(axis=0), 1)), np.nan)
    points[~known] = np.nan
    return Triangulated(points.reshape(*shape, 3), residual.reshape(shape), covariance.reshape(*shape, 3, 3))


def _nearest_to_sights(
    cameras: Sequence[Camera], pixels: np.ndarray, seen: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the points (P, 3) nearest to all lines of sight, by squares, and which are fixed by them (P,)."""
    A, b = np.zeros((pixels.shape[1], 3, 3)), np.zeros((pixels.shape[1], 3))
    for camera, at, here in zip(cameras, pixels, seen, strict=True):
        d = camera.sights(np.where(here[:, None], at, 0.0))
        across = here[:, None, None] * (np.eye(3) - d[:, :, None] * d[:, None, :])
        A += across
        b += across @ camera.position
    wide = np.linalg.eigvalsh(A)[:, 0] > _NARROWEST * np.maximum(seen.sum(axis=0), 1)
    A[~wide] = np.eye(3)
    return np.linalg.solve(A, b[..., None])[..., 0], wide


def _residuals(
    cameras: Sequence[Camera], points: np.ndarray, straight: np.ndarray, seen: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return images less what was seen, without distortion [pixels], (C, P, 2), and their derivatives (C, P, 2, 3).

    Of a camera that did not see the point, both are zero.
    """
    r, J = np.zeros((*seen.shape, 2)), np.zeros((*seen.shape, 2, 3))
    for c, camera in enumerate(cameras):
        x, y, z = np.moveaxis(camera.to_camera(points), -1, 0)
        flat = np.stack([x / z, y / z], axis=-1)
        r[c] = flat * camera.focal_lengths + camera.principal_point - straight[c]
        by_camera = np.zeros((len(points), 2, 3))
        by_camera[:, 0, 0] = by_camera[:, 1, 1] = 1 / z
        by_camera[:, :, 2] = -flat / z[:, None]
        J[c] = camera.focal_lengths[:, None] * (by_camera @ camera.rotation)
    left_out = ~seen | ~np.isfinite(r).all(axis=-1)
    r[left_out], J[left_out] = 0, 0
    return r, J


def _normal(J: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Return the normal equations' matrices (P, 3, 3); of points that are not known, the unit matrix."""
    matrix = np.einsum("cpij,cpik->pjk", J, J)
    matrix[~known] = np.eye(3)
    return matrix
