"""What a frame is, and where frames come from."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

from whiptool.errors import InputError
from whiptool.recording.camera import Camera


@dataclass(frozen=True, eq=False)
class Frame:
    """One image and its time.

    Args:
        image: Colour image (red, green, blue), (H, W, 3), or infrared image, (H, W), uint8.
        t: Start of the first row's exposure [s].
        clock: Clock of `t`: `strike` (0 is the command's start), `system`, `device`, ...
        sequence: Number of the frame; a gap means a lost frame.
        settings: Intrinsics, pose, exposure and readout of the camera.

    Raises:
        InputError: The image does not have the settings' size and kind, the exposure is longer than the time between
            frames, or the time is not finite.
    """

    image: np.ndarray
    t: float
    clock: str
    sequence: int
    settings: Camera

    def __post_init__(self) -> None:
        shape = (self.settings.height, self.settings.width, *((3,) if self.settings.kind == "color" else ()))
        if self.image.shape != shape or self.image.dtype != np.uint8:
            raise InputError(
                "image", f"{self.image.dtype} {self.image.shape}", f"uint8 {shape}, as {self.settings.name} has"
            )
        if self.settings.exposure > 1 / self.settings.fps:
            allowed = f"at most the time between frames, {1 / self.settings.fps:g} s"
            raise InputError("exposure", self.settings.exposure, allowed)
        if not np.isfinite(self.t):
            raise InputError("t", self.t, "a finite time")


@runtime_checkable
class FrameSource(Protocol):
    """A source of frames: a camera, a recording, or a simulation."""

    def open(self) -> None:
        """Prepare for reading; opening twice has no effect."""
        ...

    def read(self, timeout: float = 1.0) -> Frame | None:
        """Return the next frame, or None if none arrives within the timeout [s] or the source has ended."""
        ...

    def close(self) -> None:
        """Release the device or file; closing twice has no effect."""
        ...


def frames_of(source: FrameSource, *, timeout: float = 1.0) -> Iterator[Frame]:
    """Yield all frames of a source, which is opened and closed."""
    source.open()
    try:
        while (frame := source.read(timeout)) is not None:
            yield frame
    finally:
        source.close()
