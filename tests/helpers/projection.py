"""Where a pinhole camera sees places, by similar triangles."""

from __future__ import annotations

import numpy as np


def projected(places: np.ndarray, pinhole: np.ndarray, axes: np.ndarray, fovy: float) -> np.ndarray:
    """Places (..., 3) to the right and up from the picture's centre, and their scale, in half heights; NaN behind.

    Args:
        places: Places [m], (..., 3).
        pinhole: Position of the camera [m], (3,).
        axes: Its right, up and backward directions, in rows, (3, 3).
        fovy: Vertical field of view [deg].
    """
    right, up, back = np.moveaxis((places - pinhole) @ axes.T, -1, 0)
    size = 1 / (np.tan(np.deg2rad(fovy) / 2) * np.where(back < 0, -back, np.nan))
    return np.stack([right * size, up * size, size], axis=-1)
