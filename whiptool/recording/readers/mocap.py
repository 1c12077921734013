"""Recordings of motion capture: named markers at an even rate, in the units and axes of the laboratory.

Each format's reader makes a `Capture` of what its file holds, and `recorded` makes the recording of it. What the file
does not state is assumed, and said in the recording's notes. Keys of the sidecar of all these formats, in addition to
the common ones: `markers` (names in the file, such as `{tip = "Whip:5"}`; default: all, under their names, and those
that name a part of arm or whip in lower case and without the name of the subject before the colon), `units`, `axes` and
`origin` (the shoulder in the file's axes and units), and `sigma` (standard error per coordinate [m]; default 1 mm).
Where the file has rotations of rigid bodies, `hand` may name one, see `whiptool.recording.readers.hand_bodies`.
"""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from whiptool.errors import InputError
from whiptool.given_files import number_in, parsing, whole_file
from whiptool.recording.readers.footage import clock_of_rows
from whiptool.recording.readers.hand_bodies import body_named, with_poses
from whiptool.recording.readers.sidecar import SPACE, UNITS, UNSTATED, Sidecar
from whiptool.recording.readers.table import AXES, LARGEST_TABLE, number_of, text_of, with_points
from whiptool.recording.strike_recording import PARTS, StrikeRecording
from whiptool.words import counted

KEYS = (*SPACE, "markers", "sigma")  # of the sidecar
UNLABELED = re.compile(r"unlabell?ed.*|\*\d+|new \d+|u_\d+", re.IGNORECASE)  # of Motive, Nexus, Qualisys, Cortex
SPELLED = {"meter": "m", "metre": "m", "centimeter": "cm", "centimetre": "cm", "millimeter": "mm", "millimetre": "mm"}
FORWARD = {"x": "y", "y": "x", "z": "x"}  # which axis is taken to point forward, by the one that points up
LARGEST_RATE = 1e5  # [1/s]


@dataclass(frozen=True, eq=False)
class Capture:
    """What a motion capture file holds."""

    what: str  # description of the format, for messages
    t: np.ndarray  # times by the file's own clock [s], (T,)
    clock: str  # a sentence on the source of the times
    points: np.ndarray  # in the file's units and axes, NaN where missing, (T, M, 2 or 3)
    labels: Sequence[str]  # names of the markers in the file, (M,); empty: it has none
    units: str  # m, cm, mm or in
    assumed: bool = False  # whether the file does not state its units
    forward: str = ""  # axis that points forward, such as `-y`; empty: unknown
    up: str = ""  # axis that points up, likewise
    axes: str = ""  # a sentence on the source of these axes
    notes: tuple[str, ...] = ()  # further assumptions, and data that were left out
    turns: Mapping[str, np.ndarray] = field(default_factory=dict)  # quaternions (x, y, z, w) of bodies, (T, 4 or 0)


def recorded(path: Path, side: Sidecar, capture: Capture) -> StrikeRecording:
    """Return the recording of a motion capture file."""
    if not len(capture.labels):
        raise InputError(str(path), f"{capture.what} without markers", "at least one marker", "export the markers, too")
    capture = _labeled(side, capture)
    names = _named(side, capture)
    points = capture.points[:, [list(capture.labels).index(label) for label in names.values()]]
    nowhere = (points == 0).all(axis=2)
    points = np.where(nowhere[..., None], np.nan, points)
    if not np.isfinite(points).all(axis=2).any():
        raise InputError(str(path), f"{capture.what} in which no marker was seen", "at least one position")
    clock = clock_of_rows(side, capture.t, capture.clock, "times")
    flat = points.shape[2] == 2
    side, capture = (side, capture) if flat else _with_up(side, capture)
    axes = None if flat else axes_of(capture.forward, capture.up)
    notes = [*clock.notes]
    if axes is None and not flat and "axes" not in side.table:
        raise side.refuse(
            "axes",
            f"which of its axes point forward, up and out ({capture.axes}), for a model in space forward, left and up",
            UNSTATED["axes"],
        )
    if "axes" not in side.table and capture.axes:
        notes.append(f"axes: {capture.axes}; else say axes")
    if "units" not in side.table:
        stated = "for the file does not state them; else say units" if capture.assumed else "as the file states"
        notes.append(f"units: taken as {capture.units}, {stated}")
    elif not capture.assumed and side.table["units"] != capture.units:
        notes.append(f"units: taken as {side.table['units']}, as the sidecar says, but the file states {capture.units}")
    notes += [f"{counted(int(nowhere.sum()), 'point')} at (0, 0, 0) taken as missing"] if nowhere.any() else []
    read: dict[str, Any] = {
        "t": clock.times,
        "points": side.metres(points[clock.keep], capture.units, axes),
        "markers": tuple(names),
        "sigma": side.sigma(),
        "up": "" if flat or "axes" in side.table else "y",
    }
    others = len(capture.turns)
    if (label := body_named(side, capture.turns)) is not None:
        body = capture.points[:, list(capture.labels).index(label)], capture.turns[label]
        kept = body[0][clock.keep], body[1][clock.keep]
        side, read, said = with_poses(side, read, kept, capture.units, axes)
        notes, others = [*notes, *said], others - 1
    if others:
        fix = "" if label else '; if one holds the whip, name it in hand, as hand = "NAME"'
        notes.append(f"left out the rotations of {counted(others, 'rigid body', 'rigid bodies')}{fix}")
    return side.recording(path, notes=[*notes, *capture.notes], **read)


