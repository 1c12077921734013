"""The pinhole camera: intrinsics, lens distortion, pose and timing; and presets of the D435 that the paper uses.

A pixel's centre has whole coordinates (u to the right, v down), as in OpenCV. The world is that of the models in space:
x forward, y to the left, z up, in metres, its origin at the shoulder. The strike plane is y = 0 of it: its points
(x, y) [m], y pointing up, are (x, 0, y) in the world. Lenses distort by Brown and Conrady's model, as in OpenCV.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from whiptool.errors import InputError
from whiptool.extras import optional
from whiptool.given_files import build_from, read_toml
from whiptool.models.numbers import float_array
from whiptool.whole_files import write_whole

KINDS = ("color", "infrared")  # of light
BASELINE = 0.05  # [m] between a D435's infrared cameras
SUBPIXEL = 0.08  # [pixels], standard error of its disparity
TABLE = "cameras"  # of a file of cameras
COEFFICIENTS = (0, 4, 5, 8)  # how many there are: k1, k2, p1, p2[, k3[, k4, k5, k6]]
_UNIT = 1e-6  # how far from orthonormal a rotation may be
_BEFORE = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])  # from the world's axes to the plane's: x, up, to the camera


def distort(flat: np.ndarray, distortion: tuple[float, ...]) -> np.ndarray:
    """Return normalised image coordinates `flat` (..., 2) as a lens distorts them, with OpenCV's coefficients."""
    if not distortion:
        return flat
    x, y = np.moveaxis(flat, -1, 0)
    _, _, p1, p2, *_ = distortion
    r2 = x**2 + y**2
    above, below, _, _ = _radial(r2, distortion)
    radial = above / below
    u = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x**2)
    v = y * radial + p1 * (r2 + 2 * y**2) + 2 * p2 * x * y
    return np.stack([u, v], axis=-1)


def distortion_slopes(flat: np.ndarray, distortion: tuple[float, ...]) -> np.ndarray:
    """Return the derivatives of `distort` by the undistorted coordinates, (..., 2, 2); entry [i, j] is of output i by
    input j.
    """
    if not distortion:
        return np.broadcast_to(np.eye(2), (*flat.shape, 2))
    x, y = np.moveaxis(flat, -1, 0)
    _, _, p1, p2, *_ = distortion
    above, below, by_above, by_below = _radial(x**2 + y**2, distortion)
    radial = above / below
    slope = 2 * (by_above - radial * by_below) / below  # of the radial factor by x, over x
    across = x * y * slope + 2 * p1 * x + 2 * p2 * y
    u_x = radial + x**2 * slope + 2 * p1 * y + 6 * p2 * x
    v_y = radial + y**2 * slope + 6 * p1 * y + 2 * p2 * x
    return np.stack([np.stack([u_x, across], axis=-1), np.stack([across, v_y], axis=-1)], axis=-2)


def _radial(r2: np.ndarray, distortion: tuple[float, ...]) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return the radial factor's numerator and denominator, and the derivatives of both by r^2."""
    k1, k2, _, _, k3, k4, k5, k6 = (*distortion, *(0.0,) * (8 - len(distortion)))
    above, below = 1 + r2 * (k1 + r2 * (k2 + r2 * k3)), 1 + r2 * (k4 + r2 * (k5 + r2 * k6))
    return above, below, k1 + r2 * (2 * k2 + 3 * r2 * k3), k4 + r2 * (2 * k5 + 3 * r2 * k6)


def undistort(
    pixels: np.ndarray, camera_matrix: np.ndarray | None = None, distortion: Sequence[float] = ()
) -> np.ndarray:
    """Return pixels (..., 2) corrected for a lens's distortion, with OpenCV's coefficients."""
    pixels = np.asarray(pixels, float)
    if not len(distortion) or camera_matrix is None or not pixels.size:
        return pixels
    cv2 = opencv()
    precise = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 50, 1e-9)
    flat = cv2.undistortImagePoints(
        pixels.reshape(-1, 1, 2), np.asarray(camera_matrix, float), np.array(distortion, float), None, precise
    )
    return flat.reshape(pixels.shape)


def opencv() -> Any:
    """Return the module cv2; an InputError says so if OpenCV is not installed or does not load."""
    return optional("cv2", "cameras and images")


