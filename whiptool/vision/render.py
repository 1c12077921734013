"""The virtual camera, which renders a strike of the MuJoCo model like a real camera and returns the ground truth.

In space several cameras can film one strike from different positions.

The images are synthetic, and all files made from them are marked as such. Exposure is integrated over sub-frames, with
a separate time for each row of a rolling shutter, and has shot and read noise. The sensor is assumed to be linear, the
lens free of distortion, and both markers evenly lit to an eighth of their brightness.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import product

import numpy as np

from whiptool.errors import InputError
from whiptool.models.kinematics import joint_points
from whiptool.models.parameters import Model
from whiptool.models.trajectory import Trajectory
from whiptool.recording.camera import Camera
from whiptool.vision.exposure import Exposed, expose, stereo_depth
from whiptool.vision.source import Frame
from whiptool.vision.strike_drawing import StrikeDrawing
from whiptool.viz.drawn_posture import as_mujoco_shows

_FINE = 4  # samples per pixel and direction where the tip is
_TIP_STEP = 1.0  # pixels that the tip moves from one sub-frame to the next, at most
_WHIP_STEP = 2.0  # likewise arm and whip
_SHARES = 4  # sub-frames per exposure at least, each shifted by a part of a pixel against jagged edges:
_SHIFTS = (-0.375, 0.125), (0.125, 0.375), (0.375, -0.125), (-0.125, -0.375)
_STILL = 0.02  # pixels that still count as rest
_SCREEN = 0.16  # brightness of a screen before the camera


@dataclass(frozen=True)
class Noise:
    """Noise of the image sensor."""

    full_well: float = 5000.0  # electrons of a white pixel; shot noise is the square root of the number of electrons
    read: float = 25.0  # read noise [electrons]

    def __post_init__(self) -> None:
        if not 0 < self.full_well < np.inf or not 0 <= self.read < np.inf:
            raise InputError("noise", (self.full_well, self.read), "full_well > 0 and read >= 0 electrons")


@dataclass(frozen=True)
class Screen:
    """A dark screen before the camera, over part of the image and for part of the time."""

    left: int  # left edge [pixels]
    top: int  # upper edge [pixels]
    right: int  # first pixel outside, to the right
    bottom: int  # first pixel outside, below
    start: float = -np.inf  # frames that start in [start, end) [s] show the screen
    end: float = np.inf


@dataclass(frozen=True)
class Truth:
    """Ground truth of one frame."""

    t_point: float  # middle of the tip's exposure [s]
    point: np.ndarray  # mean position of the tip over the exposure [m], (d,), whether visible or not
    pixel: np.ndarray  # that mean in the image [pixels], (2,)
    visible: float  # fraction of the marker that is visible, 0 to 1
    speed: float  # of the tip during the exposure [m/s]
    target: np.ndarray | None = None  # centre of the target [m], (d,), or None
    depth: float = np.nan  # of `point` along the optical axis [m]


@dataclass
class VirtualCamera:
    """A `FrameSource` that films a trajectory; synthetic, and with exact ground truth for every frame read.

    Args:
        settings: The camera, without distortion.
        model, trajectory: Trajectory of the strike, and the model with which it was simulated.
        rng: Random generator of the noise.
        target: Position of the target [m], (d,), or None.
        marker_radius, target_radius: Radius of the tip's ball and of the target's disc [m].
        noise: Noise of the sensor; None for none.
        screens: Objects that may hide the tip.
        start: Time of the first frame relative to the strike's start [s]; before the strike the arm is at rest.

    Attributes:
        truths: Ground truth of each frame that was read.

    Raises:
        InputError: A radius is not positive, the trajectory has other joints than the model, or the lens distorts.
        WhiptoolError: Raised by `open` without OpenGL.
    """

    settings: Camera
    model: Model
    trajectory: Trajectory
    rng: np.random.Generator
    target: np.ndarray | None = None
    marker_radius: float = 0.025
    target_radius: float = 0.04
    noise: Noise | None = field(default_factory=Noise)
    screens: Sequence[Screen] = ()
    start: float = 0.0
    synthetic: bool = field(default=True, init=False)

    def __post_init__(self) -> None:
        for name in ("marker_radius", "target_radius"):
            if not 0 < getattr(self, name) < np.inf:
                raise InputError(name, getattr(self, name), "a radius > 0 m")
        if (count := self.trajectory.q.shape[1]) != self.model.coordinates:
            raise InputError("trajectory", f"{count} joints", f"{self.model.coordinates}, as the model has")
        if any(self.settings.distortion):
            raise InputError("distortion", self.settings.distortion, "zeros, because a virtual camera has no lens")
        if self.target is not None:
            self.target = np.asarray(self.target, float)
        self.truths: list[Truth] = []  # of the frames read so far
        t = self.trajectory.t
        n = max(1, int(np.floor((t[-1] - self.start) * self.settings.fps + 1e-9)) + 1)
        self.starts: np.ndarray = self.start + np.arange(n) / self.settings.fps  # of all frames [s], (F,)
        self._points = joint_points(self.model, self.trajectory.q)  # (T, n + 1, d)
        self._exposed: Exposed = expose(self.settings, t, self._points[:, -1], self.starts)
        self._scene: StrikeDrawing | None = None

    def open(self) -> None:
        """Create the scene, and render its static parts."""
        if self._scene is not None:
            return
        s = self.settings
        self._scene = StrikeDrawing(
            s,
            as_mujoco_shows(self.model, self.trajectory.q[0])[0],
            target=self.target,
            marker_radius=self.marker_radius,
            target_radius=self.target_radius,
        )
        pictures = [self._scene.draw(None, (dx, dy, s.width, s.height)) for dx, dy in _SHIFTS]
        self._background = np.stack(pictures).mean(axis=0, dtype=np.float32)
        self.truths = []

    def close(self) -> None:
        """Release the scene; `truths` are kept."""
        if self._scene is not None:
            self._scene.close()
            self._scene = None

    def read(self, timeout: float = 1.0) -> Frame | None:
        """Return the next frame, or None after the last; the timeout is not used."""
        self.open()
        k = len(self.truths)
        if k == len(self.starts):
            return None
        start, exposed = float(self.starts[k]), self._exposed
        light, marker = self._light(start, k)
        seen = marker.copy()
        for screen in self.screens:
            if screen.start <= start < screen.end:
                rows, columns = slice(max(screen.top, 0), screen.bottom), slice(max(screen.left, 0), screen.right)
                light[rows, columns] = 255 * _SCREEN
                seen[rows, columns] = 0
        # Light of the whole marker: the ball's disc, for as long as the shutter is open to it
        s = self.settings
        scale, slant = s.scale(exposed.points[k]), s.slant(exposed.points[k])
        whole = slant * np.pi * (self.marker_radius * scale) ** 2 * exposed.duration[k] / s.exposure
        self.truths.append(
            Truth(
                t_point=float(exposed.t_points[k]),
                point=exposed.points[k],
                pixel=exposed.pixels[k],
                visible=float(np.clip(seen.sum() / whole, 0, 1)),
                speed=float(exposed.speed[k]),
                target=self.target,
                depth=float(s.depth(exposed.points[k])),
            )
        )
        image = self._develop(light)
        return Frame(image if s.kind == "color" else image[..., 0].copy(), start, "strike", k, s)

    def depths(self, rng: np.random.Generator) -> np.ndarray:
        """Return simulated depth measurements of the tip by a D435, for the frames read so far [m], (F, 1).

        The depths are those of the ball's centre, with the errors of `Camera.depth_error`; 0 if most of the ball is
        hidden. The true depths are in `truths`.
        """
        true = np.array([truth.depth for truth in self.truths])
        hidden = np.array([truth.visible < 0.5 for truth in self.truths])
        return np.where(hidden, 0.0, stereo_depth(self.settings, true, rng))[:, None]

    def _develop(self, light: np.ndarray) -> np.ndarray:
        """From mean brightness (H, W, 3) in [0, 255] to an image of uint8, with noise."""
        if self.settings.kind == "infrared":
            light = light[..., :1]
        if self.noise is not None:
            per_level = self.noise.full_well / 255
            deviation = np.sqrt(light * np.float32(1 / per_level) + np.float32((self.noise.read / per_level) ** 2))
            light = light + deviation * self.rng.standard_normal(light.shape, np.float32)
        return np.clip(light + np.float32(0.5), 0, 255).astype(np.uint8)

    def _light(self, start: float, k: int) -> tuple[np.ndarray, np.ndarray]:
        """Mean brightness over the exposure (H, W, 3), and the tip marker's share of each pixel (H, W)."""
        s, scene = self.settings, self._scene
        assert scene is not None
        light, marker = np.array(self._background, np.float32), np.zeros((s.height, s.width), np.float32)
        scale = s.scale(self._exposed.points[k])
        blur = self._exposed.speed[k] * scale * s.exposure  # [pixels]
        # Arm and whip, wherever they were while any row was open
        t = self.trajectory.t
        window = np.r_[start, t[(t > start) & (t < start + s.readout + s.exposure)], start + s.readout + s.exposure]
        moving = np.stack([np.interp(window, t, x) for x in self._points.reshape(len(t), -1).T], axis=1)
        moving = moving.reshape(len(window), *self._points.shape[1:])
        box = self._box(moving, 0.05 * self.model.reach)
        if box is not None:
            frames = int(np.clip(np.ceil(blur / _WHIP_STEP), _SHARES, 16))
            self._expose(box, start, 1, s.exposure / frames, light, None)
        # The tip, finely
        reach = self.marker_radius * 1.1 + 3 / scale
        rows = s.project(moving[:, -1])[:, 1]
        opens = start + s.row_delay(rows)
        slack = s.row_delay(2 * reach * scale)
        near = (window >= opens - slack) & (window <= opens + s.exposure + slack)
        tips = moving[near, -1:]
        tips = np.concatenate([tips, self._exposed.points[k][None, None]])
        box = self._box(tips, reach)
        if box is not None:
            steps = max(_SHARES, int(np.ceil(blur / _TIP_STEP)))
            self._expose(box, start, _FINE, s.exposure / steps, light, marker)
        return light, marker

    def _expose(
        self,
        box: tuple[int, int, int, int],
        start: float,
        scale: int,
        step: float,
        light: np.ndarray,
        marker: np.ndarray | None,
    ) -> None:
        """Integrate a box (left, top, width, height) of the image over the exposure, in sub-frames of `step` [s]."""
        s, scene = self.settings, self._scene
        assert scene is not None
        left, top, width, height = box
        scale = scene.largest_scale(width, height, scale)
        opens = start + s.row_delay(np.arange(top, top + height))  # (height,)
        first, last = opens[0], opens[-1] + s.exposure
        n = max(1, int(np.ceil((last - first) / step - 1e-9)))
        edges = np.linspace(first, last, n + 1)
        middle = (edges[1:] + edges[:-1]) / 2
        q = self._q(middle)  # (n, joints)
        still = self._span(q) < _STILL
        if still:  # one picture of all rows at once
            n, edges = _SHARES, None
        weights = np.full((height, n), 1 / n, np.float32)
        if edges is not None:
            overlap = np.minimum(edges[1:], opens[:, None] + s.exposure) - np.maximum(edges[:-1], opens[:, None])
            weights = (np.maximum(overlap, 0) / s.exposure).astype(np.float32)  # (height, n)
        sum_light, sum_marker = np.zeros((height, width, 3), np.float32), np.zeros((height, width), np.float32)
        for i in range(n):
            rows = np.flatnonzero(weights[:, i])
            if not len(rows):
                continue
            part = slice(rows[0], rows[-1] + 1)
            dx, dy = _SHIFTS[i % len(_SHIFTS)] if scale == 1 else (0.0, 0.0)
            drawn = scene.draw(
                as_mujoco_shows(self.model, q[min(i, len(q) - 1)])[1],
                (left + dx, top + rows[0] + dy, width, rows[-1] + 1 - rows[0]),
                scale,
            )
            w = weights[part, i, None]
            sum_light[part] += w[..., None] * _shrink(drawn.astype(np.float32), scale)
            if marker is not None:
                sum_marker[part] += w * _shrink(scene.is_tip(drawn).astype(np.float32), scale)
        light[top : top + height, left : left + width] = sum_light
        if marker is not None:
            marker[top : top + height, left : left + width] = sum_marker

    def _q(self, times: float | np.ndarray) -> np.ndarray:
        return np.stack([np.interp(times, self.trajectory.t, x) for x in self.trajectory.q.T], axis=-1)

    def _span(self, q: np.ndarray) -> float:
        """How far any joint or the tip moves over postures q (n, joints) [pixels]."""
        points = joint_points(self.model, q)
        return float(np.ptp(points, axis=0).max()) * self.settings.scale(points[0, -1])

    def _box(self, points: np.ndarray, margin: float) -> tuple[int, int, int, int] | None:
        """Left, top, width and height of what holds the points (..., d) and a margin [m]; None outside the image."""
        points = points.reshape(-1, points.shape[-1])
        low, high = points.min(axis=0) - margin, points.max(axis=0) + margin
        corners = self.settings.project(np.array(list(product(*zip(low, high, strict=True)))))
        limits = (self.settings.width, self.settings.height)
        (left, top), (right, bottom) = (
            np.clip(np.floor(corners.min(axis=0)), 0, limits).astype(int),
            np.clip(np.ceil(corners.max(axis=0)) + 1, 0, limits).astype(int),
        )
        return (int(left), int(top), int(right - left), int(bottom - top)) if right > left and bottom > top else None


def _shrink(fine: np.ndarray, scale: int) -> np.ndarray:
    """Means over squares of `scale` samples."""
    if scale == 1:
        return fine
    h, w = fine.shape[0] // scale, fine.shape[1] // scale
    return fine.reshape(h, scale, w, scale, *fine.shape[2:]).mean(axis=(1, 3))
