"""Tracking of whip tip and target in a stream of images, on the strike plane (Sect. 2.4) or in pixels."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from whiptool.errors import InputError
from whiptool.recording.camera import Camera
from whiptool.recording.strike_recording import StrikeRecording
from whiptool.vision.calibration import PlaneCalibration
from whiptool.vision.marker_tracker import MarkerTracker, Sighting
from whiptool.vision.markers import TARGET_MARKERS, TIP_MARKERS, Marker
from whiptool.vision.source import Frame, FrameSource, frames_of


@dataclass(frozen=True, eq=False)
class MarkerTrack:
    """Track of one marker over T frames."""

    t: np.ndarray  # start of each frame's exposure [s], (T,)
    t_points: np.ndarray  # middle of the marker's own exposure [s], (T,)
    pixels: np.ndarray  # mean positions over the exposures [pixels], (T, 2); NaN where unsure
    points: np.ndarray  # mean positions on the strike plane [m], (T, 2)
    sigma: np.ndarray  # standard errors of the points, per coordinate [m], (T,)
    confidence: np.ndarray  # in [0, 1], (T,)

    @classmethod
    def of(cls, t: np.ndarray, sightings: list[Sighting]) -> MarkerTrack:
        """Return the track of a marker from one sighting per frame."""
        columns = {name: np.array([getattr(x, name) for x in sightings]) for name in ("sigma", "confidence")}
        return cls(
            t=t,
            t_points=np.array([x.t_point for x in sightings]),
            pixels=np.array([x.pixel for x in sightings]).reshape(-1, 2),
            points=np.array([x.point for x in sightings]).reshape(-1, 2),
            **columns,
        )


@dataclass(frozen=True, eq=False)
class StrikeTrack:
    """Tracks of tip and target over T frames of one camera (`settings`), and the `distance` between tip and target [m],
    (T,), as in the paper's Fig. 3."""

    tip: MarkerTrack
    target: MarkerTrack
    distance: np.ndarray
    settings: Camera

    @property
    def target_position(self) -> np.ndarray | None:
        """Median of the target's reliable positions [m], (2,), or None if it was never seen."""
        seen = self.target.points[~np.isnan(self.target.points[:, 0])]
        return np.median(seen, axis=0) if len(seen) else None

    def to_recording(self, **known: Any) -> StrikeRecording:
        """Return the track as a recording with the marker `tip`, for identification; `known` are other fields of
        `StrikeRecording`, such as strike and source, of which a target takes precedence over the tracked one."""
        if "target" not in known and self.target_position is not None:
            known["target"] = tuple(self.target_position.tolist())
        fields: dict[str, Any] = {
            "t": self.tip.t,
            "points": self.tip.points[:, None],
            "markers": ("tip",),
            "sigma": self.tip.sigma[:, None],
            "t_points": self.tip.t_points[:, None],
            "exposure": self.settings.exposure,
            "camera": self.settings.name,
            **known,
        }
        return StrikeRecording(**fields)


def track(
    source: FrameSource | Iterable[Frame],
    *,
    tip: Marker | None = None,
    target: Marker | None = None,
    calibration: PlaneCalibration | None = None,
    background: np.ndarray | None = None,
    tip_start: np.ndarray | None = None,
) -> StrikeTrack:
    """Follow tip and target on the strike plane through all frames of a source.

    While the tip or the arm covers the target, its last reliable position is used.

    Args:
        source: A source, which is opened and closed, or frames; all of one camera, in the order of time.
        tip, target: Appearance of the markers; default: as in the virtual camera's images of the same kind.
        calibration: Calibration of the strike plane; default: from the camera's pose.
        background: Image of the scene without tip, such as that of `median_image`; default: learned from the first
            frame.
        tip_start: Position of the tip in the first frame (2,) [pixels]; only needed if several objects look like it.

    Raises:
        InputError: There are no frames, they are not in the order of time, or a marker has a hue in infrared, or none
            in color.
    """

    def trackers(camera: Camera) -> list[MarkerTracker]:
        looks, other = tip or TIP_MARKERS[camera.kind], target or TARGET_MARKERS[camera.kind]
        return [
            MarkerTracker(looks, camera, calibration=calibration, background=background, start=tip_start),
            MarkerTracker(other, camera, calibration=calibration),
        ]

    camera, (of_tip, of_target) = _followed(source, trackers)
    place, distance = np.full(2, np.nan), []
    for point, where in zip(of_tip.points, of_target.points, strict=True):
        place = place if np.isnan(where[0]) else where
        distance.append(float(np.hypot(*(point - place))))
    return StrikeTrack(of_tip, of_target, np.array(distance), camera)


def track_view(
    source: FrameSource | Iterable[Frame],
    /,
    *,
    tip: Marker | None = None,
    start: np.ndarray | None = None,
    distance: float = 3.0,
    **known: Any,
) -> StrikeRecording:
    """Track the tip in the images of a camera in space, and return the recording in pixels.

    Args:
        source: A source, which is opened and closed, or frames; all of one camera, in the order of time.
        tip: Appearance of the tip's marker; default: as in the virtual camera's images of the same kind.
        start: Position of the tip in the first frame (2,) [pixels]; only needed if several objects look like it.
        distance: Distance from the camera about which the tip moves [m].
        known: Other fields of the recording, such as strike, controller, t_stay, joints_t and joints_q.

    Raises:
        InputError: There are no frames, they are not in the order of time, or the tip was never seen.
    """

    def trackers(camera: Camera) -> list[MarkerTracker]:
        return [MarkerTracker(tip or TIP_MARKERS[camera.kind], camera, distance=distance, start=start)]

    camera, (found,) = _followed(source, trackers)
    sigma = found.sigma * np.sqrt(np.prod(camera.focal_lengths)) / distance  # of the plane that sightings lie in
    return StrikeRecording(
        t=found.t + camera.exposure / 2,
        points=found.pixels[:, None],
        markers=("tip",),
        sigma=np.where(np.isfinite(sigma), sigma, 1.0)[:, None],
        view=camera,
        **known,
    )


def _followed(
    source: FrameSource | Iterable[Frame], trackers: Callable[[Camera], list[MarkerTracker]]
) -> tuple[Camera, list[MarkerTrack]]:
    """The camera of a source, and the tracks that trackers for it make of its frames."""
    frames = frames_of(source) if isinstance(source, FrameSource) else source
    camera, at_work, seen, t = None, [], [], []
    for frame in frames:
        if camera is None:
            camera, at_work = frame.settings, trackers(frame.settings)
        elif frame.t <= t[-1]:
            raise InputError("frames", frame.t, f"times after {t[-1]:g} s, that of the previous frame")
        seen.append([tracker.update(frame) for tracker in at_work])
        t.append(frame.t)
    if camera is None:
        raise InputError("frames", "none", "at least one frame")
    return camera, [MarkerTrack.of(np.array(t), list(sightings)) for sightings in zip(*seen, strict=True)]


def median_image(frames: Iterable[Frame], *, most: int = 25) -> np.ndarray:
    """Return the static scene for `track(background=...)`: the median, (H, W, ...), over frames spread evenly in
    time.
    """
    images = [frame.image for frame in frames]
    chosen = np.unique(np.linspace(0, len(images) - 1, min(most, len(images))).astype(int))
    return np.median(np.stack([images[i] for i in chosen]), axis=0).astype(np.uint8)
