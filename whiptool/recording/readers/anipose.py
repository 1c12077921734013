"""Positions in space that Anipose triangulated, as CSV.

The file has neither times nor units nor axes: frames need `fps` or `timestamps`, lengths are taken in millimetres, as
calibration boards are usually given, and `axes` have to be stated (of a calibration without a reference they are those
of the first camera: x to the right, y down, z forward). Points that were not triangulated are missing. The sidecar has
the keys of `whiptool.recording.readers.mocap`, and the clock's.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from whiptool.given_files import parsing, whole_file
from whiptool.recording.readers import mocap
from whiptool.recording.readers.footage import frame_clock
from whiptool.recording.readers.mocap import Capture, numbers, text_rows
from whiptool.recording.readers.programs import ANIPOSE
from whiptool.recording.readers.sidecar import CLOCK, Sidecar
from whiptool.recording.readers.table import AXES, LARGEST_TABLE
from whiptool.recording.strike_recording import StrikeRecording


def read_anipose(path: Path | str, **options: Any) -> StrikeRecording:
    """Read a CSV file of Anipose; `options` are keys of its sidecar, whose values they override."""
    path = whole_file(path, largest=LARGEST_TABLE)
    side = Sidecar.of(path, options, *mocap.KEYS, *CLOCK)
    with parsing(path, "Anipose CSV"):
        rows = text_rows(path, ",")
        head = rows[0]
        parts = [name.removesuffix("_ncams") for name in head if name.endswith("_ncams")]
        columns = [head.index(f"{part}_{axis}") for part in parts for axis in AXES]
        frame = [head.index("fnum")] if "fnum" in head else []
        table = numbers(rows, 1, [*columns, *frame], len(head))
        points = table[:, : len(columns)].reshape(len(table), len(parts), 3)
        frames = table[:, -1] if frame and "timestamps" not in side.table else None
        return placed_frames(path, side, ANIPOSE.what, points, parts, frames)


def placed_frames(
    path: Path, side: Sidecar, what: str, points: np.ndarray, parts: list[str], frames: np.ndarray | None
) -> StrikeRecording:
    """Return the recording of positions in space (T, M, 3) that cameras without a common clock in the file saw."""
    clock = frame_clock(side, len(points), numbers=frames)
    capture = Capture(
        what=what,
        t=clock.times + side.start,
        clock=clock.notes[0],
        points=points[clock.keep],
        labels=parts,
        units="mm",
        assumed=True,
        axes="the file does not state them",
        notes=clock.notes[1:],
    )
    return mocap.recorded(path, side, capture)
