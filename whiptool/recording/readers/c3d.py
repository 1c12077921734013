"""Motion capture as C3D, read with ezc3d.

Times come from the file's frame numbers and rate (the first frame of a cut recording is not at 0; subtract the
command's `start`), units from POINT:UNITS. POINT:X_SCREEN and Y_SCREEN say which axes point to the right and up on a
screen: the former is taken to point forward, and positions are rotated to the upward axis of the model
(`StrikeRecording.for_model`). A point with a negative residual, or at exactly (0, 0, 0), is missing. Where the header
contradicts the parameters, or cannot count the frames, the file's size decides; modelled outputs are left out.

The sidecar has the keys of `whiptool.recording.readers.mocap`.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from whiptool.errors import InputError
from whiptool.extras import optional
from whiptool.given_files import parsed_apart, parsing, whole_file
from whiptool.recording.readers import mocap
from whiptool.recording.readers.mocap import Capture
from whiptool.recording.readers.sidecar import Sidecar
from whiptool.recording.strike_recording import StrikeRecording
from whiptool.words import counted

OUTPUTS = "ANGLES|FORCES|MOMENTS|POWERS|SCALARS|REACTIONS"  # of POINT: lists of points that are no markers
MOST, BLOCK = 65535, 512  # frames that a header can count; [bytes] of which a file has a whole number


def read_c3d(path: Path | str, **options: Any) -> StrikeRecording:
    """Read a C3D file; `options` are keys of its sidecar, whose values they override."""
    path = whole_file(path)
    side = Sidecar.of(path, options, *mocap.KEYS)
    optional("ezc3d", "C3D files")
    _checked_header(path)
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
            notes=tuple(str(x) for x in data["notes"]),
        )
        return mocap.recorded(path, side, capture)


class Header(NamedTuple):
    """How a C3D file says that its data are stored; `order` of bytes is empty for a VAX's numbers."""

    order: str
    points: int
    analog: int
    first: int
    last: int
    scale: float
    start: int
    ratio: int


def _checked_header(path: Path) -> Header:
    """Refuse at once what is not a C3D file, or shorter than its header says: ezc3d would go on past the end."""
    size = path.stat().st_size
    with path.open("rb") as file:
        header = file.read(BLOCK)
        if len(header) < BLOCK or header[1] != 0x50 or not BLOCK * header[0] <= size:
            raise InputError(str(path), "no header of C3D", "a whole C3D file")
        file.seek(BLOCK * (header[0] - 1) if header[0] else 0)
        parameters = file.read(4)
    order = {0x54: "<", 0x55: "", 0x56: ">"}.get(parameters[3])
    if order is None:
        raise InputError(str(path), f"processor type {parameters[3]}", "a whole C3D file")
    points, analog, first, last, _, scale, start, ratio = struct.unpack(f"{order or '<'}5HfHH", header[2:20])
    head = Header(order, points, analog, first, last, scale, BLOCK * (start - 1), ratio)
    needed = head.start + (4 if scale < 0 else 2) * (4 * points + analog) * (last - first + 1)
    if order and (points == 0 or last < first or start < 2):
        given = f"a C3D file with {points} markers over {last - first + 1} frames"
        raise InputError(str(path), given, "at least one point and frame")
    if order and last < MOST and needed > size:
        raise InputError(str(path), f"{size} bytes", f"at least {needed}, as its header says", "was the file cut off?")
    return head


