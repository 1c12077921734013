"""CSV exports of OptiTrack Motive, format versions 1.1 to 3.

The first row states rate and unit of length; rows of types, names and quantities describe the columns. Measured markers
and the positions of rigid bodies are read; of a rigid body's markers as Motive solved them only those that were not
measured. Unlabeled markers are read if there are no others, or if `markers` names them; bones are left out. An empty
cell is a missing point. The poses of the rigid body that `hand` names are those of the hand. Motive does not write its
axes: y is up, as is Motive's own convention, unless the first row says otherwise, and x is taken to point forward.
"""

from __future__ import annotations

import re
from typing import Any

import numpy as np

from whiptool.errors import InputError
from whiptool.given_files import number_in
from whiptool.recording.readers import mocap
from whiptool.recording.readers.mocap import Capture, numbers
from whiptool.recording.readers.programs import MOTIVE
from whiptool.recording.readers.sidecar import Sidecar
from whiptool.recording.readers.table import AXES
from whiptool.words import counted

MEASURED, BODY = "marker", "rigid body"  # types of columns
SOLVED = ("rigid body marker", "bone marker", "trained markerset marker")
QUATERNION = ("x", "y", "z", "w")
KNOWN = (1.0, 4.0)  # format versions

Columns = dict[str, list[int]]  # indices of columns by the label of their marker or body


def _capture(rows: list[list[str]], side: Sidecar) -> Capture:
    """What the rows of a CSV export of Motive hold."""
    said = dict(zip(rows[0][::2], rows[0][1::2]))
    at = next((i for i, row in enumerate(rows) if row[:1] == ["Frame"]), None)
    if at is None:
        raise InputError("rows", "no row that begins with Frame", f"that row, as in {MOTIVE.what}")
    if said.get("Coordinate Space", "Global") != "Global":
        raise InputError("Coordinate Space", said["Coordinate Space"], "Global", "export in global coordinates")
    columns, turns, notes = _markers(rows[1:at], rows[at])
    read = _read(rows, at, said, (columns, turns), side)
    notes = (*_unfamiliar(said), *mocap.announced(said, "Total Exported Frames", len(read["t"])), *notes)
    return Capture(what=MOTIVE.what, notes=notes, **read)


read_motive = mocap.text_reader("Motive CSV", ",", _capture)


def _read(
    rows: list[list[str]], at: int, said: dict[str, str], found: tuple[Columns, Columns], side: Sidecar
) -> dict[str, Any]:
    """Times, places, rotations, units and axes, as arguments of `Capture`."""
    columns, turns = found
    width = max(len(row) for row in rows[1 : at + 1])  # a mean error has no axis
    order = [i for of_one in (*columns.values(), *turns.values()) for i in of_one]
    table = numbers(rows, at + 1, [0, 1, *order], width)
    rate = mocap.rate_of(said.get("Export Frame Rate") or said.get("Capture Frame Rate"), "Export Frame Rate")
    t, clock = mocap.even_times(table[:, 1], table[:, 0], rate, "the column Time")
    stated = re.search(r"\b([xyz])[- ]?up\b|up axis,\+?([xyz])\b", ",".join(rows[0]), re.IGNORECASE)
    up = (stated[1] or stated[2]).lower() if stated else "y"
    source = "as the file says" if stated else "as is Motive's own convention, for the file does not say it"
    units, last = said.get("Length Units"), 2 + 3 * len(columns)
    ends = np.cumsum([last, *(len(of_one) for of_one in turns.values())])
    return {
        "t": t,
        "clock": clock,
        "points": table[:, 2:last].reshape(len(table), len(columns), 3),
        "turns": {name: table[:, a:b] for name, a, b in zip(turns, ends, ends[1:], strict=False)},
        "labels": list(columns),
        "units": "m" if units is None else mocap.unit_of(units, "Length Units", side),
        "assumed": units is None,
        "forward": mocap.FORWARD[up],
        "up": up,
        "axes": f"{up} is up, {source}, {mocap.FORWARD[up]} taken as forward",
    }


def _markers(above: list[list[str]], axes: list[str]) -> tuple[Columns, Columns, list[str]]:
    """Columns x, y, z of each marker and body by its label, x, y, z, w of each body's rotation (none if that is not a
    quaternion), and what was left out.
    """
    types, names, marks, what = _described(above)
    found: dict[tuple[str, str, str], dict[str, int]] = {}
    turned: dict[tuple[str, str, str], dict[str, int]] = {}
    for i in range(2, len(axes)):
        kind, name, mark, quantity = (row[i] if i < len(row) else "" for row in (types, names, marks, what))
        if quantity.lower() == "position" and axes[i].lower() in AXES:
            found.setdefault((kind.lower(), name, mark), {}).setdefault(axes[i].lower(), i)
        elif quantity.lower() == "rotation" and axes[i].lower() in QUATERNION:
            turned.setdefault((kind.lower(), name, mark), {}).setdefault(axes[i].lower(), i)
    known = {key: list(c.values()) for key, c in found.items() if len(c) == 3 and key[0] in (MEASURED, BODY, *SOLVED)}
    order = sorted(known, key=lambda key: key[0] in SOLVED)  # those that were measured first
    columns: Columns = {}
    turns: Columns = {}
    solved = 0
    for kind, name, mark in order:
        if kind in SOLVED and name in columns:
            solved += 1
            continue
        label = name if name not in columns else f"{name} {mark}"
        columns[label] = known[kind, name, mark]
        if kind == BODY:
            four = turned.get((kind, name, mark), {})
            turns[label] = [four[axis] for axis in QUATERNION] if len(four) == len(QUATERNION) else []
    others = {kind for kind, _, _ in found if kind not in (MEASURED, BODY, *SOLVED)}
    notes = (
        [f"left out {counted(solved, 'marker')} as Motive solved them, for they were measured, too"] if solved else []
    )
    notes += [f"left out columns of the types {', '.join(sorted(others))}"] if others else []
    return columns, turns, notes


def _described(above: list[list[str]]) -> tuple[list[str], list[str], list[str], list[str]]:
    """The rows of types, names, identifiers and quantities between the first row and that of axes."""
    rows = [row for row in above if row]
    named = {row[1].lower(): row for row in rows if len(row) > 1 and row[1]}
    if "type" in named and "name" in named:
        return named["type"], named["name"], named.get("id", []), rows[-1]
    if len(rows) < 3:
        raise InputError("rows", len(rows), f"rows of types, names and quantities, as in {MOTIVE.what}")
    return rows[0], rows[1], rows[2] if len(rows) > 3 else [], rows[-1]


def _unfamiliar(said: dict[str, str]) -> list[str]:
    """A sentence on the format's version, if it is unknown."""
    try:
        familiar = KNOWN[0] <= number_in(said["Format Version"]) < KNOWN[1]
    except (KeyError, ValueError):
        familiar = False
    return [] if familiar else [f"format version {said.get('Format Version')}: read as versions 1.1 to 3 are"]
