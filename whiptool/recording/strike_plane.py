"""The strike plane through markers in space, and recordings projected on it."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from whiptool.errors import InputError
from whiptool.recording.strike_recording import StrikeRecording

_THIN = 1e-2  # breadth over length of the points below which they lie on a line and no plane is fitted
_ONE_PLANE = np.deg2rad(5)  # between a recording's own plane and that of all, up to which they are the same
_DISTINCT = 3.0  # breadth over depth of the points from which they have their own plane
_STEEPEST = np.deg2rad(30)  # of a plane against the vertical, in which a whip's weight still keeps its motion


@dataclass(frozen=True, eq=False)
class StrikePlane:
    """A plane through points in space.

    The recordings' y axis is assumed to point up; if it does not, the key `axes` of the sidecar has to state the axes.
    The plane's x axis is horizontal and points forward, its y axis points up within the plane. Gravity in the plane is
    smaller by the cosine of `tilt`, which the model neglects.
    """

    axes: np.ndarray  # rows: the plane's x axis, y axis and normal in the recordings' axes, (3, 3)
    offset: float  # of the plane from the shoulder along the normal [m]
    tilt: float  # of the plane against the vertical [rad]
    rms: float  # root mean square distance of the points from the plane [m]
    largest: float  # largest distance of a point from the plane [m]

    def __str__(self) -> str:
        return (
            f"fitted through the points in space: {1e3 * self.rms:.2f} mm RMS and at most {1e3 * self.largest:.2f} mm "
            f"out of plane, {np.rad2deg(self.tilt):.2f} deg from the vertical, {1e3 * self.offset:+.1f} mm from the "
            "shoulder; y is taken to point up, and gravity to lie in the plane"
        )

    def project(self, recording: StrikeRecording) -> StrikeRecording:
        """Project a recording in space on the plane, with the projection of the shoulder as origin; planar recordings
        are unchanged.

        The stated standard errors are kept.
        """
        if recording.points.shape[2] == 2:
            return recording
        target = recording.target
        if target is not None and len(target) == 3:
            target = tuple((self.axes[:2] @ np.array(target)).tolist())
        return dataclasses.replace(recording, points=recording.points @ self.axes[:2].T, target=target)


def fit_plane(recordings: Sequence[StrikeRecording]) -> StrikePlane | None:
    """Fit a plane to all points of the recordings in space by total least squares; None if all recordings are planar.
    Points on a line, and a plane that is nearly horizontal or faces forward, are refused."""
    points = [r.points[r.seen] for r in recordings if r.points.shape[2] == 3]
    if not points:
        return None
    X = np.concatenate(points)  # (K, 3)
    middle = X.mean(axis=0)
    _, s, directions = np.linalg.svd(X - middle, full_matrices=False)
    if len(s) < 3 or s[1] < _THIN * s[0]:
        raise InputError("points", f"{len(X)} points on a line", "points that span the strike plane")
    normal = directions[2]
    tilt = float(np.arcsin(abs(normal[1])))
    if tilt > _STEEPEST:
        raise InputError(
            "points",
            f"a plane {np.rad2deg(tilt):.0f} deg from the vertical",
            f"a strike plane within {np.rad2deg(_STEEPEST):.0f} deg of it",
            "does y point up? (key axes of the sidecar)",
        )
    x = np.array([normal[2], 0.0, -normal[0]]) / np.hypot(normal[0], normal[2])  # horizontal, in the plane
    if abs(x[0]) < 0.5:
        raise InputError(
            "points",
            f"a plane that runs {np.rad2deg(np.arccos(abs(x[0]))):.0f} deg aside of x",
            "a strike plane along x, which points forward",
            "give the key axes of the sidecar",
        )
    x *= np.sign(x[0])
    y = np.cross(normal, x)
    y, normal = (y, normal) if y[1] > 0 else (-y, -normal)
    away = (X - middle) @ normal
    return StrikePlane(
        axes=np.stack([x, y, normal]),
        offset=float(middle @ normal),
        tilt=tilt,
        rms=float(np.sqrt(np.mean(away**2))),
        largest=float(np.abs(away).max()),
    )


def check_one_plane(recordings: Sequence[StrikeRecording], plane: StrikePlane) -> None:
    """Refuse recordings in space whose plane differs from the common plane.

    Their projected motion would be too short: by 18 % at 35 degrees. Recordings whose points are nearly on a line have
    no strike plane and are accepted.
    """
    for recording in recordings:
        if recording.points.shape[2] == 2:
            continue
        X = recording.points[recording.seen]
        _, s, directions = np.linalg.svd(X - X.mean(axis=0), full_matrices=False)
        if len(s) < 3 or s[1] < _THIN * s[0] or s[1] < _DISTINCT * s[2]:
            continue
        angle = np.arccos(min(1.0, abs(float(directions[2] @ plane.axes[2]))))
        if angle > _ONE_PLANE:
            raise InputError(
                f"{recording.called}: points",
                f"in a plane {np.rad2deg(angle):.0f} deg from that of all recordings together",
                f"recordings of one plane, within {np.rad2deg(_ONE_PLANE):.0f} deg",
                "turn each into its own plane (keys axes and origin of its sidecar), or fit them apart",
            )
