"""Frames as a lossless video file with a sidecar that states their times and settings."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from whiptool.errors import InputError
from whiptool.models.strike import Strike
from whiptool.recording.camera import Camera, before_plane, opencv, pinhole, to_plane, write_cameras
from whiptool.recording.readers.footage import VideoSource
from whiptool.vision.calibration import PlaneCalibration
from whiptool.vision.source import Frame


def write_video(
    path: str | Path,
    frames: Iterable[Frame],
    *,
    synthetic: bool,
    in_space: bool = False,
    homography: np.ndarray | None = None,
    strike: Strike | None = None,
    target: np.ndarray | None = None,
    t_stay: float | None = None,
) -> Path:
    """Write frames of one camera as a lossless video (FFV1), and a sidecar `NAME.toml` next to it.

    The sidecar holds `fps`, `timestamps` (start of the first row's exposure [s]; so `stamp = "start"`), `exposure`,
    `readout` (from the first row to the last [s]), `shutter`, `homography` (metres from pixels), `kind`, `camera`,
    `synthetic`, and the other arguments.

    Args:
        path: MKV or AVI file; missing folders are created.
        frames: At least one frame, in temporal order.
        synthetic: Whether the frames were rendered.
        in_space: Whether they show a strike in space: the sidecar then names `NAME.cameras.toml`, the file of their
            camera, instead of the homography.
        homography: Homography from pixels to metres on the strike plane, (3, 3); default: from the camera's pose.
        strike, target, t_stay: Commanded strike, target position [m], (d,), and time after the movement [s].

    Returns:
        The sidecar's path.

    Raises:
        InputError: There are no frames, the suffix is another one, or the frames are not in temporal order or of
            several cameras.
        OSError: The file cannot be written.
    """
    path = Path(path)
    if path.suffix.lower() not in (".mkv", ".avi"):
        raise InputError("path", str(path), "a file .mkv or .avi, which can hold lossless video")
    path.parent.mkdir(parents=True, exist_ok=True)
    camera, stamps = _encoded(path, frames)
    table: dict[str, Any] = {"synthetic": synthetic, **_timing(camera, stamps)}
    if in_space:
        cameras = path.with_suffix(".cameras.toml")
        write_cameras(cameras, {camera.name: camera})
        table |= {"camera": camera.name, "cameras": cameras.name}
    else:
        H = np.asarray(camera.homography if homography is None else homography, float)
        table |= {"camera": camera.name + (" (virtual)" if synthetic else ""), "homography": H.tolist()}
    if target is not None:
        table["target"] = np.asarray(target, float).tolist()
    if t_stay is not None:
        table["t_stay"] = float(t_stay)
    if strike is not None:
        table["strike"] = {key: list(x) if isinstance(x, tuple) else x for key, x in asdict(strike).items()}
    sidecar = path.with_suffix(".toml")
    sidecar.write_text(tomli_w.dumps(table), encoding="utf-8")
    return sidecar


def _timing(camera: Camera, stamps: list[float]) -> dict[str, Any]:
    """What a sidecar says of a camera's light and clock."""
    return {
        "kind": camera.kind,
        "fps": float(camera.fps),
        "stamp": "start",
        "timestamps": stamps,
        "exposure": camera.exposure,
        "shutter": "rolling" if camera.readout else "global",
        "readout": float(camera.row_delay(camera.height - 1)),
    }


def _encoded(path: Path, frames: Iterable[Frame]) -> tuple[Camera, list[float]]:
    """Write the images of frames; their camera, and their times [s]."""
    cv2, writer, camera, stamps = opencv(), None, None, []
    try:
        for frame in frames:
            camera = camera or frame.settings
            if frame.settings != camera or (stamps and frame.t <= stamps[-1]):
                given = f"{frame.settings.name} at {frame.t:g} s"
                raise InputError("frames", given, "one camera, in the order of time")
            if writer is None:
                size = camera.width, camera.height
                writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"FFV1"), camera.fps, size)
                if not writer.isOpened():
                    raise OSError(f"{path}: OpenCV cannot write FFV1 video there")
            code = cv2.COLOR_RGB2BGR if frame.image.ndim == 3 else cv2.COLOR_GRAY2BGR
            writer.write(cv2.cvtColor(frame.image, code))
            stamps.append(float(frame.t))
    finally:
        if writer is not None:
            writer.release()
    if camera is None:
        raise InputError("frames", "none", "at least one frame")
    return camera, stamps


