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
from collections.abc import Callable, Mapping
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

OUTPUTS = (
    "ANGLES",
    "FORCES",
    "MOMENTS",
    "POWERS",
    "SCALARS",
    "REACTIONS",
)  # of POINT: lists of points that no marker is
MOST = 65535  # frames that a header can count
BLOCK = 512  # [bytes]


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
            notes=tuple(str(x) for x in data["notes"]),
        )
        return mocap.recorded(path, side, capture)


class Header(NamedTuple):
    """How the header of a C3D file says that its data are stored, and the file's size."""

    order: str  # of bytes: < or >; empty: a VAX's, whose numbers are laid out otherwise
    points: int  # in a frame
    analog: int  # numbers in a frame
    first: int  # frame, likewise
    last: int
    scale: float  # of whole numbers; negative: the numbers are floats
    start: int  # of the data [bytes]
    ratio: int  # of analog samples to frames
    size: int  # [bytes]

    @property
    def frames(self) -> int:
        """Number of frames, which may be more than a header can count."""
        return self.last - self.first + 1

    def width(self, analog: int) -> int:
        """Size of a frame with so many analog numbers [bytes]."""
        return (4 if self.scale < 0 else 2) * (4 * self.points + analog)

    def fits(self, analog: int) -> bool:
        """Whether frames with so many analog numbers fill the file but for its last block."""
        return 0 <= self.size - self.start - self.width(analog) * self.frames < BLOCK

    @property
    def long(self) -> bool:
        """Whether the file is so large that it holds more frames than a header can count."""
        most = max(MOST, self.frames) * self.width(self.analog)
        return self.size - self.start >= most + BLOCK


def header_of(path: Path) -> Header:
    """Return the header of a C3D file, of which the parameters follow."""
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
    points, analog, first, last, _, scale, block, ratio = struct.unpack(f"{order or '<'}5HfHH", header[2:20])
    return Header(order, points, analog, first, last, scale, BLOCK * (block - 1), ratio, size)


def _check_header(path: Path) -> None:
    """Refuse at once what is not a C3D file, or shorter than its header says: ezc3d would go on past the end."""
    head = header_of(path)
    if not head.order:
        return
    if head.points == 0 or head.frames < 1 or head.start < BLOCK:
        given = f"a C3D file with {head.points} markers over {head.frames} frames"
        raise InputError(str(path), given, "at least one point and frame")
    needed = head.start + head.width(head.analog) * head.frames
    if head.last < MOST and needed > head.size:
        rule = f"at least {needed}, as its header says"
        raise InputError(str(path), f"{head.size} bytes", rule, "was the file cut off?")


def parse(path: str) -> dict[str, np.ndarray]:
    """Return points (T, M, 3) in the file's units, NaN where missing, and their metadata, by name.

    It runs in a separate process, as ezc3d may crash on damaged files.

    Raises:
        InputError: There are no points, or header and parameters contradict each other.
    """
    import ezc3d

    file, head = ezc3d.c3d(path), header_of(Path(path))

    def values(group: str, name: str) -> Any:
        found = file["parameters"].get(group, {}).get(name)
        return [] if found is None else found["value"]

    def first(name: str, default: Any) -> Any:
        return next(iter(values("POINT", name)), default)

    points = np.moveaxis(file["data"]["points"][:3], 0, 2).swapaxes(0, 1)  # (3, M, T) -> (T, M, 3)
    residuals = file["data"]["meta_points"]["residuals"][0].T  # (T, M)
    told = (int(first("USED", 0)), int(next(iter(values("ANALOG", "USED")), 0)) * head.ratio)
    notes = []
    if head.order and (head.long or told != (head.points, head.analog)):
        points, residuals, notes = _as_stored(path, head, told)
    if points.size == 0:
        raise InputError("POINT:LABELS", 0, "at least one point")
    labels = _numbered_lists(values, file["parameters"]["POINT"], "LABELS")[: points.shape[1]]
    labels += [""] * (points.shape[1] - len(labels))
    outputs = {x for name in OUTPUTS for x in _numbered_lists(values, file["parameters"]["POINT"], name)}
    kept = [i for i, x in enumerate(labels) if not x or not {x, x.rpartition(":")[2]} & outputs]
    if left := [x for i, x in enumerate(labels) if i not in kept]:
        named = ", ".join(left[:6]) + ", ..." * (len(left) > 6)
        notes.append(f"left out {counted(len(left), 'modelled output')}, which no marker is: {named}")
    begun = [int(x) & MOST for x in values("TRIAL", "ACTUAL_START_FIELD")[:2]]
    later = 65536 * begun[1] if len(begun) == 2 else 0
    return {
        "points": np.where((residuals < 0)[..., None], np.nan, points)[:, kept],
        "labels": np.array([labels[i] for i in kept], dtype=str),
        "rate": np.array(float(first("RATE", 0.0))),
        "units": np.array(str(first("UNITS", ""))),
        "forward": np.array(str(first("X_SCREEN", ""))),
        "up": np.array(str(first("Y_SCREEN", ""))),
        "first_frame": np.array(begun[0] + later - 1 if later else int(file["header"]["points"]["first_frame"])),
        "notes": np.array(notes, dtype=str),
    }


def _numbered_lists(values: Callable[[str, str], Any], group: Mapping[str, Any], name: str) -> list[str]:
    """Texts of the parameters NAME, NAME2, NAME3, ... of POINT, which hold 255 each."""
    parts = [part for part in sorted(group, key=len) if re.fullmatch(rf"{name}\d*", part)]
    return [str(x).strip() for part in parts for x in values("POINT", part)]


def _as_stored(path: str, head: Header, told: tuple[int, int]) -> tuple[np.ndarray, np.ndarray, list[str]]:
    """Points (T, M, 3) and residuals (T, M) as the file's size says that they are stored, and sentences on it.

    ezc3d takes the size of a frame from the parameters, of which `told` are the points and analog numbers in a frame,
    and the number of frames from the header.
    """
    stored = (head.points, head.analog)
    fitting = [x for x in dict.fromkeys((stored, (head.points, told[1]))) if head.long or head.fits(x[1])]
    if not fitting:
        given = "{} points and {} analog numbers a frame, its parameters {} and {}".format(*stored, *told)
        raise InputError("header", given, "numbers that fit the file's size", "export it again with all parameters")
    width, kind = head.width(fitting[0][1]), f"{head.order}{'f4' if head.scale < 0 else 'i2'}"
    count = (head.size - head.start) // width if head.long else head.frames
    words = width // np.dtype(kind).itemsize
    raw = np.fromfile(path, kind, count * words, offset=head.start).reshape(count, words)[:, : 4 * head.points]
    notes = []
    if told != stored:
        notes.append("the header counts {} points and {} analog numbers a frame, ".format(*stored))
        notes[0] += "the parameters {} and {}: the former ".format(*told) if fitting[0] == stored else "the latter "
        notes[0] += "fit the file's size"
    if head.long:
        raw = raw[: np.flatnonzero(raw.any(axis=1))[-1] + 1]  # the last block is filled up with zeros
        notes.append(f"{len(raw)} frames by the file's size; a header counts at most {MOST}")
    raw = raw.reshape(len(raw), head.points, 4).astype(float)
    return raw[..., :3] * (1.0 if head.scale < 0 else head.scale), raw[..., 3], notes
