"""A new camera: anything that can open, read and close; here one that draws what it sees."""

import numpy as np

from whiptool.recording.camera import Camera, camera_preset
from whiptool.vision.source import Frame, FrameSource
from whiptool.vision.tracking import track


def where(t: float) -> np.ndarray:
    """The marker's place on the strike plane at time t [m], (2,)."""
    return np.array([0.6 * np.cos(4 * t), -0.2 + 0.5 * np.sin(4 * t)])


class DrawnCamera:
    """An infrared camera before a bright disc that goes round.

    Args:
        settings: Size, rate, intrinsics and pose; every frame carries them.
        frames: How many there are.
    """

    def __init__(self, settings: Camera, frames: int) -> None:
        self.settings, self.frames, self._next = settings, frames, 0

    def open(self) -> None:
        """A real camera starts its stream here."""

    def read(self, timeout: float = 1.0) -> Frame | None:
        """The next frame; None if none arrives within the timeout [s], or the film has ended."""
        if self._next == self.frames:
            return None
        s, number = self.settings, self._next
        self._next += 1
        t = number / s.fps
        u, v = s.project(where(t + s.exposure / 2))
        radius = 0.025 * s.scale(where(t))  # [pixels] of a marker of 25 mm
        rows, columns = np.mgrid[: s.height, : s.width]
        shown = np.clip(radius + 0.5 - np.hypot(columns - u, rows - v), 0, 1)  # a soft edge is sub-pixel
        image = (20 + 220 * shown).astype(np.uint8)
        return Frame(image=image, t=t, clock="strike", sequence=number, settings=s)

    def close(self) -> None:
        """A real camera lets go of its device here."""


if __name__ == "__main__":
    camera = DrawnCamera(camera_preset("d435-infrared"), frames=60)
    assert isinstance(camera, FrameSource)
    found = track(camera)
    truth = np.array([where(t) for t in found.tip.t_points])
    seen = np.isfinite(found.tip.points).all(axis=1)
    error = np.hypot(*(found.tip.points - truth)[seen].T)
    assert seen.mean() > 0.9
    assert error.max() < 0.005
    recording = found.to_recording(source="drawn")  # what whiptool.identify reads
    print(f"seen in {seen.sum()} of {len(seen)} frames, largest error {1e3 * error.max():.2f} mm, {recording.markers}")
