"""Motion capture as C3D, read with ezc3d.

Times come from the file's frame numbers and rate (the first frame of a cut recording is not at 0; subtract the
command's `start`), units from POINT:UNITS. POINT:X_SCREEN and Y_SCREEN say which axes point to the right and up on a
screen: the former is taken to point forward, and positions are rotated to the upward axis of the model
(`StrikeRecording.for_model`). A point with a negative residual, or at exactly (0, 0, 0), is missing.

The sidecar has the keys of `whiptool.recording.readers.mocap`.
"""

from __future__ import annotations

import re
import struct
from pathlib import Path
from typing import Any

import numpy as np

from whiptool.errors import InputError
from whiptool.extras import optional
from whiptool.given_files import parsed_apart, parsing, whole_file
from whiptool.recording.readers import mocap
from whiptool.recording.readers.mocap import Capture
from whiptool.recording.readers.sidecar import Sidecar
from whiptool.recording.strike_recording import StrikeRecording


def read_c3d(path: Path | str, **options: Any) -> StrikeRecording:
    """Read a C3D file.

    Args:
        path: The file.
        options: Keys of the sidecar file, whose values they override.

    Raises:
        InputError: The file is damaged, has no points or no rate, does not state its units or axes, lacks a label, or a
            value is not allowed; or ezc3d is not installed.
    """
    path = whole_file(path)
    side = Sidecar.of(path, options, *mocap.KEYS)
    optional("ezc3d", "C3D files")
    _check_header(path)
    data = parsed_apart(path, "c3d", parse)
    with parsing(path, "C3D"):
        rate = mocap.rate_of(data["rate"], "POINT:RATE")
        forward, up = (str(data[key]).strip() for key in ("forward", "up"))
        capture = Capture(
            what="a C3D file",
            t=(int(data["first_frame"]) + np.arange(len(data["points"]))) / rate,
            clock=f"times by frame number at POINT:RATE, {rate:g} a second",
            points=data["points"],
            labels=[str(x).strip() for x in data["labels"]],
            units=mocap.unit_of(str(data["units"]), "POINT:UNITS", side),
            forward=forward,
            up=up,
            axes=f"{up} is up, as POINT:Y_SCREEN says, {forward} (X_SCREEN) taken as forward"
            if up
            else "no POINT:Y_SCREEN",
        )
        return mocap.recorded(path, side, capture)


def _check_header(path: Path) -> None:
    """Refuse at once what is not a C3D file, or shorter than its header says: ezc3d would go on past the end."""
    size = path.stat().st_size
    with path.open("rb") as file:
        header = file.read(512)
        if len(header) < 512 or header[1] != 0x50 or not 512 * header[0] <= size:
            raise InputError(str(path), "no header of C3D", "a whole C3D file")
        file.seek(512 * (header[0] - 1) if header[0] else 0)
        parameters = file.read(4)
    order = {0x54: "<", 0x55: None, 0x56: ">"}.get(parameters[3], "")
    if order == "":
        raise InputError(str(path), f"processor type {parameters[3]}", "a whole C3D file")
    if order is None:
        return  # a VAX; its numbers are laid out otherwise
    points, analog, first, last, _ = struct.unpack(f"{order}5H", header[2:12])
    (scale,) = struct.unpack(f"{order}f", header[12:16])
    (start,) = struct.unpack(f"{order}H", header[16:18])
    width = 4 if scale < 0 else 2  # [bytes]: floats have a negative scale
    frames = last - first + 1
    needed = 512 * (start - 1) + width * (4 * points + analog) * min(max(frames, 0), 65535)
    if points == 0 or frames < 1 or start < 2:
        raise InputError(
            str(path), f"a C3D file with {points} markers over {frames} frames", "at least one point and frame"
        )
    if last < 65535 and needed > size:
        raise InputError(str(path), f"{size} bytes", f"at least {needed}, as its header says", "was the file cut off?")


def parse(path: str) -> dict[str, np.ndarray]:
    """Return points (T, M, 3) in the file's units, NaN where missing, and their metadata, by name.

    It runs in a separate process, as ezc3d may crash on damaged files.

    Raises:
        InputError: There are no points.
    """
    import ezc3d

    file = ezc3d.c3d(path)
    group = file["parameters"]["POINT"]

    def first(name: str, default: Any) -> Any:
        values = group[name]["value"] if name in group else []
        return values[0] if len(values) else default

    points = np.moveaxis(file["data"]["points"][:3], 0, 2).swapaxes(0, 1)  # (3, M, T) -> (T, M, 3)
    residuals = file["data"]["meta_points"]["residuals"][0].T  # (T, M)
    names: list[str] = sorted(group, key=len)
    parts = [name for name in names if re.fullmatch(r"LABELS\d*", name)]  # 255 labels in each
    labels = [str(x) for name in parts for x in group[name]["value"]]
    if points.size == 0 or len(labels) < points.shape[1]:
        raise InputError(
            "POINT:LABELS", len(labels), f"one per point, at least one; there are {points.shape[1]} points"
        )
    return {
        "points": np.where((residuals < 0)[..., None], np.nan, points),
        "labels": np.array(labels[: points.shape[1]], dtype=str),
        "rate": np.array(float(first("RATE", 0.0))),
        "units": np.array(str(first("UNITS", ""))),
        "forward": np.array(str(first("X_SCREEN", ""))),
        "up": np.array(str(first("Y_SCREEN", ""))),
        "first_frame": np.array(int(file["header"]["points"]["first_frame"])),
    }