def text_reader(
    kind: str, mark: str | Callable[[Path], str], capture: Callable[[list[list[str]], Sidecar], Capture]
) -> Callable[..., StrikeRecording]:
    """Return the reader of a text table of another program, whose cells `mark` separates, and of whose rows `capture`
    makes what they hold."""

    def read(path: Path | str, **options: Any) -> StrikeRecording:
        """Read a file; `options` are keys of its sidecar, whose values they override."""
        path = whole_file(path, largest=LARGEST_TABLE)
        side = Sidecar.of(path, options, *KEYS)
        with parsing(path, kind):
            rows = text_rows(path, mark if isinstance(mark, str) else mark(path))
            return recorded(path, side, capture(rows, side))

    return read


def _with_up(side: Sidecar, capture: Capture) -> tuple[Sidecar, Capture]:
    """The sidecar without the key `up`, and the capture with the file's axis that it names as the upward one."""
    if "up" not in side.table or "axes" in side.table:  # with axes, up is that of the axes that they name
        return side, capture
    up = side.word("up", ("y", "z"), "y")
    said = f"{up} is up, as the sidecar says, {FORWARD[up]} taken as forward"
    return side.changed(up=None), replace(capture, forward=FORWARD[up], up=up, axes=said)


def _labeled(side: Sidecar, capture: Capture) -> Capture:
    """The capture without markers that a program numbered for want of a label, where others have labels; without a
    label, or with that of another marker, they are numbered here."""
    given = list(capture.labels)
    own = [x if x and x not in given[:i] else f"marker{i + 1}" for i, x in enumerate(given)]
    if new := [x for x, was in zip(own, given, strict=True) if x != was]:
        said = f"markers without a separate name are numbered in the file's order: {', '.join(new)[:200]}"
        capture = replace(capture, labels=own, notes=(*capture.notes, said))
    kept = [i for i, label in enumerate(capture.labels) if not UNLABELED.fullmatch(label.rpartition(":")[2])]
    left = len(capture.labels) - len(kept)
    if "markers" in side.table or not left or not kept:
        return capture
    said = f"left out {counted(left, 'unlabeled marker')}; name them in markers"
    labels, points = [capture.labels[i] for i in kept], capture.points[:, kept]
    return replace(capture, labels=labels, points=points, notes=(*capture.notes, said))


def _named(side: Sidecar, capture: Capture) -> dict[str, str]:
    """Labels in the file by the names of the markers."""
    labels = list(capture.labels)
    if (asked := side.names("markers")) is not None:
        short = {label: label.rpartition(":")[2] for label in labels}
        found = {}
        for name, label in asked.items():
            same = [x for x in labels if x == label] or [x for x in labels if short[x] == label]
            if len(same) != 1:
                raise InputError("markers", label, "one of the labels " + ", ".join(labels)[:300])
            found[name] = same[0]
        return found
    parts = [label.rpartition(":")[2].lower() for label in labels]
    clear = {part for part in parts if PARTS.fullmatch(part) and parts.count(part) == 1}
    return {part if part in clear else label: label for part, label in zip(parts, labels, strict=True)}


def axes_of(forward: str, up: str) -> tuple[str, str, str] | None:
    """Return the file's axes that are the model's x, y and z, right-handed, from those that point forward and up; None
    if these do not say it.
    """
    unit = {sign + name: (1.0 if sign != "-" else -1.0) * np.eye(3)[i] for i, name in enumerate("xyz") for sign in "+-"}
    forward, up = (axis.strip().lower() for axis in (forward, up))
    x, y = (unit.get(axis if axis[:1] in ("+", "-") else "+" + axis) for axis in (forward, up))
    if x is None or y is None or abs(x @ y) > 0:
        return None
    out = np.cross(x, y)
    return forward, up, next(name for name, vector in unit.items() if (vector == out).all())