@dataclass(frozen=True, eq=False)
class Camera:
    """Intrinsics, lens, pose and timing of a camera.

    Args:
        name: Name of the camera, in messages and files.
        width, height: Width and height of its images [pixels].
        camera_matrix: Intrinsics [pixels], (3, 3): focal lengths on the diagonal, principal point in the last column.
        rotation: Rotation from the world's axes to the camera's (right, down, forward), (3, 3).
        position: Position of its centre of projection in the world [m], (3,).
        distortion: Coefficients of OpenCV's model (k1, k2, p1, p2[, k3[, k4, k5, k6]]); empty: none.
        fps: Frames per second.
        exposure: Exposure time of each row [s].
        readout: Time from the start of the first row's exposure to that of the row after the last [s]; 0 for a global
            shutter.
        kind: Kind of light, `color` or `infrared`.

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
    kind: str = "color"

    def __post_init__(self) -> None:
        for name in ("width", "height", "fps", "exposure"):
            value = getattr(self, name)
            if not 0 < value < np.inf:
                raise InputError(name, value, "a finite number > 0")
        if not 0 <= self.readout < np.inf:
            raise InputError("readout", self.readout, "a time >= 0 s; 0 is a global shutter")
        if self.kind not in KINDS:
            raise InputError("kind", self.kind, " or ".join(KINDS))
        for name, shape in (("camera_matrix", (3, 3)), ("rotation", (3, 3)), ("position", (3,))):
            value = float_array(name, getattr(self, name))
            if value.shape != shape or not np.isfinite(value).all():
                raise InputError(name, value.tolist(), f"finite numbers of shape {shape}")
            object.__setattr__(self, name, value)
        K, R = self.camera_matrix, self.rotation
        if not np.array_equal(K, pinhole(K[0, 0], K[1, 1], K[0, 2], K[1, 2])) or not (self.focal_lengths > 0).all():
            raise InputError("camera_matrix", K.tolist(), "[[fx, 0, cx], [0, fy, cy], [0, 0, 1]], fx and fy > 0")
        if np.abs(R @ R.T - np.eye(3)).max() > _UNIT or np.linalg.det(R) < 0:
            raise InputError("rotation", R.tolist(), "a rotation matrix")
        distortion = tuple(float_array("distortion", self.distortion).ravel().tolist())
        if len(distortion) not in COEFFICIENTS or not np.isfinite(distortion).all():
            raise InputError("distortion", distortion, f"{', '.join(map(str, COEFFICIENTS))} finite numbers")
        object.__setattr__(self, "distortion", distortion)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Camera) and self.table() == other.table()

    def __hash__(self) -> int:
        return hash(self.name)

    @property
    def focal_lengths(self) -> np.ndarray:
        """Focal lengths along u and v [pixels], (2,)."""
        return np.diag(self.camera_matrix)[:2]

    @property
    def principal_point(self) -> np.ndarray:
        """Principal point, where the optical axis meets the image [pixels], (2,)."""
        return self.camera_matrix[:2, 2]

    @property
    def distance(self) -> float:
        """Distance of the camera from the strike plane [m], negative behind it."""
        return -float(self.position[1])

    def table(self) -> dict[str, Any]:
        """Return all parameters as plain data, by the names of the fields."""
        values = {field.name: getattr(self, field.name) for field in dataclasses.fields(self)}
        return {name: np.asarray(value).tolist() for name, value in values.items()}

    def replace(self, **changes: Any) -> Camera:
        """Return the same camera with some fields changed."""
        return dataclasses.replace(self, **changes)

    def to_camera(self, points: np.ndarray) -> np.ndarray:
        """Return points of the world (..., 3) or of the strike plane (..., 2) [m] in the camera's axes (right, down,
        forward), (..., 3) [m]."""
        points = np.asarray(points, float)
        if points.shape[-1] == 2:
            points = np.insert(points, 1, 0.0, axis=-1)
        return (points - self.position) @ self.rotation.T

    def depth(self, points: np.ndarray) -> np.ndarray:
        """Return the depth of points (..., 2 or 3) [m] along the optical axis [m], (...); NaN behind the camera."""
        z = self.to_camera(points)[..., 2]
        return np.where(z > 0, z, np.nan)

    def depth_error(
        self, depth: float | np.ndarray, *, baseline: float = BASELINE, subpixel: float = SUBPIXEL
    ) -> np.ndarray:
        """Return the standard error of depth [m] that a stereo pair with this camera's focal length measures.

        A depth z appears as a disparity f b / z [pixels], the shift of a point between the images of two cameras with
        focal length f [pixels] that are b apart. Its standard error sigma_d is the same at all distances, so that
        `sigma_z = z^2 sigma_d / (f b)`.

        Source: A. Grunnet-Jepsen, J. N. Sweetser, J. Woodfill, "Tuning depth cameras for best performance" (Intel),
        https://dev.intelrealsense.com/docs/tuning-depth-cameras-for-best-performance, which calls sigma_d the subpixel.
        For a D435 it can be as low as 0.03 on a surface with texture; one of its authors advises 0.08
        (https://github.com/IntelRealSense/librealsense/issues/3904).

        Args:
            depth: Depth along the optical axis [m], any shape.
            baseline: Distance b between the two cameras of the pair [m].
            subpixel: Standard error sigma_d of the disparity [pixels].
        """
        return np.asarray(depth, float) ** 2 * subpixel / (self.focal_lengths[0] * baseline)

    def project(self, points: np.ndarray) -> np.ndarray:
        """Return the pixels (..., 2) of points of the world (..., 3) or of the strike plane (..., 2) [m]; NaN behind
        the camera."""
        flat, _ = self._flat(points)
        return distort(flat, self.distortion) * self.focal_lengths + self.principal_point

    def slopes(self, points: np.ndarray) -> np.ndarray:
        """Return the derivatives of `project` by the points (..., 3) [m]: (..., 2, 3) [pixels/m]."""
        flat, z = self._flat(points)
        by_place = (self.rotation[:2] - flat[..., None] * self.rotation[2]) / z[..., None, None]  # of x/z and y/z
        return self.focal_lengths[:, None] * (distortion_slopes(flat, self.distortion) @ by_place)

    def _flat(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return normalised image coordinates without distortion (..., 2), and depths [m], (...); NaN behind."""
        x, y, z = np.moveaxis(self.to_camera(points), -1, 0)
        z = np.where(z > 0, z, np.nan)
        return np.stack([x / z, y / z], axis=-1), z

    def sights(self, pixels: np.ndarray) -> np.ndarray:
        """Return unit vectors in the world (..., 3) along the lines of sight of pixels (..., 2); NaN for NaN."""
        flat = (self.undistorted(pixels) - self.principal_point) / self.focal_lengths
        ahead = np.concatenate([flat, np.ones((*flat.shape[:-1], 1))], axis=-1)
        return (ahead / np.linalg.norm(ahead, axis=-1, keepdims=True)) @ self.rotation

    def undistorted(self, pixels: np.ndarray) -> np.ndarray:
        """Return pixels (..., 2) corrected for the lens's distortion."""
        return undistort(pixels, self.camera_matrix, self.distortion)

    @cached_property
    def homography(self) -> np.ndarray:
        """Homography from undistorted pixels to metres on the strike plane, (3, 3), with last entry 1."""
        R = self.rotation
        H = np.linalg.inv(self.camera_matrix @ np.column_stack([R[:, 0], R[:, 2], -R @ self.position]))
        return H / H[2, 2]

    def to_plane(self, pixels: np.ndarray) -> np.ndarray:
        """Return the points on the strike plane [m], (..., 2), that pixels (..., 2) show."""
        return to_plane(self.homography, self.undistorted(pixels))

    def facing(self, distance: float) -> np.ndarray:
        """Return the homography (3, 3) from undistorted pixels to metres on a plane perpendicular to the optical axis,
        at a distance [m]; the plane's origin is on that axis."""
        (fx, fy), (u, v) = self.focal_lengths, self.principal_point
        return np.array([[distance / fx, 0, -u * distance / fx], [0, -distance / fy, v * distance / fy], [0, 0, 1]])

    def scale(self, point: np.ndarray) -> float:
        """Return the image scale [pixels/m] of a small object that faces the camera, at a point (2 or 3,) [m]."""
        return float(np.sqrt(np.prod(self.focal_lengths)) / self.to_camera(point)[2])

    def slant(self, point: np.ndarray) -> float:
        """Return the ratio of length to width of the elliptic image of a ball at a point (2 or 3,) [m]."""
        ray = self.to_camera(point)
        return float(np.linalg.norm(ray) / ray[2])

    def sees(self, points: np.ndarray) -> np.ndarray:
        """Return which points of the world (..., 3) [m] are in front of the camera and within its image, (...)."""
        u, v = np.moveaxis(self.project(points), -1, 0)
        return (u >= -0.5) & (u <= self.width - 0.5) & (v >= -0.5) & (v <= self.height - 0.5)  # of NaN: false

    def row_delay(self, row: float | np.ndarray) -> np.ndarray:
        """Return the time from the start of the first row's exposure to that of a row [s]."""
        return np.asarray(row, float) * self.readout / self.height


def to_plane(homography: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    """Return positions in the plane [m] of pixels, (..., 2) each; NaN for NaN and for pixels beyond the plane's
    horizon.
    """
    h = np.asarray(pixels, float) @ homography[:, :2].T + homography[:, 2]  # (..., 3)
    front = h[..., 2:] * np.sign(homography[2, 2] or 1.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(front > 0, h[..., :2] / h[..., 2:], np.nan)


def pinhole(fx: float, fy: float, cx: float, cy: float) -> np.ndarray:
    """Return the camera matrix (3, 3) of focal lengths and a principal point [pixels]."""
    return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]])


