"""Frames as a lossless video file with a sidecar that says when and how they were taken."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from whiptool.errors import InputError
from whiptool.models.strike import Strike
from whiptool.recording.camera import Camera, write_cameras
from whiptool.recording.opencv import opencv
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
