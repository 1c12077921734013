"""Exports of Qualisys Track Manager (QTM): motion data as TSV, and the labelled trajectories of a MAT file.

Lengths are in millimetres, which QTM does not write, times the column Time, else frame numbers over the frame rate.
Empty cells, zeros and NaN are missing points, as are, in MAT files, points that QTM did not measure but fill
(gap-filled and virtual); a TSV file only says which trajectories contain such points. QTM does not write its axes: z is
taken as up, as is its own convention, and x as forward.
"""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from whiptool.errors import InputError
from whiptool.given_files import number_in
from whiptool.recording.readers import mocap
from whiptool.recording.readers.mocap import Capture, numbers
from whiptool.recording.readers.programs import QUALISYS
from whiptool.recording.readers.sidecar import Sidecar
from whiptool.recording.strike_recording import StrikeRecording

USUAL: dict[str, Any] = {
    "units": "mm",
    "assumed": True,
    "forward": "x",
    "up": "z",
    "axes": "z is up, as is Qualisys' own convention, for the file does not say it, x taken as forward",
}
FILLED = (2, 3)  # types of points in MAT files: gap-filled, virtual


def _capture(rows: list[list[str]], side: Sidecar) -> Capture:
    """What the rows of a TSV export of QTM hold."""
    keys = {row[0]: row[1:] for row in rows[:40] if row and row[0].replace("_", "").isupper()}
    said = {key: values[0] for key, values in keys.items() if values}
    if said.get("DATA_INCLUDED", "3D") != "3D" or "MARKER_NAMES" not in keys:
        given = f"{QUALISYS.what} with {said.get('DATA_INCLUDED', 'no')} data, without 3D markers"
        raise InputError("contents", given, "3D data", "export 3D data there, with the TSV header")
    first = next((i for i, row in enumerate(rows) if row and _is_number(row[0] or "nan")), len(rows))
    timed = any(row[:2] == ["Frame", "Time"] for row in rows[:first])
    names = mocap.padded(keys["MARKER_NAMES"], said, "NO_OF_MARKERS", rows[first:], 2 * timed)
    width = 3 * len(names) + 2 * timed
    table = numbers(rows, first, range(width), width)
    t, clock = _times(table, timed, said)
    filled = [name for name, kind in zip(names, keys.get("TRAJECTORY_TYPES", ())) if kind != "Measured"]
    notes = mocap.announced(said, "NO_OF_FRAMES", len(table))
    notes += mocap.announced(said, "NO_OF_MARKERS", len(names), "markers")
    notes += (f"{', '.join(filled)}: not all points were measured (TRAJECTORY_TYPES)",) if filled else ()
    points = table[:, 2 * timed :].reshape(len(table), len(names), 3)
    return Capture(QUALISYS.what, t, clock, points, names, notes=notes, **USUAL)


read_qualisys = mocap.text_reader("Qualisys TSV", "\t", _capture)


def _is_number(cell: str) -> bool:
    try:
        number_in(cell)
    except ValueError:
        return False
    return True


def _times(table: np.ndarray, timed: bool, said: dict[str, str]) -> tuple[np.ndarray, str]:
    """Times [s] of the rows, and a sentence on their source."""
    if timed and said.get("FREQUENCY") == "EXT":
        return table[:, 1], "times [s] from the column Time"
    rate = mocap.rate_of(said.get("FREQUENCY"), "FREQUENCY")
    if timed:
        return mocap.even_times(table[:, 1], table[:, 0], rate, "the column Time")
    return np.arange(len(table)) / rate, f"times by row at {rate:g} a second, the first row at 0"


def labelled(found: Any) -> dict[str, np.ndarray] | None:
    """Return what a variable of a MAT file holds as QTM's struct: `points` (T, M, 3) [mm], `labels`, `rate`, `first`
    (frame number) and `filled`, how many points of each marker were filled; None: it is not such a struct."""
    if not isinstance(found, np.ndarray) or found.dtype.names is None or found.size != 1:
        return None
    if not {"FrameRate", "Frames", "File"} <= set(found.dtype.names):
        return None
    struct = found.item()
    read = dict(zip(found.dtype.names, struct))
    tracks: dict[str, Any] = {}
    data, labels = np.zeros((0, 4, 0)), []
    with suppress(KeyError, ValueError, AttributeError, TypeError):
        part = read["Trajectories"].item()[read["Trajectories"].dtype.names.index("Labeled")]
        tracks = dict(zip(part.dtype.names, part.item()))
        data, labels = np.asarray(tracks["Data"], float), [str(x.item()) for x in tracks["Labels"].ravel()]
    if not labels or data.ndim != 3 or len(data) != len(labels) or data.shape[1] < 3:
        given = "a MAT file of Qualisys Track Manager without labelled trajectories"
        raise InputError("Trajectories", given, "labelled trajectories", "label the markers there, and export 3D data")
    points = data[:, :3].transpose(2, 0, 1).copy()  # (M, 4, T) -> (T, M, 3)
    kind = np.asarray(tracks.get("Type", np.zeros((0, 0)))).T
    filled = np.isin(kind, FILLED) if kind.shape == points.shape[:2] else np.zeros(points.shape[:2], bool)
    points[filled] = np.nan
    return {
        "points": points,
        "labels": np.array(labels, dtype=str),
        "rate": np.array(float(read["FrameRate"].item())),
        "first": np.array(int(read["StartFrame"].item()) if "StartFrame" in read else 1),
        "filled": filled.sum(axis=0),
    }


def recording_of_mat(path: Path, options: dict[str, Any], read: dict[str, np.ndarray]) -> StrikeRecording:
    """Return the recording of what `labelled` found."""
    side = Sidecar.of(path, options, *mocap.KEYS)
    rate, labels = mocap.rate_of(read["rate"], "FrameRate"), [str(x) for x in read["labels"]]
    filled = [f"{name} {count}" for name, count in zip(labels, read["filled"]) if count]
    notes = (f"points that were filled, not measured, are taken as missing: {', '.join(filled)}",) if filled else ()
    first = int(read["first"])
    clock = f"times by frame number at {rate:g} a second (FrameRate), frame 1 at 0"
    t = (first - 1 + np.arange(len(read["points"]))) / rate
    what = "a MAT file of Qualisys Track Manager"
    return mocap.recorded(path, side, Capture(what, t, clock, read["points"], labels, notes=notes, **USUAL))