def looking_at(position: Sequence[float] | np.ndarray, point: Sequence[float] | np.ndarray) -> np.ndarray:
    """Return the rotation (3, 3) from the world's axes to those of an upright camera at `position` (3,) [m] that looks
    at a point (3,) [m], which must not be directly above or below it."""
    forward = np.asarray(point, float) - np.asarray(position, float)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    if np.linalg.norm(right) < 1e-9 * max(np.linalg.norm(forward), 1e-9):
        raise InputError(
            "point", np.asarray(point).tolist(), "a point neither at the camera nor straight above or below"
        )
    forward, right = forward / np.linalg.norm(forward), right / np.linalg.norm(right)
    return np.stack([right, np.cross(forward, right), forward])


def before_plane(position: Sequence[float], turn: np.ndarray | None = None) -> dict[str, Any]:
    """Return rotation and position, as `Camera` takes them, of a camera before the strike plane. `position` (3,) [m] is
    how far it is forward of the shoulder, above it and from the plane; `turn` (3, 3) rotates it, in its own axes, from
    upright and perpendicular to the plane."""
    rotation = (np.eye(3) if turn is None else turn) @ np.diag([1.0, -1.0, -1.0]) @ _BEFORE
    x, up, distance = position
    if not distance > 0 or rotation[2, 1] <= 0:
        raise InputError(
            "position and turn", [*position, rotation.tolist()], "a camera in front of the plane that faces it"
        )
    return {"rotation": rotation, "position": np.array([x, -distance, up])}


