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
from whiptool.recording.camera_files import write_cameras
from whiptool.recording.opencv import opencv
from whiptool.vision.camera_model import CameraSettings
from whiptool.vision.source import Frame
from whiptool.vision.space_view import SpaceView


def write_video(
    path: str | Path,
    frames: Iterable[Frame],
    *,
    synthetic: bool,
    homography: np.ndarray | None = None,
    strike: Strike | None = None,
    target: np.ndarray | None = None,
    t_stay: float | None = None,
) -> Path:
    """Write frames of one camera as FFV1, which loses nothing, and `NAME.toml` next to it.

    The sidecar holds `fps`, `timestamps` (start of the first row's exposure [s]; so `stamp = "start"`), `exposure`,
    `readout` (from the first row to the last [s]), `shutter`, `homography` (metres from pixels), `kind`, `camera`,
    `synthetic`, and what else is given. Of a camera in space, a `SpaceView`, it holds `cameras` instead of the
    homography: `NAME.cameras.toml`, the file of that camera.

    Args:
        path: An MKV or AVI file; missing folders are made.
        frames: At least one, in the order of time.
        synthetic: Whether no real camera took them.
        homography: Metres on the strike plane from pixels, (3, 3), of a calibration; default: from the pose.
        strike, target, t_stay: What was commanded, where the target is [m], (d,), how long the strike was watched [s].

    Returns:
        The sidecar's path.

    Raises:
        InputError: No frames, another suffix, or frames that are not in the order of time or of several cameras.
        OSError: The file cannot be written.
    """
    path = Path(path)
    if path.suffix.lower() not in (".mkv", ".avi"):
        raise InputError("path", str(path), "a file .mkv or .avi, which can hold lossless video")
    cv2, writer, stamps, settings = opencv(), None, [], None
    path.parent.mkdir(parents=True, exist_ok=True)
    try:
        for frame in frames:
            settings = settings or frame.settings
            if frame.settings != settings or (stamps and frame.t <= stamps[-1]):
                raise InputError(
                    "frames", f"{frame.settings.name} at {frame.t:g} s", "one camera, in the order of time"
                )
            if writer is None:
                size = settings.width, settings.height
                writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"FFV1"), settings.fps, size)
                if not writer.isOpened():
                    raise OSError(f"{path}: OpenCV cannot write FFV1 video there")
            code = cv2.COLOR_RGB2BGR if frame.image.ndim == 3 else cv2.COLOR_GRAY2BGR
            writer.write(cv2.cvtColor(frame.image, code))
            stamps.append(float(frame.t))
    finally:
        if writer is not None:
            writer.release()
    if settings is None:
        raise InputError("frames", "none", "at least one frame")
    table: dict[str, Any] = {
        "synthetic": synthetic,
        **_which_camera(settings, path, homography, synthetic=synthetic),
        "kind": settings.kind,
        "fps": float(settings.fps),
        "stamp": "start",
        "timestamps": stamps,
        "exposure": settings.exposure,
        "shutter": "rolling" if settings.readout else "global",
        "readout": float(settings.row_delay(settings.height - 1)),
    }
    if target is not None:
        table["target"] = np.asarray(target, float).tolist()
    if t_stay is not None:
        table["t_stay"] = float(t_stay)
    if strike is not None:
        table["strike"] = {key: list(x) if isinstance(x, tuple) else x for key, x in asdict(strike).items()}
    sidecar = path.with_suffix(".toml")
    sidecar.write_text(tomli_w.dumps(table), encoding="utf-8")
    return sidecar


def _which_camera(
    settings: CameraSettings, path: Path, homography: np.ndarray | None, *, synthetic: bool
) -> dict[str, Any]:
    """What a sidecar says of which camera it was, and of the way to metres."""
    if isinstance(settings, SpaceView):
        file = path.with_suffix(".cameras.toml")
        write_cameras(file, {settings.name: settings.seen_by})
        return {"camera": settings.name, "cameras": file.name}
    H = np.asarray(settings.homography if homography is None else homography, float)
    return {"camera": settings.name + (" (virtual)" if synthetic else ""), "homography": H.tolist()}
