"""Distances of line segments in space, many at once."""

from __future__ import annotations

import numpy as np


def nearest_points(
    start: np.ndarray, end: np.ndarray, other_start: np.ndarray, other_end: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the nearest points of pairs of segments, (..., 3) each; segments may be points.

    Ericson, Real-Time Collision Detection (2005), section 5.1.9.

    Args:
        start, end: Start and end of the first segment of each pair [m], (..., 3).
        other_start, other_end: Start and end of the second segment [m], (..., 3).
    """
    along, other_along, between = end - start, other_end - other_start, start - other_start
    a, e, b = _dot(along, along), _dot(other_along, other_along), _dot(along, other_along)
    c, f = _dot(along, between), _dot(other_along, between)
    s = np.clip(_ratio(b * f - c * e, a * e - b * b, 1e-12 * a * e), 0.0, 1.0)  # of lines; parallel ones: anywhere
    t = np.clip(_ratio(b * s + f, e), 0.0, 1.0)
    s = np.clip(_ratio(b * t - c, a), 0.0, 1.0)
    return start + s[..., None] * along, other_start + t[..., None] * other_along


def _dot(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return np.einsum("...i,...i->...", x, y)


def _ratio(over: np.ndarray, under: np.ndarray, least: np.ndarray | float = 0.0) -> np.ndarray:
    """A quotient, 0 where what is divided by is no more than the least."""
    defined = under > least
    return np.where(defined, over / np.where(defined, under, 1.0), 0.0)