_DISTANCE = 3.5  # [m]; the images fix the ratio of focal length and distance only
_INSTANT = 1e-6  # [s], where the exposure is not known


def _before_its_plane(video: VideoSource) -> Camera:
    """A camera that looks straight at the strike plane and has the video's size, timing and scale.

    A homography does not say how far away the camera was, so the distance is made up: what is used of it is the number
    of pixels per metre, here that in the middle of the image. Positions come from the calibration.
    """
    if video.homography is None:
        raise InputError(
            str(video.about.get("source", "video")),
            "no calibration of the strike plane",
            "one of homography, known_points, or scale with origin",
            "write it into the sidecar .toml next to it",
        )
    height, width = video.shape
    u, v = (width - 1) / 2, (height - 1) / 2
    here, right, down = to_plane(video.homography, np.array([[u, v], [u + 1, v], [u, v + 1]]))
    area = abs((right - here)[0] * (down - here)[1] - (right - here)[1] * (down - here)[0])  # [m^2] of a pixel
    focal = _DISTANCE / float(np.sqrt(area))
    return Camera(
        name=str(video.about.get("camera") or "recorded"),
        width=width,
        height=height,
        camera_matrix=pinhole(focal, focal, u, v),
        **before_plane((*here.tolist(), _DISTANCE)),
        fps=video.fps,
        exposure=video.exposure or _INSTANT,
        readout=video.readout * height / max(height - 1, 1),  # to the row after the last
    )


class RecordedCamera:
    """A `FrameSource` of recorded images; times are relative to the command's start.

    Args:
        video: The images, with times, size and calibration.

    Attributes:
        settings: The `Camera` that took the images. If only the strike plane is calibrated, it is a camera
            perpendicular to the plane with the images' size, timing and scale.
        calibration: Calibration of the strike plane, for the tracker; None for a camera in space.

    Raises:
        InputError: Neither the camera nor the strike plane is calibrated, an image cannot be decoded, or its kind
            (color or infrared) is not the stated one.
    """

    def __init__(self, video: VideoSource) -> None:
        self.video = video
        self.settings = video.view or _before_its_plane(video)
        self.calibration = None if video.homography is None else PlaneCalibration(video.homography)
        kind = video.kind or ("infrared" if next(iter(video.frames())).ndim == 2 else "color")
        self.settings = self.settings.replace(kind=kind)
        self._images: Iterator[np.ndarray] | None = None
        self._next = 0

    def __len__(self) -> int:
        return len(self.video)

    def open(self) -> None:
        """Go to the first image; opening twice does no harm."""
        if self._images is None:
            self._images, self._next = iter(self.video.frames()), 0

    def read(self, timeout: float = 1.0) -> Frame | None:
        """Return the next frame, or None after the last; the timeout is not used."""
        if self._images is None:
            raise InputError("camera", "closed", "an open camera", "call open() first")
        image = next(self._images, None)
        if image is None or self._next >= len(self.video):
            return None
        number, self._next = self._next, self._next + 1
        return Frame(
            image=_as_stated(image, self.settings.kind),
            t=float(self.video.times[number]) - self.settings.exposure / 2,
            clock="strike",
            sequence=number,
            settings=self.settings,
        )

    def close(self) -> None:
        """Close the file; closing twice does no harm."""
        self._images = None


def _as_stated(image: np.ndarray, kind: str) -> np.ndarray:
    """A decoded image, BGR or grey, as a frame has it: RGB of uint8, or grey of uint8."""
    if image.dtype == np.uint16:
        image = (image >> 8).astype(np.uint8)
    if kind == "infrared":
        return np.ascontiguousarray(image[..., 0]) if image.ndim == 3 else image  # three times the same
    if image.ndim == 2:
        raise InputError("kind", kind, "infrared, where images are grey")
    return np.ascontiguousarray(image[..., ::-1])
