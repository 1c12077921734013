"""Tracks of DeepLabCut, of one animal or several, and of programs that write its format, such as Lightning Pose.

The CSV file has the header rows scorer, perhaps individuals, bodyparts and coords (x, y, likelihood, and with Lightning
Pose's ensembles further columns, which are left out); the HDF5 file (`.h5`) holds the same table as pandas writes it.
Points with a likelihood below 0.6 are missing, as in DeepLabCut's own plots. The sidecar has the keys of
`whiptool.recording.readers.poses`.
"""

from __future__ import annotations

import pickletools
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from whiptool.errors import InputError
from whiptool.given_files import parsing, whole_file
from whiptool.recording.readers import poses
from whiptool.recording.readers.poses import Poses
from whiptool.recording.readers.sidecar import Sidecar
from whiptool.recording.readers.table import cells, csv_rows
from whiptool.recording.strike_recording import StrikeRecording

COORDS = ("x", "y", "likelihood")
LIKELY = 0.6
HEADER = ("scorer", "individuals", "bodyparts", "coords")
WHAT = "a table of DeepLabCut"


def holds_table(path: Path, head: bytes) -> bool:
    """Whether a file with these first bytes is a CSV file of DeepLabCut."""
    return path.suffix.lower() == ".csv" and head.removeprefix(b"\xef\xbb\xbf").lstrip(b'"').startswith(b"scorer")


def read_deeplabcut(path: Path | str, **options: Any) -> StrikeRecording:
    """Read the tracks in a CSV file that DeepLabCut wrote; `options` are keys of its sidecar, whose values they
    override."""
    path = whole_file(path)
    side = Sidecar.of(path, options, *poses.KEYS)
    with parsing(path, "DeepLabCut CSV"):
        rows = csv_rows(path)
        several = any(row[0].strip() == "individuals" for row in rows[:4])
        levels = HEADER if several else tuple(name for name in HEADER if name != "individuals")
        for row, first in zip(rows[: len(levels)] + [[]] * 4, levels):
            if not row or row[0].strip() != first or len(row) != len(rows[0]):
                raise InputError("header", ",".join(row)[:60], f"a row that begins with {first}, as long as the first")
        names = [tuple(x.strip() for x in column) for column in list(zip(*rows[: len(levels)]))[1:]]
        if len(rows) > len(levels) and rows[len(levels)][0].startswith("labeled-data"):
            raise InputError(str(path), "labels of single images for training, as DeepLabCut keeps them", "tracks")
        table = cells(rows, len(levels), len(rows[0]))  # (T, 1 + columns)
        return poses.recorded(path, side, tracks(side, names, table[:, 1:], table[:, 0]))


def tracks(side: Sidecar, names: Sequence[tuple[str, ...]], table: np.ndarray, frames: np.ndarray) -> Poses:
    """Return the tracks of one animal, which the sidecar's key `individual` names, from numbers (T, columns) of frames
    (T,); `names` of a column are scorer, perhaps individual, body part and coordinate."""
    animals = list(dict.fromkeys(name[1] for name in names)) if names and len(names[0]) == 4 else []
    chosen = animals[poses.individual(side, animals, WHAT)] if animals else ""
    columns: dict[str, dict[str, int]] = {}
    further = set()
    for i, name in enumerate(names):
        if animals and name[1] != chosen:
            continue
        part, coord = name[-2:]
        found = columns.setdefault(part, {})
        if coord not in COORDS:
            further.add(coord)
        elif coord in found:
            raise InputError("bodyparts", part, "each name over its three columns, once")
        else:
            found[coord] = i
    for part, found in columns.items():
        if set(found) != set(COORDS):
            raise InputError("coords", f"{', '.join(found)} of {part}", "x, y, likelihood for each body part")
    if not columns:
        raise InputError("bodyparts", "none", "x, y, likelihood for each body part")
    x, y, likelihood = (table[:, [found[coord] for found in columns.values()]] for coord in COORDS)
    notes = (f"left out the columns {', '.join(sorted(further))}",) if further else ()
    notes += (f"left out the individuals {', '.join(x for x in animals if x != chosen)}",) if len(animals) > 1 else ()
    return Poses(WHAT, np.stack([x, y], 2), tuple(columns), likelihood, LIKELY, frames, notes=notes)


