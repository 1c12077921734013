"""Measurement model of a moving point in images: exposure, shutter, and tracking errors."""

from __future__ import annotations

from dataclasses import dataclass
from functools import reduce

import numpy as np

from whiptool.recording.camera import BASELINE, SUBPIXEL, Camera

_SAMPLES = 64  # of a path over one exposure, by the midpoint rule


@dataclass(frozen=True)
class Exposed:
    """A moving point as measured in F exposures."""

    t_points: np.ndarray  # middle of each exposure of the point [s], (F,)
    points: np.ndarray  # mean position over the exposure [m], (F, 2), in space (F, 3)
    pixels: np.ndarray  # mean image position over the exposure [pixels], (F, 2)
    duration: np.ndarray  # time it was exposed [s], (F,); longer than the exposure if it moves along the readout
    speed: np.ndarray  # mean speed during the exposure [m/s], (F,)


def expose(camera: Camera, t: np.ndarray, path: np.ndarray, starts: np.ndarray) -> Exposed:
    """Return a camera's measurements of a moving point: means of its path over the exposures of its image row. A
    rolling shutter exposes the rows one after the other.

    Args:
        camera: The camera.
        t, path: Times [s], (T,), and positions [m], (T, 2), in space (T, 3); before the first time and after the last
            the point is at rest.
        starts: Start of the first row's exposure in each frame [s], (F,).
    """

    def at(times: np.ndarray) -> np.ndarray:
        return np.stack([np.interp(times, t, x) for x in path.T], axis=-1)

    starts = np.asarray(starts, float)
    ends = np.stack([starts, starts + camera.exposure])  # (2, F): when the point's own row opens and closes
    for _ in range(20 if camera.readout else 0):  # contracts by the share of the rows' speed that the point has
        rows = camera.project(at(ends))[..., 1]
        ends = starts + np.array([[0.0], [camera.exposure]]) + camera.row_delay(rows)
    share = (np.arange(_SAMPLES) + 0.5) / _SAMPLES
    times = ends[0, :, None] + (ends[1] - ends[0])[:, None] * share  # (F, S)
    points = at(times)
    ways = reduce(np.hypot, np.moveaxis(np.diff(points, axis=1), -1, 0))
    length = ways.sum(axis=1) / (1 - 1 / _SAMPLES)
    duration = ends[1] - ends[0]
    return Exposed(
        t_points=ends.mean(axis=0),
        points=points.mean(axis=1),
        pixels=camera.project(points).mean(axis=1),
        duration=duration,
        speed=length / duration,
    )


def measurement_sigma(camera: Camera, speed: float | np.ndarray, *, distance: float | None = None) -> np.ndarray:
    """Return the standard error of a tracked point, per coordinate [m], for a marker that moves at `speed` [m/s].

    It is the root sum square of a constant and a fraction of the motion blur, fitted to the errors of
    `whiptool.vision.tracking` on virtual images of a marker with 25 mm radius at 3.5 m (0.03 pixels at rest, 0.07 at 30
    m/s in colour). Successive errors are correlated by 0.3 in colour and 0.7 in infrared, because of shading by lamps
    and whip. Calibration errors of a real camera are not included.

    Args:
        camera: The camera.
        speed: Speed of the marker [m/s].
        distance: Distance of the marker [m]; None: that of the strike plane.
    """
    away, focal = camera.distance if distance is None else distance, camera.camera_matrix[0, 0]
    blur = np.asarray(speed, float) * camera.exposure * focal / away  # [pixels]
    return np.hypot(0.04, 0.004 * blur) * away / focal


def stereo_depth(camera: Camera, depth: float | np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return simulated measurements by a D435 of true depths along the optical axis [m] (NaN stays NaN), with the
    errors of `Camera.depth_error`; 0, as a D435 reports, if noise exceeds the disparity."""
    span = camera.focal_lengths[0] * BASELINE
    disparity = span / np.asarray(depth, float)
    measured = disparity + SUBPIXEL * rng.standard_normal(disparity.shape)
    lost = measured <= 0  # of NaN: false
    return np.where(lost, 0.0, span / np.where(lost, 1.0, measured))
