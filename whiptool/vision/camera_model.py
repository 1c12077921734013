"""How a camera sees the strike plane: projection, exposure, shutter, and the errors of what is tracked in its images.

A pixel's centre has whole coordinates (u to the right, v down), as in OpenCV. The strike plane is z = 0 of a frame with
x forward, y up, z toward the camera, in metres, its origin at the shoulder.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from functools import cached_property, reduce
from typing import Any

import numpy as np

from whiptool.errors import InputError

KINDS = ("color", "infrared")
_SAMPLES = 64  # of a path over one exposure, by the midpoint rule


@dataclass(frozen=True)
class CameraSettings:
    """Intrinsics, pose and timing of one camera stream, free of lens distortion (the D435 streams rectified images).

    Args:
        name: For people and for reports.
        width, height: [pixels]
        fps: Frames per second.
        fx, fy, cx, cy: Focal lengths and principal point [pixels].
        position: Position of the camera in the strike plane's frame [m], (3,); the third is its distance from the
            plane.
        rotation: Rotation vector [rad], (3,), in the camera's axes (right, down, forward), that turns a camera looking
            straight at the plane, upright, into this one.
        exposure: Exposure time of each row [s].
        readout: Time from the first row's start to the start of the row after the last [s]; 0 is a global shutter.
        kind: `color` or `infrared`.

    Raises:
        InputError: A value is out of range, or the camera is behind the plane or looks away from it.
    """

    name: str
    width: int
    height: int
    fps: float
    fx: float
    fy: float
    cx: float
    cy: float
    position: tuple[float, float, float]
    rotation: tuple[float, float, float]
    exposure: float
    readout: float
    kind: str

    def __post_init__(self) -> None:
        for name in ("width", "height", "fps", "fx", "fy", "exposure"):
            value = getattr(self, name)
            if not 0 < value < np.inf:
                raise InputError(name, value, "a finite number > 0")
        if not 0 <= self.readout < np.inf:
            raise InputError("readout", self.readout, "a time >= 0 s; 0 is a global shutter")
        if self.exposure > 1 / self.fps:
            raise InputError("exposure", self.exposure, f"at most the time between frames, {1 / self.fps:g} s")
        if self.kind not in KINDS:
            raise InputError("kind", self.kind, " or ".join(KINDS))
        for name in ("position", "rotation"):
            value = tuple(float(x) for x in getattr(self, name))
            if len(value) != 3 or not np.isfinite(value).all():
                raise InputError(name, value, "three finite numbers")
            object.__setattr__(self, name, value)
        if self.position[2] <= 0 or self.rotation_matrix[2, 2] >= 0:
            raise InputError(
                "position and rotation", (self.position, self.rotation), "a camera before the plane, looking at it"
            )

    def replace(self, **changes: Any) -> CameraSettings:
        """The same camera with some settings changed."""
        return dataclasses.replace(self, **changes)

    @cached_property
    def camera_matrix(self) -> np.ndarray:
        """Intrinsics [pixels], (3, 3)."""
        return np.array([[self.fx, 0, self.cx], [0, self.fy, self.cy], [0, 0, 1.0]])

    @cached_property
    def rotation_matrix(self) -> np.ndarray:
        """From the strike plane's axes to the camera's (right, down, forward), (3, 3)."""
        from scipy.spatial.transform import Rotation

        return Rotation.from_rotvec(self.rotation).as_matrix() @ np.diag([1.0, -1.0, -1.0])

    @cached_property
    def homography(self) -> np.ndarray:
        """Metres on the strike plane from pixels, in homogeneous coordinates, (3, 3), its last entry 1."""
        R = self.rotation_matrix
        H = np.linalg.inv(self.camera_matrix @ np.column_stack([R[:, 0], R[:, 1], -R @ np.array(self.position)]))
        return H / H[2, 2]

    def project(self, points: np.ndarray) -> np.ndarray:
        """Pixels (..., 2) of points [m], (..., 2) on the strike plane or (..., 3) anywhere; NaN behind the camera."""
        points = np.asarray(points, float)
        if points.shape[-1] == 2:
            points = np.concatenate([points, np.zeros((*points.shape[:-1], 1))], axis=-1)
        x, y, z = np.moveaxis((points - np.array(self.position)) @ self.rotation_matrix.T, -1, 0)
        z = np.where(z > 0, z, np.nan)
        return np.stack([self.fx * x / z + self.cx, self.fy * y / z + self.cy], axis=-1)

    def to_plane(self, pixels: np.ndarray) -> np.ndarray:
        """Points on the strike plane [m], (..., 2), that pixels (..., 2) show."""
        return apply_homography(self.homography, pixels)

    def scale(self, point: np.ndarray) -> float:
        """Pixels per metre at a point (2,) [m] of the plane, for what is small and faces the camera."""
        depth = (np.append(point, 0.0) - np.array(self.position)) @ self.rotation_matrix[2]
        return float(np.sqrt(self.fx * self.fy) / depth)

    def slant(self, point: np.ndarray) -> float:
        """How much longer than wide a ball's image is, at a point (2,) [m] of the plane: off the axis an ellipse."""
        ray = np.append(point, 0.0) - np.array(self.position)
        return float(np.linalg.norm(ray) / (ray @ self.rotation_matrix[2]))

    def pose(self) -> tuple[np.ndarray, np.ndarray]:
        """Rotation from MuJoCo's axes to the camera's (right, down, forward), (3, 3), and its place there [m], (3,)."""
        x, y, z = self.position  # MuJoCo's z is our y
        return self.rotation_matrix @ np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]]), np.array([x, -z, y])

    def row_delay(self, row: float | np.ndarray) -> np.ndarray:
        """How long after the first row a row starts to collect light [s]."""
        return np.asarray(row, float) * self.readout / self.height


