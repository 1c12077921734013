"""A camera anywhere in space: how it sees points of the world, through a lens that distorts.

A pixel's centre has whole coordinates (u to the right, v down), as in OpenCV. The world is that of the models in space:
x forward, y to the left, z up, in metres. `camera_model.CameraSettings` is the camera that faces the plane of strikes.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from whiptool.errors import InputError
from whiptool.recording.lens import COEFFICIENTS, distort, distortion_slopes, undistort

_UNIT = 1e-6  # how far from orthonormal a rotation may be


@dataclass(frozen=True, eq=False)
class SpaceCamera:
    """Intrinsics, lens, pose and timing of a camera in space.

    Args:
        name: For people and for files.
        width, height: Width and height of its images [pixels].
        camera_matrix: Intrinsics [pixels], (3, 3): focal lengths on the diagonal, principal point in the last column.
        rotation: Rotation from the world's axes to the camera's (right, down, forward), (3, 3).
        position: Position of its centre of projection in the world [m], (3,).
        distortion: Coefficients of OpenCV's model (k1, k2, p1, p2[, k3[, k4, k5, k6]]); empty: none.
        fps: Frames per second.
        exposure: Exposure time of each row [s].
        readout: Time from the first row's start to the start of the row after the last [s]; 0 is a global shutter.

    Raises:
        InputError: A number is out of range, a shape is wrong, or the matrix is not a rotation.
    """

    name: str
    width: int
    height: int
    camera_matrix: np.ndarray
    rotation: np.ndarray
    position: np.ndarray
    distortion: tuple[float, ...] = ()
    fps: float = 60.0
    exposure: float = 4e-3
    readout: float = 0.0

    def __post_init__(self) -> None:
        for name in ("width", "height", "fps", "exposure"):
            value = getattr(self, name)
            if not 0 < value < np.inf:
                raise InputError(name, value, "a finite number > 0")
        if not 0 <= self.readout < np.inf:
            raise InputError("readout", self.readout, "a time >= 0 s; 0 is a global shutter")
        for name, shape in (("camera_matrix", (3, 3)), ("rotation", (3, 3)), ("position", (3,))):
            value = np.array(getattr(self, name), float)
            if value.shape != shape or not np.isfinite(value).all():
                raise InputError(name, value.tolist(), f"finite numbers of shape {shape}")
            object.__setattr__(self, name, value)
        K, R = self.camera_matrix, self.rotation
        plain = np.array([[K[0, 0], 0, K[0, 2]], [0, K[1, 1], K[1, 2]], [0, 0, 1]])
        if not np.array_equal(K, plain) or not (self.focal_lengths > 0).all():
            raise InputError("camera_matrix", K.tolist(), "[[fx, 0, cx], [0, fy, cy], [0, 0, 1]], fx and fy > 0")
        if np.abs(R @ R.T - np.eye(3)).max() > _UNIT or np.linalg.det(R) < 0:
            raise InputError("rotation", R.tolist(), "a rotation matrix")
        distortion = tuple(float(x) for x in self.distortion)
        if len(distortion) not in COEFFICIENTS or not np.isfinite(distortion).all():
            raise InputError("distortion", distortion, f"{', '.join(map(str, COEFFICIENTS))} finite numbers")
        object.__setattr__(self, "distortion", distortion)

    @property
    def focal_lengths(self) -> np.ndarray:
        """Focal lengths along u and v [pixels], (2,)."""
        return np.diag(self.camera_matrix)[:2]

    @property
    def principal_point(self) -> np.ndarray:
        """Where the optical axis meets the image [pixels], (2,)."""
        return self.camera_matrix[:2, 2]

    def table(self) -> dict[str, Any]:
        """Return all its numbers as plain data, by the names of the fields."""
        values = {field.name: getattr(self, field.name) for field in dataclasses.fields(self)}
        return {name: np.asarray(value).tolist() for name, value in values.items()}

    def to_camera(self, points: np.ndarray) -> np.ndarray:
        """Return points of the world (..., 3) [m] in the camera's axes (right, down, forward), (..., 3) [m]."""
        return (np.asarray(points, float) - self.position) @ self.rotation.T

    def depth(self, points: np.ndarray) -> np.ndarray:
        """Return how far points of the world (..., 3) [m] are along the optical axis [m], (...); NaN behind."""
        z = self.to_camera(points)[..., 2]
        return np.where(z > 0, z, np.nan)

    def project(self, points: np.ndarray) -> np.ndarray:
        """Return the pixels (..., 2) of points of the world (..., 3) [m]; NaN behind the camera."""
        flat, _ = self._flat(points)
        return distort(flat, self.distortion) * self.focal_lengths + self.principal_point

    def slopes(self, points: np.ndarray) -> np.ndarray:
        """Return the derivatives of `project` by the points (..., 3) [m]: (..., 2, 3) [pixels/m]."""
        flat, z = self._flat(points)
        by_place = (self.rotation[:2] - flat[..., None] * self.rotation[2]) / z[..., None, None]  # of x/z and y/z
        return self.focal_lengths[:, None] * (distortion_slopes(flat, self.distortion) @ by_place)

    def _flat(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return normalised image coordinates without distortion (..., 2), and depths [m], (...); NaN behind."""
        x, y, _ = np.moveaxis(self.to_camera(points), -1, 0)
        z = self.depth(points)
        return np.stack([x / z, y / z], axis=-1), z

    def sights(self, pixels: np.ndarray) -> np.ndarray:
        """Return the directions in the world (..., 3), of unit length, in which pixels (..., 2) look; NaN for NaN."""
        flat = (self.undistorted(pixels) - self.principal_point) / self.focal_lengths
        ahead = np.concatenate([flat, np.ones((*flat.shape[:-1], 1))], axis=-1)
        return (ahead / np.linalg.norm(ahead, axis=-1, keepdims=True)) @ self.rotation

    def undistorted(self, pixels: np.ndarray) -> np.ndarray:
        """Return pixels (..., 2) as a lens without distortion would have shown them."""
        return undistort(pixels, self.camera_matrix, self.distortion)

    def sees(self, points: np.ndarray) -> np.ndarray:
        """Return which points of the world (..., 3) [m] are before the camera and within its image, (...)."""
        u, v = np.moveaxis(self.project(points), -1, 0)
        return (u >= -0.5) & (u <= self.width - 0.5) & (v >= -0.5) & (v <= self.height - 0.5)  # of NaN: false

    def row_delay(self, row: float | np.ndarray) -> np.ndarray:
        """Return how long after the first row a row starts to collect light [s]."""
        return np.asarray(row, float) * self.readout / self.height


def looking_at(position: Sequence[float] | np.ndarray, point: Sequence[float] | np.ndarray) -> np.ndarray:
    """Return the rotation (3, 3) from the world's axes to those of a camera that looks upright at a point.

    Args:
        position: Position of the camera [m], (3,).
        point: Point on its optical axis [m], (3,).

    Raises:
        InputError: The point is where the camera is, or straight above or below it.
    """
    forward = np.asarray(point, float) - np.asarray(position, float)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    if np.linalg.norm(right) < 1e-9 * max(np.linalg.norm(forward), 1e-9):
        raise InputError(
            "point", np.asarray(point).tolist(), "a point neither at the camera nor straight above or below"
        )
    forward, right = forward / np.linalg.norm(forward), right / np.linalg.norm(right)
    return np.stack([right, np.cross(forward, right), forward])
