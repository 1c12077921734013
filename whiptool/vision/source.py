"""Frames and their sources."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import numpy as np

from whiptool.errors import InputError, WhiptoolError
from whiptool.extras import MissingPackage, optional
from whiptool.recording.camera import Camera, pinhole


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


def realsense() -> Any:
    """Return the module pyrealsense2; MissingPackage says so if it or its USB library is not installed."""
    try:
        return optional("pyrealsense2", "a RealSense camera")
    except MissingPackage as error:
        if "libusb" not in str(error):
            raise
        raise MissingPackage(error.name, str(error.given), "apt-get install libusb-1.0-0") from None


class RealSenseCamera:
    """A `FrameSource` of one stream of a RealSense camera, by its serial number (empty: the only camera), or of a
    recording of the SDK, whose `file` is played without dropping frames.

    Size, rate, exposure and kind (`color` or `infrared`) of `settings` are requested, its pose and readout added to
    frames; focal lengths and principal point are those of the device. The exposure is fixed, because the measurement
    model uses it; the infrared emitter is off, because its dots would be taken for markers. Frame times are the
    device's (middle of the exposure) minus half the exposure.
    """

    def __init__(self, settings: Camera, *, serial: str = "", file: Path | str | None = None) -> None:
        self.settings, self.serial = settings, serial
        self.file = None if file is None else Path(file)
        if self.file is not None and not self.file.is_file():
            raise InputError("recording", str(file), "a file that exists")
        self._rs: Any = None
        self._pipeline: Any = None

    def check_present(self) -> None:
        """Refuse a camera that is not connected, without starting it."""
        if self.file is not None:
            return
        rs = realsense()
        there = [device.get_info(rs.camera_info.serial_number) for device in rs.context().query_devices()]
        if not there or (self.serial and self.serial not in there):
            fix = f"there are {', '.join(there)}" if there else "none is seen: plug it into USB 3"
            raise InputError("camera", self.serial or "realsense", "a RealSense camera that is plugged in", fix)

    def open(self) -> None:
        """Start the stream; opening twice does no harm."""
        if self._pipeline is not None:
            return
        rs, s = realsense(), self.settings
        config, pipeline = rs.config(), rs.pipeline()
        color = s.kind == "color"
        stream, form = (rs.stream.color, rs.format.rgb8) if color else (rs.stream.infrared, rs.format.y8)
        if self.file is not None:
            config.enable_device_from_file(str(self.file), repeat_playback=False)
            config.enable_stream(stream)
        else:
            if self.serial:
                config.enable_device(self.serial)
            config.enable_stream(stream, 0 if color else 1, s.width, s.height, form, round(s.fps))
        try:
            if self.file is not None:  # frames that come before would be dropped where the reader is slower
                played = config.resolve(rs.pipeline_wrapper(pipeline)).get_device().as_playback()
                played.set_real_time(False)
            profile = pipeline.start(config)
        except RuntimeError as error:
            what = str(self.file or self.serial or "the only camera")
            raise WhiptoolError(f"RealSense {what}: {error}; is it plugged into USB 3?") from error
        self._rs, self._pipeline = rs, pipeline
        try:
            if self.file is None:
                self._fix_exposure(profile.get_device(), color=color)
            lens = profile.get_stream(stream).as_video_stream_profile().get_intrinsics()
            K = pinhole(lens.fx, lens.fy, lens.ppx, lens.ppy)
            self.settings = s.replace(width=lens.width, height=lens.height, camera_matrix=K)
        except RuntimeError as error:
            self.close()
            raise WhiptoolError(f"RealSense: {error}") from error

    def _fix_exposure(self, device: Any, *, color: bool) -> None:
        """Exposure by hand, emitter off."""
        option = self._rs.option
        sensor = device.first_color_sensor() if color else device.first_depth_sensor()
        sensor.set_option(option.enable_auto_exposure, 0)
        unit = 1e-4 if color else 1e-6  # [s] of the option, which the two sensors count differently
        sensor.set_option(option.exposure, round(self.settings.exposure / unit))
        if not color and sensor.supports(option.emitter_enabled):
            sensor.set_option(option.emitter_enabled, 0)

    def read(self, timeout: float = 1.0) -> Frame | None:
        """Return the next frame, or None if none arrives within the timeout [s] or the recording has ended."""
        if self._pipeline is None:
            raise InputError("camera", "closed", "an open camera", "call open() first")
        there, frames = self._pipeline.try_wait_for_frames(max(1, round(1e3 * timeout)))
        if not there:
            return None
        color = self.settings.kind == "color"
        frame = frames.get_color_frame() if color else frames.get_infrared_frame()
        if not frame:
            return None
        return Frame(
            image=np.array(frame.get_data(), np.uint8),  # a copy: the SDK uses its buffer again
            t=1e-3 * frame.get_timestamp() - self.settings.exposure / 2,
            clock="device",
            sequence=int(frame.get_frame_number()),
            settings=self.settings,
        )

    def close(self) -> None:
        """Stop the stream; closing twice does no harm."""
        if self._pipeline is not None:
            pipeline, self._pipeline = self._pipeline, None
            pipeline.stop()