def unit_of(name: str, what: str, side: Sidecar) -> str:
    """Return the unit of length for its name in a file; an unknown name is refused if the sidecar does not state
    `units`."""
    units = name.strip().lower()
    units = SPELLED.get(units.rstrip("s"), units)
    if units in UNITS:
        return units
    if "units" not in side.table:
        raise InputError(what, name, "one of " + ", ".join(UNITS), UNSTATED["units"])
    return side.word("units", UNITS, "m")


def rate_of(value: object, what: str) -> float:
    """Return a rate [1/s] that a file states, a number from 1 to 100000."""
    try:
        rate = number_in(str(value))
    except ValueError:
        rate = np.nan
    if not 1 <= rate <= LARGEST_RATE:
        raise InputError(what, str(value)[:40], "frames per second from 1 to 100000")
    return rate


def even_times(t: np.ndarray, number: np.ndarray, rate: float, what: str) -> tuple[np.ndarray, str]:
    """Return the times (T,) [s] of frames, and a sentence on `what` they are from: the written times t (T,) [s], or the
    frames' numbers (T,) at the rate that the file states [1/s].

    Where the written times are those of an even clock, rounded to few digits, the clock's own times count: at 120
    frames per second times in whole milliseconds are wrong by up to 0.5 ms, and a whip's tip moves by 1 cm in that.
    """
    digits = next((k for k in range(3, 9) if np.abs(t * 10**k - np.round(t * 10**k)).max() < 1e-3), 9)
    steps = np.diff(number)
    counts = {1, int(np.gcd.reduce(steps.astype(int)))} if np.isfinite(steps).all() else {1}
    for every in sorted(counts - {0}):  # an export of every other frame may keep the numbers of all
        even = number / every / rate
        late = t - even
        if np.ptp(late) <= 1.01 * 10.0**-digits:
            shift = 0.0 if np.abs(late).max() <= 10.0**-digits else late[0]
            return even + shift, f"times by frame number at {rate:g} a second, with which {what} agrees"
    return t, f"times [s] from {what}, which does not go evenly at the {rate:g} a second that the file states"


def text_rows(path: Path, mark: str) -> list[list[str]]:
    """Return all rows of a text table of another program without trailing empty cells, blank rows included; `mark`
    separates cells."""
    found = []
    for row in csv.reader(io.StringIO(text_of(path), newline=""), delimiter=mark):
        cells = [cell.strip() for cell in row]
        while cells and not cells[-1]:
            cells.pop()
        found.append(cells)
    return with_points(found)


def numbers(rows: list[list[str]], first: int, columns: Sequence[int], width: int) -> np.ndarray:
    """Return some columns, by index, of the rows from `first` on as numbers (rows, columns); empty cells and `NaN` are
    NaN, blank rows are left out. `width` is the table's number of columns."""
    table: list[list[float]] = []
    for i, row in enumerate(rows[first:], first + 1):
        if len(row) > width:
            raise InputError(f"row {i}", f"{len(row)} cells", f"at most {width} cells, as the row of names has")
        if row:
            table.append([number_of(row[j] if j < len(row) else "", i, j + 1) for j in columns])
    if len(table) < 2:
        raise InputError("rows", len(table), "at least two frames")
    return np.array(table)


def grouped(names: list[str], axes: list[str], wanted: Sequence[str] = AXES) -> tuple[list[str], list[list[int]]]:
    """Return the labels of markers, each of which stands over the first of its columns or left of it, and the columns
    of their `wanted` axes; where axes begin again without a name, the label is empty.
    """
    found: list[tuple[str, dict[str, int]]] = []
    label = ""
    for i, axis in enumerate(axes):
        label = (names[i] if i < len(names) else "") or label
        if axis.lower() in wanted:
            if label or not found or axis.lower() in found[-1][1]:
                found.append((label, {}))
            found[-1][1][axis.lower()], label = i, ""
    whole = [(label, list(of_one.values())) for label, of_one in found if len(of_one) == len(wanted)]
    return [label for label, _ in whole], [of_one for _, of_one in whole]


def padded(names: list[str], said: Mapping[str, str], key: str, rows: list[list[str]], before: int) -> list[str]:
    """Return the markers' names with empty ones for those that a header counts and does not name, if the rows, of which
    `before` columns are no positions, are as long.
    """
    number, most = said.get(key, ""), max((len(row) - before + 2) // 3 for row in rows) if rows else 0
    return names + [""] * (min(int(number), most) - len(names) if number.isdigit() else 0)


def announced(said: Mapping[str, str], key: str, count: int, what: str = "frames") -> tuple[str, ...]:
    """Return a sentence if a file holds another number of frames, or of `what`, than its header announces."""
    number = said.get(key, "")
    if not number.isdigit() or int(number) == count:
        return ()
    return (f"the file holds {count} {what}, and announces {number} ({key})",)
