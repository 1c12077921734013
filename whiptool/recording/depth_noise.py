"""Noise of depth that a stereo pair measures, as an Intel RealSense D435 does.

Depth z is the distance along the camera's optical axis. A stereo pair sees it as a disparity d = f b / z [pixels], the
shift of what it shows between two images from places that are the baseline b apart, with focal lengths of f pixels. The
disparity errs by the same at all distances, so that the depth's error grows with their square:

    sigma_z = z^2 sigma_d / (f b)

Source: A. Grunnet-Jepsen, J. N. Sweetser, J. Woodfill, "Tuning depth cameras for best performance" (Intel),
https://dev.intelrealsense.com/docs/tuning-depth-cameras-for-best-performance, which calls sigma_d the subpixel. Of a
D435 it can be as low as 0.03 on a surface with texture; one of its authors advises 0.08
(https://github.com/IntelRealSense/librealsense/issues/3904).
"""

from __future__ import annotations

import numpy as np

BASELINE = 0.05  # [m] between a D435's infrared cameras
SUBPIXEL = 0.08  # [pixels], standard error of its disparity


def depth_error(
    depth: float | np.ndarray, focal_length: float, *, baseline: float = BASELINE, subpixel: float = SUBPIXEL
) -> np.ndarray:
    """Return the standard error of measured depth [m], of the shape of `depth`.

    Args:
        depth: Depth along the optical axis [m], any shape.
        focal_length: Focal length of the camera [pixels].
        baseline: Distance between the two cameras of the pair [m].
        subpixel: Standard error of the disparity [pixels].
    """
    return np.asarray(depth, float) ** 2 * subpixel / (focal_length * baseline)


def stereo_depth(
    depth: float | np.ndarray,
    focal_length: float,
    rng: np.random.Generator,
    *,
    baseline: float = BASELINE,
    subpixel: float = SUBPIXEL,
) -> np.ndarray:
    """Return simulated measurements of depth by a stereo pair [m]; 0 where the disparity is lost in noise, as with a
    D435.

    Args:
        depth: True depth along the optical axis [m], any shape; NaN stays NaN.
        focal_length, baseline, subpixel: As for `depth_error`.
        rng: Random generator of the errors.
    """
    disparity = focal_length * baseline / np.asarray(depth, float)
    measured = disparity + subpixel * rng.standard_normal(disparity.shape)
    lost = measured <= 0  # of NaN: false
    return np.where(lost, 0.0, focal_length * baseline / np.where(lost, 1.0, measured))