def of_hdf5(file: Any) -> dict[str, np.ndarray] | None:
    """Return the table that DeepLabCut wrote into an open HDF5 file: `names` (columns, levels), `table` and `frames`;
    None: the file has no such table.

    pandas writes names of columns as a pickle, which is not loaded: see `plain_names`.
    """
    group = next((one for one in file.values() if "pandas_type" in getattr(one, "attrs", ())), None)
    if group is None:
        return None
    if "table" in group:  # as to_hdf(format="table")
        rows = group["table"][:]
        blocks = sorted(name for name in rows.dtype.names if name.startswith("values_block_"))
        names = [plain_names(group["table"].attrs[f"{block}_kind"]) for block in blocks]
        values = [np.asarray(rows[block], float).reshape(len(rows), -1) for block in blocks]
        frames, names = rows["index"], [name for part in names for name in part]
        table = np.concatenate(values, axis=1)
    else:  # as to_hdf(format="fixed")
        blocks = [f"block{i}" for i in range(int(group.attrs["nblocks"]))]
        names = [name for block in blocks for name in _levels(group, f"{block}_items")]
        table = np.concatenate([np.asarray(group[f"{block}_values"][:], float) for block in blocks], axis=1)
        frames = group["axis1"][:]
    if frames.dtype.kind not in "iuf":
        raise InputError("index", "names of images", "tracks", "these are labels for training; give what was tracked")
    return {"names": np.array(names, dtype=str), "table": table, "frames": np.asarray(frames, float)}


def _levels(group: Any, axis: str) -> list[tuple[str, ...]]:
    """The names on an axis of several levels, which pandas stores as a list of names and numbers of them for each."""
    levels = range(int(group.attrs[f"{axis}_nlevels"]))
    known = [[x.decode() for x in group[f"{axis}_level{i}"][:]] for i in levels]
    return list(zip(*([known[i][k] for k in group[f"{axis}_label{i}"][:]] for i in levels)))


def plain_names(pickled: bytes | str) -> list[tuple[str, ...]]:
    """Return the names of columns that pandas pickled: the tuples of texts are taken from the instructions of the
    pickle, which is not loaded."""
    data = pickled.encode("latin-1") if isinstance(pickled, str) else bytes(pickled)
    try:
        names = _top_of(data)
    except InputError:
        raise
    except (ValueError, LookupError, AttributeError):
        names = None
    if not isinstance(names, list) or not all(isinstance(x, tuple) and set(map(type, x)) <= {str} for x in names):
        raise InputError("names", str(names)[:80], "a list of tuples of texts", "export CSV there")
    return names


def _top_of(data: bytes) -> Any:
    """Return what the instructions of a pickle leave on the stack; only lists, tuples and texts are known."""
    stack: list[Any] = []
    marks: list[int] = []
    memo: dict[Any, Any] = {}
    for code, argument, _ in pickletools.genops(data):
        name = code.name
        if name in _TEXTS:
            stack.append(argument)
        elif name in ("MARK", "EMPTY_LIST", "LIST", "TUPLE", "TUPLE1", "TUPLE2", "TUPLE3", "APPEND", "APPENDS"):
            _gather(name, stack, marks)
        elif name in ("PUT", "BINPUT", "LONG_BINPUT", "MEMOIZE"):
            memo[len(memo) if argument is None else argument] = stack[-1]
        elif name in ("GET", "BINGET", "LONG_BINGET"):
            stack.append(memo[argument])
        elif name not in ("PROTO", "FRAME", "STOP"):
            said = f"a pickle with {name} {'' if argument is None else argument}".rstrip()
            raise InputError("names", said, "lists of texts", "export CSV there")
    return stack[0]


_TEXTS = ("UNICODE", "BINUNICODE", "SHORT_BINUNICODE", "BINUNICODE8")


def _gather(name: str, stack: list[Any], marks: list[int]) -> None:
    """Carry out an instruction of a pickle that makes a list or a tuple of what is on the stack."""
    if name == "MARK":
        marks.append(len(stack))
    elif name == "EMPTY_LIST":
        stack.append([])
    elif name == "APPEND":
        item = stack.pop()
        stack[-1].append(item)
    else:
        begin = len(stack) - int(name[-1]) if name[-1].isdigit() else marks.pop()
        items = stack[begin:]
        del stack[begin:]
        if name == "APPENDS":
            stack[-1].extend(items)
        else:
            stack.append(items if name == "LIST" else tuple(items))
