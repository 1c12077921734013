"""What virtual cameras see of a strike: the tip's track, by images that are rendered and tracked, or by points."""

from __future__ import annotations

import dataclasses

import numpy as np

from whiptool.models.parameters import Model
from whiptool.models.strike import Strike
from whiptool.models.trajectory import Trajectory
from whiptool.recording.camera import Camera, camera_preset, looking_at
from whiptool.recording.strike_recording import StrikeRecording
from whiptool.vision.exposure import expose, measurement_sigma

POINTS, NOTHING = "points", "none"
# of the two cameras in space [m]: in front of the base on both sides; they look at a point above it
PLACES = {"left": (2.8, 2.8, 1.2), "right": (2.8, -2.8, 1.2)}
LOOKS_AT = (0.6, 0.0, 0.6)


@dataclasses.dataclass(eq=False)
class VirtualFilm:
    """Virtual cameras before an arm: one before the plane of a planar arm, two for an arm in space.

    Args:
        camera: `d435-color` or `d435-infrared`: images are rendered and tracked; `points`: the tip's position with
            errors like those of tracked images; `none`: no camera.
        model: True model of arm and whip.
        rng: Generator of the noise.
        target: Position of the target [m], which images show; None: no target.
        late: Offset of the cameras' clock [s].
    """

    camera: str
    model: Model
    rng: np.random.Generator
    target: tuple[float, ...] | None = None
    late: float = 0.0

    def __post_init__(self) -> None:
        preset = camera_preset("d435-infrared" if self.camera in (POINTS, NOTHING) else self.camera)
        self.cameras: tuple[Camera, ...] = (preset,)
        if self.model.dimension == 3:
            self.cameras = tuple(
                preset.replace(name=name, position=np.array(place), rotation=looking_at(place, LOOKS_AT))
                for name, place in PLACES.items()
            )

    def of(self, path: Trajectory, strike: Strike) -> StrikeRecording | None:
        """Return what the cameras see of the tip's path, with times of their clock; None without a camera.

        Args:
            path: True motion of arm and whip, with time 0 at the strike's start.
            strike: Command of the strike.
        """
        if self.camera == NOTHING:
            return None
        if self.camera == POINTS:
            return self._points(path)
        found = self._rendered(path, strike)
        return dataclasses.replace(found, t=found.t + self.late, t_points=found.t_points + self.late)

    def _points(self, path: Trajectory) -> StrikeRecording:
        """The tip as the first camera sees it."""
        camera = self.cameras[0]
        starts = np.arange(int(path.t[-1] * camera.fps) + 1) / camera.fps
        seen = expose(camera, path.t, path.tip, starts)
        sigma = measurement_sigma(camera, seen.speed, distance=camera_preset("d435-infrared").distance)
        points = seen.points + sigma[:, None] * self.rng.standard_normal(seen.points.shape)
        return StrikeRecording(
            t=starts + self.late,
            points=points[:, None],
            markers=("tip",),
            sigma=sigma[:, None],
            t_points=seen.t_points[:, None] + self.late,
            exposure=float(np.mean(seen.duration)),
            camera=POINTS,
        )

    def _rendered(self, path: Trajectory, strike: Strike) -> StrikeRecording:
        from whiptool.vision.multi_view import strike_in_space
        from whiptool.vision.render import VirtualCamera
        from whiptool.vision.tracking import track, track_view

        target = None if self.target is None else np.array(self.target)
        tracks = []
        for settings in self.cameras:
            camera = VirtualCamera(settings, self.model, path, self.rng, target)
            try:
                whole = len(self.cameras) == 1
                tracks.append(track(camera).to_recording() if whole else track_view(camera, strike=strike))
            finally:
                camera.close()
        return tracks[0] if len(tracks) == 1 else strike_in_space(tracks)