def parse(path: str) -> dict[str, np.ndarray]:
    """Return points (T, M, 3) in the file's units, NaN where missing, and their metadata, by name.

    It runs in a separate process, as ezc3d may crash on damaged files.
    """
    import ezc3d

    file = ezc3d.c3d(path)
    group = file["parameters"]["POINT"]

    def first(name: str, default: Any, group: Mapping[str, Any] = group) -> Any:
        return next(iter(group[name]["value"] if name in group else []), default)

    def texts(names: str) -> list[str]:  # in parts of 255, as in LABELS, LABELS2, ...
        parts = [name for name in sorted(map(str, group), key=len) if re.fullmatch(rf"({names})\d*", name)]
        return [str(x).strip() for name in parts for x in group[name]["value"]]

    points = np.moveaxis(file["data"]["points"][:3], 0, 2).swapaxes(0, 1)  # (3, M, T) -> (T, M, 3)
    residuals = file["data"]["meta_points"]["residuals"][0].T  # (T, M)
    notes, begun = [], int(file["header"]["points"]["first_frame"])
    words = np.array(file["parameters"].get("TRIAL", {}).get("ACTUAL_START_FIELD", {}).get("value", []))
    if words.dtype.kind in "if" and 0 < len(words) <= 2:  # the lower word first, perhaps signed; or one number
        actual = int(words[0]) if len(words) == 1 else (int(words[0]) & MOST) + ((int(words[1]) & MOST) << 16)
        if MOST < actual < 1 << 31:
            begun = actual - 1
            notes.append(f"the first frame is number {actual}, by TRIAL:ACTUAL_START_FIELD; a header counts to {MOST}")
    if stored := _as_stored(Path(path), first("USED", 0), first("USED", 0, file["parameters"].get("ANALOG", {}))):
        points, residuals, said = stored
        notes.append(said)
    if points.size == 0:
        raise InputError("POINT:LABELS", 0, "at least one point")
    labels, outputs = [*texts("LABELS"), *[""] * points.shape[1]][: points.shape[1]], set(texts(OUTPUTS)) - {""}
    kept = [i for i, label in enumerate(labels) if not {label, label.rpartition(":")[2]} & outputs]
    if left := sorted(set(labels) - {labels[i] for i in kept}):
        notes.append(f"left out {counted(len(left), 'modelled output')}, which are no markers: {', '.join(left)[:200]}")
    return {
        "points": np.where((residuals < 0)[..., None], np.nan, points)[:, kept],
        "labels": np.array([labels[i] for i in kept], dtype=str),
        "rate": np.array(float(first("RATE", 0.0))),
        "units": np.array(str(first("UNITS", ""))),
        "forward": np.array(str(first("X_SCREEN", ""))),
        "up": np.array(str(first("Y_SCREEN", ""))),
        "first_frame": np.array(begun),
        "notes": np.array(notes, dtype=str),
    }


def _as_stored(path: Path, points: int, channels: int) -> tuple[np.ndarray, np.ndarray, str] | None:
    """Points (T, M, 3), residuals (T, M) and a sentence on them if the file's size says that ezc3d misreads them, which
    steps by the points and channels of the parameters, and counts frames as the header does; else None.
    """
    head, size = _checked_header(path), path.stat().st_size
    kind = np.dtype(f"{head.order}{'f4' if head.scale < 0 else 'i2'}")
    width, told, frames = 4 * head.points + head.analog, 4 * points + channels * head.ratio, head.last - head.first + 1
    fits = [0 <= size - head.start - x * kind.itemsize * frames < BLOCK for x in (width, told)]
    long = not fits[1] and size - head.start >= max(MOST, frames) * width * kind.itemsize + BLOCK
    if not head.order or (not long and (told == width or fits == [False, True])):
        return None
    said = f"the header counts {head.points} points and {head.analog} analog numbers a frame, "
    said += f"and the parameters {points} and {channels * head.ratio}"
    if not long and not any(fits):
        raise InputError("header", said, "numbers that fit the file's size", "export it again with its parameters")
    count = (size - head.start) // (width * kind.itemsize) if long else frames
    raw = np.fromfile(path, kind, count * width, offset=head.start).reshape(count, width)[:, : 4 * head.points]
    if long:  # the last block is filled up with zeros
        raw = raw[: np.flatnonzero(raw.any(axis=1))[-1] + 1]
        said = f"{len(raw)} frames by the file's size; a header counts at most {MOST}"
    stored = raw.reshape(len(raw), head.points, 4).astype(float)
    return stored[..., :3] * (1.0 if head.scale < 0 else head.scale), stored[..., 3], said
