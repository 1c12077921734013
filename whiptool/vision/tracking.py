"""Whip tip and target in a stream of images, live or recorded, on the strike plane (Sect. 2.4)."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from whiptool.errors import InputError
from whiptool.vision.calibration import PlaneCalibration
from whiptool.vision.camera_model import CameraSettings
from whiptool.vision.marker_tracker import SURE, MarkerTracker, Sighting
from whiptool.vision.markers import TARGET_MARKERS, TIP_MARKERS, Marker
from whiptool.vision.source import Frame, FrameSource, frames_of

if TYPE_CHECKING:
    from whiptool.recording.strike_recording import StrikeRecording

__all__ = [
    "SURE",
    "Detection",
    "Sighting",
    "StrikeTrack",
    "Track",
    "Tracker",
    "median_image",
    "track",
]


@dataclass(frozen=True, eq=False)
class Detection:
    """Tip and target in one frame, and their distance [m] (Fig. 3), NaN where the tip is not seen.

    The target's last sure position stands for it while the tip or the arm covers it.
    """

    sequence: int
    t: float
    tip: Sighting
    target: Sighting
    distance: float


@dataclass(frozen=True, eq=False)
class Track:
    """One marker over T frames.

    Args:
        t: Start of each frame's exposure [s], (T,).
        t_points: Middle of the marker's own exposure [s], (T,).
        pixels: Mean positions over the exposures [pixels], (T, 2); NaN where unsure.
        points: The same on the strike plane [m], (T, 2).
        sigma: Standard errors of the points, per coordinate [m], (T,).
        confidence: Confidence in [0, 1], (T,).
    """

    t: np.ndarray
    t_points: np.ndarray
    pixels: np.ndarray
    points: np.ndarray
    sigma: np.ndarray
    confidence: np.ndarray

    @classmethod
    def of(cls, t: np.ndarray, sightings: list[Sighting]) -> Track:
        """From one sighting per frame."""
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
    """Tip, target and their distance [m] (Fig. 3), (T,), over T frames of one camera."""

    tip: Track
    target: Track
    distance: np.ndarray
    settings: CameraSettings

    @property
    def target_position(self) -> np.ndarray | None:
        """Median of the target's sure positions [m], (2,), or None if it was never seen."""
        seen = self.target.points[~np.isnan(self.target.points[:, 0])]
        return np.median(seen, axis=0) if len(seen) else None

    def to_recording(self, **known: Any) -> StrikeRecording:
        """As a recording for identification, of the marker `tip`.

        Args:
            known: Other fields of `StrikeRecording`, such as strike, controller, t_stay, source, sha256; a target given
                here goes before the one that was seen.

        Raises:
            InputError: The tip was never seen, or a field is out of range.
        """
        from whiptool.recording.strike_recording import StrikeRecording

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


class Tracker:
    """Follows tip and target, frame by frame, live or from a file.

    Args:
        settings: The camera.
        tip, target: Looks of the markers; default: those of the virtual camera, in its kind of light.
        calibration: Calibration of the strike plane; default: from the settings' pose.
        background: Image of the scene without tip, such as `median_image` makes; default: learned from the first frame.
        tip_start: Position of the tip in the first frame (2,) [pixels]; needed only where several things look like it.

    Raises:
        InputError: A marker has a hue in infrared, or none in color.
    """

    def __init__(
        self,
        settings: CameraSettings,
        *,
        tip: Marker | None = None,
        target: Marker | None = None,
        calibration: PlaneCalibration | None = None,
        background: np.ndarray | None = None,
        tip_start: np.ndarray | None = None,
    ) -> None:
        self.settings = settings
        tip, target = tip or TIP_MARKERS[settings.kind], target or TARGET_MARKERS[settings.kind]
        self._tip = MarkerTracker(tip, settings, calibration=calibration, background=background, start=tip_start)
        self._target = MarkerTracker(target, settings, calibration=calibration)
        self._target_point = np.full(2, np.nan)

    def update(self, frame: Frame) -> Detection:
        """Tip and target in the next frame."""
        tip, target = self._tip.update(frame), self._target.update(frame)
        if not np.isnan(target.sigma):
            self._target_point = target.point
        distance = float(np.hypot(*(tip.point - self._target_point)))
        return Detection(frame.sequence, frame.t, tip, target, distance)


def track(source: FrameSource | Iterable[Frame], **options: Any) -> StrikeTrack:
    """Follow tip and target through all frames of a source.

    Args:
        source: A source, which is opened and closed, or frames; all of one camera, in the order of time.
        options: Options of `Tracker`.

    Raises:
        InputError: There are no frames, or they are not in the order of time.
    """
    frames = frames_of(source) if isinstance(source, FrameSource) else source
    tracker, seen = None, []
    for frame in frames:
        if tracker is None:
            tracker = Tracker(frame.settings, **options)
        elif frame.t <= seen[-1].t:
            raise InputError("frames", frame.t, f"times after {seen[-1].t:g} s, that of the frame before")
        seen.append(tracker.update(frame))
    if tracker is None:
        raise InputError("frames", "none", "at least one frame")
    t = np.array([x.t for x in seen])
    return StrikeTrack(
        tip=Track.of(t, [x.tip for x in seen]),
        target=Track.of(t, [x.target for x in seen]),
        distance=np.array([x.distance for x in seen]),
        settings=tracker.settings,
    )


def median_image(frames: Iterable[Frame], *, most: int = 25) -> np.ndarray:
    """The scene without what moves, for `Tracker(background=...)`: the median over frames spread evenly in time."""
    images = [frame.image for frame in frames]
    chosen = np.unique(np.linspace(0, len(images) - 1, min(most, len(images))).astype(int))
    return np.median(np.stack([images[i] for i in chosen]), axis=0).astype(np.uint8)