def apply_homography(H: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Points (..., 2) carried through a homography (3, 3)."""
    x = np.asarray(points, float) @ H[:, :2].T + H[:, 2]
    return x[..., :2] / x[..., 2:]


# The D435's lenses, from its data sheet: colour 1.93 mm before 1.4 um pixels, 1920 wide; infrared 1.93 mm before 3 um
# pixels, 1280 wide at 16:9. Scaled to a width of 848 that is 609 and 426 pixels: 69.7 and 89.7 deg across.
# Its readout is not published; users see its skew shrink with the time between frames (librealsense issue 3554), so
# the rows are taken to fill nine tenths of it. Exposures are those of a well-lit room, and of a marker that reflects
# the camera's own light. Seen from 3.5 m (Sect. 2.4), a little below the shoulder: so the whole hanging whip shows.
_D435 = {"width": 848, "height": 480, "cx": 423.5, "cy": 239.5, "position": (0.0, -0.2, 3.5), "rotation": (0.0, 0, 0)}
CAMERAS = {
    "d435-color": CameraSettings(
        "d435-color", fps=60, fx=609.0, fy=609.0, exposure=4e-3, readout=15e-3, kind="color", **_D435
    ),
    "d435-infrared": CameraSettings(
        "d435-infrared", fps=90, fx=426.0, fy=426.0, exposure=2e-3, readout=0.0, kind="infrared", **_D435
    ),
}


def camera_preset(name: str) -> CameraSettings:
    """Settings by name: `d435-color` or `d435-infrared`.

    Raises:
        InputError: No settings have this name.
    """
    if name not in CAMERAS:
        raise InputError("camera", name, " or ".join(CAMERAS))
    return CAMERAS[name]


@dataclass(frozen=True)
class Exposed:
    """What F exposures see of a moving point.

    Args:
        t_points: Middle of each exposure of the point [s], (F,).
        points: Mean of its path over the exposure [m], (F, 2), in space (F, 3).
        pixels: Mean of its image [pixels], (F, 2).
        duration: Time for which it was seen [s], (F,): the exposure, stretched where it runs along with the rows.
        speed: Mean speed meanwhile [m/s], (F,).
    """

    t_points: np.ndarray
    points: np.ndarray
    pixels: np.ndarray
    duration: np.ndarray
    speed: np.ndarray


def expose(settings: CameraSettings, t: np.ndarray, path: np.ndarray, starts: np.ndarray) -> Exposed:
    """The measurement model: means of a path over exposures, each row of a rolling shutter in its own time.

    Args:
        settings: The camera.
        t, path: Times [s], (T,), and positions [m], (T, 2), in space (T, 3); before and after, the point rests.
        starts: Start of exposure of the first row, of each frame [s], (F,).
    """

    def at(times: np.ndarray) -> np.ndarray:
        return np.stack([np.interp(times, t, x) for x in path.T], axis=-1)

    starts = np.asarray(starts, float)
    ends = np.stack([starts, starts + settings.exposure])  # (2, F): when the point's own row opens and closes
    for _ in range(20 if settings.readout else 0):  # contracts by the share of the rows' speed that the point has
        rows = settings.project(at(ends))[..., 1]
        ends = starts + np.array([[0.0], [settings.exposure]]) + settings.row_delay(rows)
    share = (np.arange(_SAMPLES) + 0.5) / _SAMPLES
    times = ends[0, :, None] + (ends[1] - ends[0])[:, None] * share  # (F, S)
    points = at(times)
    ways = reduce(np.hypot, np.moveaxis(np.diff(points, axis=1), -1, 0))
    length = ways.sum(axis=1) / (1 - 1 / _SAMPLES)
    duration = ends[1] - ends[0]
    return Exposed(
        t_points=ends.mean(axis=0),
        points=points.mean(axis=1),
        pixels=settings.project(points).mean(axis=1),
        duration=duration,
        speed=length / duration,
    )


def measurement_sigma(settings: CameraSettings, speed: float | np.ndarray) -> np.ndarray:
    """Standard error of a tracked point, per coordinate [m], for a marker that moves at `speed` [m/s].

    A floor and a share of the blur, fitted to the errors of `whiptool.vision.tracking` on the virtual camera's images
    of a marker of 25 mm radius at 3.5 m (0.03 pixels at rest, 0.07 at 30 m/s in colour). They are not white: successive
    ones correlate by 0.3 in colour and 0.7 in infrared, for lamps and whip shift the marker's light. A real camera adds
    what its calibration leaves.
    """
    blur = np.asarray(speed, float) * settings.exposure * settings.fx / settings.position[2]  # [pixels]
    return np.hypot(0.04, 0.004 * blur) * settings.position[2] / settings.fx
