"""CSV files of numbers, every damaged cell named with its row.

Cells are separated by commas, or by semicolons or tabs where the first row has no comma; numbers may then have a
decimal comma.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from whiptool.errors import InputError
from whiptool.given_files import parsing, whole_file
from whiptool.recording.joint_columns import SECONDS, TIME, Column
from whiptool.recording.readers.foreign import refuse_foreign

LARGEST_TABLE = 2**27  # [bytes] of text, which takes about ten times as much in memory


def read_columns(path: Path) -> tuple[list[str], np.ndarray]:
    """Read a CSV file with one row of names: return the names, and the numbers (rows, columns); empty cells are NaN.

    Raises:
        InputError: The file cannot be read, has no rows, a row has another length, or a cell is not a number.
    """
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
    """Return the index of the time column, its unit in seconds, and a sentence about that unit.

    Raises:
        InputError: There are several time columns.
    """
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
    """Return the rows (R, columns) without exact repetitions of the previous row, time included, and their number."""
    same = (table[1:] == table[:-1]) | (np.isnan(table[1:]) & np.isnan(table[:-1]))
    new = np.concatenate([[True], ~same.all(axis=1)])
    return table[new], int((~new).sum())


def csv_rows(path: Path) -> list[list[str]]:
    """Return the non-blank rows of a CSV file in UTF-8, at least one.

    Raises:
        InputError: The file has no columns, or another program's format is recognised.
    """
    data = path.read_bytes()
    refuse_foreign(path, data[:4096])
    text = data.decode("utf-8-sig")
    first = text.lstrip().partition("\n")[0]
    mark = next((mark for mark in ";\t" if mark in first and "," not in first), ",")
    reader = csv.reader(io.StringIO(text, newline=""), strict=True, delimiter=mark)
    rows = [row for row in reader if any(cell.strip() for cell in row)]
    if not rows:
        raise InputError("rows", 0, "at least one row")
    return rows if mark == "," else [rows[0], *([cell.replace(",", ".") for cell in row] for row in rows[1:])]


def cells(rows: list[list[str]], first: int, width: int) -> np.ndarray:
    """Return rows of text, from row `first` on, as numbers (rows, width); empty cells are NaN."""
    table = np.empty((len(rows) - first, width))
    for i, row in enumerate(rows[first:]):
        if len(row) != width:
            raise InputError(f"row {first + i + 1}", f"{len(row)} cells", f"{width} cells", "was the file cut off?")
        for j, cell in enumerate(row):
            try:
                table[i, j] = float(cell) if cell.strip() else np.nan
            except ValueError:
                raise InputError(f"row {first + i + 1}, column {j + 1}", cell[:40], "a number or empty") from None
    return table
