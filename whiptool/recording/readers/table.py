"""CSV files of numbers, every damaged cell named with its row.

Cells are separated by commas, or by semicolons or tabs where the first row has no comma; numbers may then have a
decimal comma. The columns of Universal Robots' own recorder are separated by blanks.
"""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from whiptool.errors import InputError
from whiptool.given_files import encoding_of, number_in, parsing, whole_file
from whiptool.recording.logs import SECONDS, TIME, Column
from whiptool.recording.readers.programs import EXPORTS, OTHERS, beginning, refuse_others

_BY_BLANKS = re.compile(r"\w+( \w+)* actual_\w+( \w+)*")  # first row of Universal Robots' RTDE client
AXES = ("x", "y", "z")  # of a marker's columns
LARGEST_TABLE = 2**27  # [bytes] of text, which takes about ten times as much in memory


def read_columns(path: Path) -> tuple[list[str], np.ndarray]:
    """Read a CSV file with one row of names: return the names, and the numbers (rows, columns); empty cells are NaN."""
    path = whole_file(path, largest=LARGEST_TABLE)
    with parsing(path, "CSV"):
        rows = csv_rows(path)
        names = [name.strip() for name in rows[0]]
        if not all(names) or len(set(names)) < len(names):
            raise InputError("columns", ",".join(names)[:80], "different names in the first row")
        if len(rows) < 2:
            raise InputError("rows", 0, "at least one row of numbers")
        return names, cells(rows, 1, len(names))


def time_column(names: Sequence[str]) -> tuple[int, float, str]:
    """Return the index of the time column, its unit in seconds, and a sentence about that unit."""
    columns = [Column.of(name) for name in names]
    found = [i for i, column in enumerate(columns) if column.kind == TIME and not column.words]
    exact = [i for i in found if names[i] == "t"] or found
    if len(exact) > 1:
        raise InputError("columns of times", ", ".join(names[i] for i in exact), "one", "name the right one t")
    i = exact[0] if exact else 0
    unit = columns[i].unit or "s"
    guessed = "" if exact else ", the first; none is called t"
    return i, SECONDS[unit], f"times [{unit}] from the column {names[i]}{guessed}"


def without_repeated_rows(table: np.ndarray) -> tuple[np.ndarray, int]:
    """Return a table's rows without those that equal the row before, time included, and how many were left out."""
    same = (table[1:] == table[:-1]) | (np.isnan(table[1:]) & np.isnan(table[:-1]))
    new = np.concatenate([[True], ~same.all(axis=1)])
    return table[new], int((~new).sum())


def csv_rows(path: Path) -> list[list[str]]:
    """Return the non-blank rows of a CSV file, at least one."""
    refuse_others(path, beginning(path), EXPORTS + OTHERS)
    text = text_of(path)
    first = text.lstrip().partition("\n")[0]
    mark = next((mark for mark in ";\t" if mark in first and "," not in first), ",")
    mark = " " if mark not in first and _BY_BLANKS.fullmatch(first.strip()) else mark
    reader = csv.reader(io.StringIO(text, newline=""), strict=True, delimiter=mark)
    rows = [row for row in reader if any(cell.strip() for cell in row)]
    if not rows:
        raise InputError("rows", 0, "at least one row")
    return rows if mark == "," else [rows[0], *with_points([[x.strip() for x in row] for row in rows[1:]], 2)]


def text_of(path: Path) -> str:
    """Return the text of a file in UTF-8, in UTF-16, or in Windows' encoding of western languages."""
    data = path.read_bytes()
    try:
        return data.decode(encoding_of(data))
    except UnicodeDecodeError:
        return data.decode("cp1252")


_DECIMAL = {mark: re.compile(rf"[-+]?(\d+{mark}\d*|{mark}\d+)([eE][-+]?\d+)?") for mark in (r"\.", ",")}
_GROUPED = re.compile(r"[-+]?[1-9]\d{0,2}([.,])\d{3}((\1\d{3})*[.,]\d+)?")  # 1.234,5; and 1.234, which may be so
_NUMERIC = re.compile(r"[-+\d.,eE]*|nan", re.IGNORECASE)


