"""Text exports of Tracker (physlets): the data tables of one or several point masses in a plane.

The row of the masses' names, the row of variables, and a row for each frame; cells are separated by tabs, semicolons or
commas. The variables `t`, `x` and `y` are read, in s and m unless a variable's name states another unit. Positions are
in the coordinate system that was set in Tracker: x to the right is taken as forward, y as up, and its origin as the
shoulder, unless `axes` and `origin` say otherwise. An empty cell is a missing point.
"""

from __future__ import annotations

import re
from decimal import Decimal
from pathlib import Path

import numpy as np

from whiptool.errors import InputError
from whiptool.given_files import number_in
from whiptool.recording.logs import SECONDS
from whiptool.recording.readers import mocap
from whiptool.recording.readers.mocap import Capture, numbers
from whiptool.recording.readers.programs import TRACKER, beginning
from whiptool.recording.readers.sidecar import Sidecar

TOO_FINE = 1e-8  # [s] of a digit, below which rounding of times does not matter
_VARIABLE = re.compile(r"#?\{?(\w+)\}?\s*(?:[(\[](\w+)[)\]])?")


def _capture(rows: list[list[str]], side: Sidecar) -> Capture:
    """What the rows of a text export of Tracker hold."""
    if rows[0][:1] and rows[0][0].startswith("#multi"):  # the names are in this row, or in the next one
        rows = [["", *rows[0][1:]], *rows[1:]] if any(rows[0][1:]) else rows[1:]
    names, variables = rows[0], [_variable(cell) for cell in rows[1]]
    labels, columns = _columns(names, variables)
    if not columns:
        raise InputError("contents", f"{TRACKER.what} without x and y", "the variables t, x and y of a point mass")
    units = {unit for i in columns for _, unit in (variables[j] for j in i)} - {""}
    if len(units) > 1 or not units <= set(mocap.UNITS):
        raise InputError("units", ", ".join(sorted(units)), "one of " + ", ".join(mocap.UNITS))
    table = numbers(rows, 2, [i for found in columns for i in found], len(variables))
    t, clock = _even([row[0] for row in rows[2:] if row], SECONDS[variables[0][1] or "s"])
    return Capture(
        what=TRACKER.what,
        t=t,
        clock=clock,
        points=table.reshape(len(table), len(columns), 2),
        labels=labels,
        units=next(iter(units), "m"),
        assumed=not units,
        axes="x is taken as forward, y as up, and the origin as the shoulder, as they were set in Tracker",
    )


def _mark(path: Path) -> str:
    """What separates the cells: what follows the variable t."""
    head = beginning(path).decode("utf-8-sig", "replace")
    found = re.search(r'^#?"?t"?(?: *[(\[]\w+[)\]])?([\t,;])', head, re.MULTILINE)
    return found[1] if found else "\t"


def _variable(cell: str) -> tuple[str, str]:
    """Name and unit of a variable."""
    found = _VARIABLE.fullmatch(cell)
    return (found[1], found[2] or "") if found else (cell, "")


def _columns(names: list[str], variables: list[tuple[str, str]]) -> tuple[list[str], list[list[int]]]:
    """Labels of the masses and their columns x and y; a mass's name stands over its first column or, if there is one
    name, anywhere.
    """
    alone = [name for name in names if name] or ["tip"]
    labels, columns = mocap.grouped(names if len(alone) > 1 else alone, [name for name, _ in variables], ("x", "y"))
    return [name.replace(" ", "_") for name in labels], columns


def _even(written: list[str], unit: float) -> tuple[np.ndarray, str]:
    """Times [s], and their source; those with few digits are those of the even clock that they belong to, if any."""
    t = unit * np.array([number_in(cell) for cell in written])
    places = np.array([int(Decimal(cell).as_tuple().exponent) for cell in written])
    plain = np.array(["e" not in cell.lower() for cell in written])  # trailing zeros of these may be left out
    places[plain] = places[plain].min(initial=0)
    last = unit * 10.0**places  # digit of each time [s]
    as_written = t, "times [s] from the variable t"
    if len(t) < 3 or not (step := float(np.median(np.diff(t)))) > 0:
        return as_written
    steps = np.diff(t)
    step = float(steps[np.abs(steps - step) < step / 2].mean())
    number = np.round((t - t[0]) / step)
    step, first = np.polyfit(number, t, 1, w=1 / last)
    even = first + step * number
    if not (np.abs(t - even) <= 0.6 * last).all() or last.max() < TOO_FINE:
        return as_written
    return even, f"times from the variable t, whose digits are those of {1 / step:.6g} even frames a second"


read_tracker = mocap.text_reader("Tracker's text", _mark, _capture)
