"""A camera in space as the virtual camera and the tracker take it, and a marker's track in its images."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from whiptool.errors import InputError
from whiptool.recording.space_camera import SpaceCamera
from whiptool.recording.strike_recording import StrikeRecording
from whiptool.vision.camera_model import CameraSettings
from whiptool.vision.marker_tracker import Light, MarkerTracker
from whiptool.vision.markers import TIP_MARKERS, Marker
from whiptool.vision.source import Frame, FrameSource, frames_of

NEARING = Light(tolerance=0.35, usual=0.15, most_size_error=2.5, slow=np.inf, weight=0.5)


@dataclass(frozen=True)
class SpaceView(CameraSettings):
    """Settings of a camera in space: places are those of the world, and its plane faces the camera.

    What is tracked on that plane is as far off as the markers are nearer or farther than it, and as the lens distorts:
    only pixels are used.

    Args:
        camera: Camera in space.
    """

    camera: SpaceCamera | None = None

    @classmethod
    def of(cls, camera: SpaceCamera, *, distance: float = 3.0, kind: str = "color") -> SpaceView:
        """Return the settings of a camera whose markers are about so far away [m].

        Raises:
            InputError: The distance is not positive, or the exposure longer than the time between frames.
        """
        (fx, fy), (cx, cy) = camera.focal_lengths.tolist(), camera.principal_point.tolist()
        size = {"width": camera.width, "height": camera.height, "fps": camera.fps, "exposure": camera.exposure}
        lens = {"fx": fx, "fy": fy, "cx": cx, "cy": cy, "readout": camera.readout, "kind": kind}
        return cls(camera.name, **size, **lens, position=(0.0, 0.0, distance), rotation=(0.0, 0.0, 0.0), camera=camera)

    @property
    def seen_by(self) -> SpaceCamera:
        """The camera."""
        if self.camera is None:
            raise InputError("camera", None, "a camera in space: SpaceView.of(camera)")
        return self.camera

    def project(self, points: np.ndarray) -> np.ndarray:
        """Pixels (..., 2) of points of the world [m], (..., 3); NaN behind the camera."""
        return self.seen_by.project(points)

    def scale(self, point: np.ndarray) -> float:
        """Pixels per metre at a point (3,) [m] of the world, for what is small and faces the camera."""
        return float(np.sqrt(self.fx * self.fy) / self.seen_by.to_camera(point)[2])

    def slant(self, point: np.ndarray) -> float:
        """How much longer than wide a ball's image is, at a point (3,) [m] of the world."""
        ray = self.seen_by.to_camera(point)
        return float(np.linalg.norm(ray) / ray[2])

    def pose(self) -> tuple[np.ndarray, np.ndarray]:
        """Rotation from the world's axes to the camera's (right, down, forward), (3, 3), and its place [m], (3,)."""
        return self.seen_by.rotation, self.seen_by.position


def track_view(
    source: FrameSource | Iterable[Frame],
    /,
    *,
    tip: Marker | None = None,
    start: np.ndarray | None = None,
    **known: Any,
) -> StrikeRecording:
    """Follow the tip through the images of a camera in space, and return what it saw, in pixels.

    Args:
        source: A source, which is opened and closed, or frames; all of one `SpaceView`, in the order of time.
        tip: Looks of the tip's marker; default: those of the virtual camera, in its kind of light.
        start: Position of the tip in the first frame (2,) [pixels]; needed only where several things look like it.
        known: Other fields of the recording, such as strike, controller, t_stay, joints_t and joints_q.

    Raises:
        InputError: There are no frames, they are of no camera in space, or the tip was never seen.
    """
    frames = frames_of(source) if isinstance(source, FrameSource) else source
    tracker, seen, t, view = None, [], [], None
    for frame in frames:
        if tracker is None:
            view = frame.settings
            if not isinstance(view, SpaceView):
                raise InputError("frames", frame.settings.name, "images of a camera in space, a SpaceView")
            tracker = MarkerTracker(tip or TIP_MARKERS[view.kind], view, start=start, light=NEARING)
        seen.append(tracker.update(frame))
        t.append(frame.t)
    if not isinstance(view, SpaceView):
        raise InputError("frames", "none", "at least one frame")
    per_metre = np.sqrt(view.fx * view.fy) / view.position[2]  # of the plane that sightings lie in
    sigma = np.array([sighting.sigma for sighting in seen]) * per_metre
    return StrikeRecording(
        t=np.array(t) + view.exposure / 2,
        points=np.array([sighting.pixel for sighting in seen])[:, None],
        markers=("tip",),
        sigma=np.where(np.isfinite(sigma), sigma, 1.0)[:, None],
        view=view.seen_by,
        **known,
    )