# The D435's lenses, from its data sheet: colour 1.93 mm before 1.4 um pixels, 1920 wide; infrared 1.93 mm before 3 um
# pixels, 1280 wide at 16:9. Scaled to a width of 848 that is 609 and 426 pixels: 69.7 and 89.7 deg across.
# Its readout is not published; users see its skew shrink with the time between frames (librealsense issue 3554), so
# the rows are taken to fill nine tenths of it. Exposures are those of a well-lit room, and of a marker that reflects
# the camera's own light. Seen from 3.5 m (Sect. 2.4), a little below the shoulder: so the whole hanging whip shows.
_D435: dict[str, Any] = {"width": 848, "height": 480, **before_plane((0.0, -0.2, 3.5))}
CAMERAS = {
    "d435-color": Camera(
        "d435-color", camera_matrix=pinhole(609, 609, 423.5, 239.5), exposure=4e-3, readout=15e-3, **_D435
    ),
    "d435-infrared": Camera(
        "d435-infrared", camera_matrix=pinhole(426, 426, 423.5, 239.5), fps=90, exposure=2e-3, kind="infrared", **_D435
    ),
}


def camera_preset(name: str) -> Camera:
    """Return a camera by name: `d435-color` or `d435-infrared`."""
    if name not in CAMERAS:
        raise InputError("camera", name, " or ".join(CAMERAS))
    return CAMERAS[name]


def write_cameras(path: str | Path, cameras: Mapping[str, Camera]) -> None:
    """Write cameras to a TOML file, by name, at full precision."""
    tables = {name: {key: x for key, x in camera.table().items() if key != "name"} for name, camera in cameras.items()}
    write_whole(Path(path), tomli_w.dumps({TABLE: tables}))


def read_cameras(path: str | Path) -> dict[str, Camera]:
    """Return the cameras of a file, by name.

    Raises:
        InputError: The file is not TOML or has no table of cameras, or a camera has missing or unknown keys or values
            that are not allowed.
    """
    try:
        table = read_toml(Path(path))
    except InputError as error:
        raise error.renamed("cameras") from None
    cameras = table.get(TABLE)
    if set(table) != {TABLE} or not isinstance(cameras, dict) or not cameras:
        raise InputError(str(path), ", ".join(table) or "nothing", f"tables [{TABLE}.NAME], one for each camera")
    for name, of_camera in cameras.items():
        if not isinstance(of_camera, dict) or "name" in of_camera:
            raise InputError(f"{TABLE}.{name}", of_camera, "a table of one camera, headed [cameras.NAME]")
    return {name: camera_of(f"{TABLE}.{name}", {**of_camera, "name": name}) for name, of_camera in cameras.items()}


def camera_of(place: str, table: object) -> Camera:
    """Return the camera of a table that `Camera.table` wrote; `place` is the prefix of names in error messages."""
    try:
        return build_from(Camera, table, f"{place}.")
    except (TypeError, ValueError, OverflowError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(place, str(error), "numbers, in arrays where `write_cameras` writes arrays") from None
