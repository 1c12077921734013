"""Cameras in space that film a path by OpenCV's own projection: mean over the exposure, each row in its own time."""

from __future__ import annotations

import cv2
import numpy as np
from scipy.interpolate import CubicSpline

from whiptool.recording.space_camera import SpaceCamera, looking_at
from whiptool.recording.strike_recording import StrikeRecording

K = np.array([[430.0, 0, 424], [0, 432.0, 238], [0, 0, 1]])
LENS = (-0.11, 0.03, 1e-3, -5e-4, 0.01)


def camera(name: str, position: tuple[float, float, float], at=(0.5, 0.0, 0.5), **timing: float) -> SpaceCamera:
    """Return a camera with a lens that distorts, which looks at a point [m]."""
    timing = {"fps": 90.0, "exposure": 2e-3, "readout": 8e-3} | timing
    return SpaceCamera(name, 848, 480, K, looking_at(position, at), np.array(position), LENS, **timing)


LEFT, RIGHT = camera("left", (1.6, 2.9, 1.1)), camera("right", (2.4, -2.4, 0.7), fps=60.0, exposure=3e-3)


def by_opencv(camera: SpaceCamera, places: np.ndarray) -> np.ndarray:
    """Return the pixels (..., 2) of places (..., 3) [m]."""
    turned, _ = cv2.Rodrigues(camera.rotation)
    shift = -camera.rotation @ camera.position
    lens = camera.camera_matrix, np.array(camera.distortion)
    pixels, _ = cv2.projectPoints(places.reshape(-1, 1, 3), turned, shift, *lens)
    return pixels.reshape(*places.shape[:-1], 2)


def film_in_space(
    camera: SpaceCamera,
    t: np.ndarray,
    places: np.ndarray,
    *,
    markers: tuple[str, ...] = ("tip",),
    sigma: float = 0.3,
    rng: np.random.Generator | None = None,
    late: float = 0.0,
    start: float = 0.011,
    **about,
) -> StrikeRecording:
    """Return what a camera saw of paths (T, M, 3) at times t: pixels, with noise of `sigma` where there is a generator.

    Its clock is `late` [s]; its first frame's first row is in the middle of its exposure at `start`.
    """
    path = CubicSpline(t, places)
    frames = np.arange(start, t[-1] - camera.readout - camera.exposure, 1 / camera.fps)
    shares = (np.arange(12) + 0.5) / 12 - 0.5
    pixels = np.zeros((len(frames), len(markers), 2))
    for _ in range(8):  # a row's time and the marker's row
        rows = pixels[..., 1] * camera.readout / camera.height
        for m in range(len(markers)):
            at = frames[:, None] + rows[:, m, None] + shares * camera.exposure
            pixels[:, m] = by_opencv(camera, path(at)[:, :, m]).mean(axis=1)
    if rng is not None:
        pixels += sigma * rng.standard_normal(pixels.shape)
    inside = (pixels >= 0).all(axis=2) & (pixels < [camera.width, camera.height]).all(axis=2)
    pixels[~inside] = np.nan
    return StrikeRecording(t=frames + late, points=pixels, markers=markers, sigma=sigma, view=camera, **about)
