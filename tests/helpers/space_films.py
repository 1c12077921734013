"""Cameras in space that film a path by OpenCV's own projection: mean over the exposure, each row in its own time.

And a robot in MuJoCo with a whip, whose strikes they film while it writes its joints' log.
"""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from whiptool.models import Model, WhipParameters, preset
from whiptool.models.joint_trajectory import JointTrajectory
from whiptool.models.strike import Strike
from whiptool.recording.camera import Camera, looking_at
from whiptool.recording.strike_recording import StrikeRecording
from whiptool.rollout.servo_replay import replay_trajectory

cv2 = pytest.importorskip("cv2", reason="needs the extra `vision`")
WHIP = WhipParameters(N=5, l=0.2, m=0.02, k=0.05, b=0.004, joints="universal", node_inertia=2e-6)
ROBOT = dataclasses.replace(preset("ur5e"), whip=WHIP)
STRIKES = (
    Strike((0.1, -1.9, 1.2, -0.9, 0.3, 0.0), (0.5, -1.2, 0.6, -1.6, -0.4, 0.2), 0.6),
    Strike((-0.3, -1.5, 1.5, -1.2, -0.2, 0.1), (0.4, -1.7, 0.7, -0.7, 0.5, -0.3), 0.5),
)
LATE = {"left": 0.004, "right": -0.003}  # [s] of the cameras' clocks
ENCODER = 2e-5  # [rad]

K = np.array([[430.0, 0, 424], [0, 432.0, 238], [0, 0, 1]])
LENS = (-0.11, 0.03, 1e-3, -5e-4, 0.01)


def camera(name: str, position: tuple[float, float, float], at=(0.5, 0.0, 0.5), **timing: float) -> Camera:
    """Return a camera with a lens that distorts, which looks at a point [m]."""
    timing = {"fps": 90.0, "exposure": 2e-3, "readout": 8e-3} | timing
    return Camera(name, 848, 480, K, looking_at(position, at), np.array(position), LENS, **timing)


LEFT, RIGHT = camera("left", (1.6, 2.9, 1.1)), camera("right", (2.4, -2.4, 0.7), fps=60.0, exposure=3e-3)


def by_opencv(camera: Camera, places: np.ndarray) -> np.ndarray:
    """Return the pixels (..., 2) of places (..., 3) [m]."""
    turned, _ = cv2.Rodrigues(camera.rotation)
    shift = -camera.rotation @ camera.position
    lens = camera.camera_matrix, np.array(camera.distortion)
    pixels, _ = cv2.projectPoints(places.reshape(-1, 1, 3), turned, shift, *lens)
    return pixels.reshape(*places.shape[:-1], 2)


def film_in_space(
    camera: Camera,
    t: np.ndarray,
    places: np.ndarray,
    *,
    markers: tuple[str, ...] = ("tip",),
    sigma: float = 0.3,
    rng: np.random.Generator | None = None,
    late: float = 0.0,
    start: float = 0.011,
    deep: bool = False,
    **about,
) -> StrikeRecording:
    """Return what a camera saw of paths (T, M, 3) at times t: pixels, with noise of `sigma` where there is a generator.

    Its clock is `late` [s]; its first frame's first row is in the middle of its exposure at `start`. A deep one
    measures depth, too, with the errors of a D435: of 0.08 pixels in disparity over 50 mm; not in every seventh frame.
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
    if deep:
        about["depth"] = mean_depths(camera, path, frames, pixels)
        if rng is not None:
            disparity = K[0, 0] * 0.05 / about["depth"] + 0.08 * rng.standard_normal(about["depth"].shape)
            about["depth"] = K[0, 0] * 0.05 / disparity
            about["depth"][::7] = 0.0
    inside = (pixels >= 0).all(axis=2) & (pixels < [camera.width, camera.height]).all(axis=2)
    pixels[~inside] = np.nan
    return StrikeRecording(t=frames + late, points=pixels, markers=markers, sigma=sigma, view=camera, **about)


def mean_depths(camera: Camera, path: CubicSpline, frames: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    """Return the markers' mean depths while the rows of their pixels are exposed [m], (T, M)."""
    shares = (np.arange(12) + 0.5) / 12 - 0.5
    at = frames[:, None, None] + (pixels[..., 1] * camera.readout / camera.height)[..., None] + shares * camera.exposure
    ahead = (path(at) - camera.position) @ camera.rotation[2]  # (T, M, shares, M)
    return np.einsum("tmsm->tm", ahead) / len(shares)


def filmed_by_two(model: Model, strike: Strike, seed: int) -> list[StrikeRecording]:
    """Return what both cameras saw of a strike by MuJoCo's servos, each with the robot's joint log."""
    rng, told = np.random.default_rng(seed), JointTrajectory.of_strike(strike, model.arm.joints, rest=0.1, t_stay=0.15)
    path = replay_trajectory(model, told)
    log = np.arange(0.0, path.t[-1], 0.02)
    joints = CubicSpline(path.t, path.q[:, : model.arm.n])(log)
    about = {
        "joints_t": log - told.strike_begins,
        "joints_q": joints + ENCODER * rng.standard_normal(joints.shape),
        "t_stay": 0.15,
    }
    filmed = path.t - told.strike_begins, path.tip[:, None]
    return [film_in_space(c, *filmed, rng=rng, late=LATE[c.name], **about) for c in (LEFT, RIGHT)]
