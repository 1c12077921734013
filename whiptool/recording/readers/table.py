"""CSV files of numbers, every damaged cell named with its row."""

from __future__ import annotations

import csv
import io
from pathlib import Path

import numpy as np

from whiptool.errors import InputError
from whiptool.recording.parsing import parsing, whole_file


def read_columns(path: Path) -> tuple[list[str], np.ndarray]:
    """A CSV file of numbers under one row of names: the names, and the numbers (rows, columns); empty cells are NaN.

    Raises:
        InputError: The file cannot be read, has no rows, a row is of another length, or a cell is not a number.
    """
    path = whole_file(path)
    with parsing(path, "CSV"):
        rows = csv_rows(path)
        names = [name.strip() for name in rows[0]]
        if not all(names) or len(set(names)) < len(names):
            raise InputError("columns", ",".join(names)[:80], "different names in the first row")
        if len(rows) < 2:
            raise InputError("rows", 0, "at least one row of numbers")
        return names, cells(rows, 1, len(names))


def csv_rows(path: Path) -> list[list[str]]:
    """The rows of a CSV file in UTF-8 that are not blank, at least one."""
    text = path.read_bytes().decode("utf-8-sig")
    rows = [row for row in csv.reader(io.StringIO(text, newline=""), strict=True) if any(cell.strip() for cell in row)]
    if not rows:
        raise InputError("rows", 0, "at least one row")
    return rows


def cells(rows: list[list[str]], first: int, width: int) -> np.ndarray:
    """Rows of text as numbers (rows, width), from row `first` on; empty cells are NaN."""
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