def with_points(rows: list[list[str]], first: int = 1) -> list[list[str]]:
    """Return rows of cells with decimal points in place of decimal commas; `first` is the number of the first row.
    Separators of thousands, or a column that has both marks, are refused."""
    if not any("," in cell for row in rows for cell in row):
        return rows
    used: dict[int, set[str]] = {}
    numeric = [(i, row) for i, row in enumerate(rows, first) if all(_NUMERIC.fullmatch(cell) for cell in row)]
    for _, row in numeric:
        for j, cell in enumerate(row):
            used.setdefault(j, set()).update(mark for mark, form in _DECIMAL.items() if form.fullmatch(cell))
    for i, row in numeric:
        for j, cell in enumerate(row):
            if (found := _GROUPED.fullmatch(cell)) and (found[2] or len(used[j]) > 1):
                fix = "write numbers with one decimal mark, and without separators of thousands"
                raise InputError(f"row {i}, column {j + 1}", cell, "a number with at most one point or comma", fix)
    return [[x.replace(",", ".") if _DECIMAL[","].fullmatch(x) else x for x in row] for row in rows]


def cells(rows: list[list[str]], first: int, width: int) -> np.ndarray:
    """Return rows of text, from row `first` on, as numbers (rows, width); empty cells are NaN."""
    table = np.empty((len(rows) - first, width))
    for i, row in enumerate(rows[first:]):
        if len(row) != width:
            raise InputError(f"row {first + i + 1}", f"{len(row)} cells", f"{width} cells", "was the file cut off?")
        table[i] = [number_of(cell, first + i + 1, j) for j, cell in enumerate(row, 1)]
    return table


def number_of(cell: str, row: int, column: int) -> float:
    """Return the number in a cell; NaN if it is empty."""
    try:
        return number_in(cell) if cell.strip() else np.nan
    except ValueError:
        raise InputError(f"row {row}, column {column}", cell[:40], "a number or empty") from None


def split_columns(
    names: list[str], more: tuple[str, ...] = (), *, axes: tuple[str, ...] = AXES
) -> dict[str, dict[str, int]]:
    """Return the index of each marker's column for each quantity (its coordinates `axes`, of which the third may be
    missing, and `more`), in order of appearance; if a column's name ends with two of `more`, the longer one counts."""
    columns: dict[str, dict[str, int]] = {}
    for i, name in enumerate(names):
        what = max((x for x in (*axes, *more) if name.endswith("_" + x)), key=len, default="")
        marker = name.removesuffix("_" + what)
        if not what or not marker:
            endings = ", ".join("_" + x for x in (*axes, *more))
            raise InputError("column", name, f"MARKER with one of {endings}", f"as in tip_{axes[0]}, tip_{axes[1]}")
        columns.setdefault(marker, {})[what] = i
    if not columns:
        raise InputError("columns", "no markers", "at least tip_x and tip_y")
    for marker, found in columns.items():
        if not set(axes[:2]) <= found.keys():
            both = f"{marker}_{axes[0]} and {marker}_{axes[1]}"
            raise InputError(f"marker {marker}", ", ".join(names[i] for i in found.values()), both)
    if len({"z" in found for found in columns.values()}) > 1:
        raise InputError("columns", ", ".join(names)[:80], "_z for all markers or for none")
    return columns


def stacked(
    table: np.ndarray,
    columns: dict[str, dict[str, int]],
    what: str,
    otherwise: float | np.ndarray = np.nan,
    *,
    unit: float = 1.0,
) -> np.ndarray:
    """Return one quantity of all M markers, such as `x`, (T, M), from a table (T, columns) whose `columns` are as of
    `split_columns`, times a factor `unit`; `otherwise` stands for markers that lack the column."""
    default = np.broadcast_to(otherwise, (len(table), len(columns)))
    found = [table[:, c[what]] * unit if what in c else default[:, j] for j, c in enumerate(columns.values())]
    return np.stack(found, axis=1)
