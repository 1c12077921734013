"""Logs of a robot's joints, and of the poses of its hand.

A log has a column of times and one per joint, at the robot's own rate. The time is the column that is called so (`t`,
`time`, `timestamp`, `stamp`, perhaps with its unit, as in `t [ms]`), else the first. Joints are found by the columns'
names, as `whiptool.recording.logs` takes them apart: columns that say that they are positions where there are such,
else all that are not speeds, torques, commands or grippers. Columns that are merely numbered are in the order of their
numbers. The key `joint_columns` of a sidecar says which are the arm's joints.

The logs of two makers of robots have their own names and units (`LAYOUTS`): those of libfranka and of Universal Robots.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from whiptool.errors import InputError
from whiptool.models.pose_columns import POSE
from whiptool.recording.logs import POSITION, Column, good_stamps, in_numbers
from whiptool.recording.readers.keys import refuse_unheard
from whiptool.recording.readers.table import read_columns, time_column, without_repeated_rows


@dataclass(frozen=True)
class Layout:
    """Columns of the log that a robot's own software writes."""

    what: str  # description of the log
    first: tuple[str, ...]  # names of columns with which its first row begins, or which it has
    joints: str  # regular expression of the measured positions [rad], numbered in the arm's order
    seconds: float  # unit of the column of times, which is the first of `first` [s]

    def columns(self, names: Sequence[str]) -> list[str]:
        """Return the columns of joint positions in the arm's order; empty if the log is not of this layout."""
        found = [name for name in names if re.fullmatch(self.joints, name)] if set(self.first) <= set(names) else []
        return sorted(found, key=lambda name: int(re.findall(r"\d+", name)[-1]))


LAYOUTS = (
    # logToCSV of src/log.cpp, since 0.1; times are Duration::toMSec
    Layout("a log of libfranka (logToCSV)", ("time", "success_rate"), r"state\.q\[\d+\]", 1e-3),
    # startFileRecording of ur_rtde, and record.py of Universal Robots' RTDE client; times since the controller's start
    Layout("a recording of Universal Robots' RTDE", ("timestamp",), r"actual_q_\d+", 1.0),
)


UNHEARD = ("a log of a robot", "state it in the sidecar of the tracks whose log it is")  # of a sidecar next to a log
PREFIX = POSITION + "_"  # of a joint's name, as in the trajectories that whiptool exports


@dataclass(frozen=True, eq=False)
class JointLog:
    """Positions of joints over time, as read from a file."""

    t: np.ndarray  # times [s], (S,), strictly increasing
    q: np.ndarray  # positions in the unit of the file, (S, n)
    names: tuple[str, ...] = ()  # of the joints, (n,); empty if they are in the arm's order
    columns: tuple[str, ...] = ()  # names of their columns in the file
    unit: str = ""  # `rad` or `deg` if the columns' names state it; else empty
    listed: bool = False  # whether the columns were listed in the arm's order
    notes: tuple[str, ...] = ()  # assumptions, and columns and rows that were left out


@dataclass(frozen=True, eq=False)
class Logs:
    """What a robot logged."""

    joints: JointLog | None = None  # positions of its joints, if they were logged
    hand: JointLog | None = None  # its poses, if they were logged: q (S, 7), places [m] and quaternions (x, y, z, w)
    aside: tuple[str, ...] = ()  # what else the file holds, such as names of topics


def holds_log(names: Sequence[str]) -> bool:
    """Whether columns of these names are a log: joints that say that they are positions, or poses of the hand."""
    if any(layout.columns(names) for layout in LAYOUTS) or set(POSE) <= set(names):
        return True
    tracks = any(name.endswith(("_x", "_u")) for name in names)
    return not tracks and any(Column.of(name).kind == POSITION for name in names)


def read_csv_logs(path: Path) -> Logs:
    """Read all logs of a CSV file; a sidecar next to it is refused, because a log alone takes nothing of it."""
    refuse_unheard(path, *UNHEARD)
    names, table = read_columns(path)
    posed = set(POSE) <= set(names)
    jointed = any(layout.columns(names) for layout in LAYOUTS) or any(Column.of(x).kind == POSITION for x in names)
    hand = _poses(path, names, table) if posed else None
    return Logs(_joints(path, names, table) if jointed or not posed else None, hand)


def read_poses(path: Path) -> JointLog:
    """Read a log of the hand's poses from a CSV file with the columns `POSE`: `q` (S, 7) has places [m] and quaternions
    (x, y, z, w)."""
    return _poses(path, *read_columns(path))


def _poses(path: Path, names: Sequence[str], table: np.ndarray) -> JointLog:
    """The log of the hand's poses in a table (rows, columns)."""
    log = _joints(path, names, table, list(POSE))
    if not np.linalg.norm(log.q[:, 3:], axis=1).all():
        raise InputError(f"{path}: {', '.join(POSE[3:])}", "0, 0, 0, 0", "a quaternion in every row")
    return replace(log, notes=tuple(note.replace("joints:", "hand:") for note in log.notes))


def read_joint_log(path: Path, columns: Mapping[str, str] | Sequence[str] | None = None) -> JointLog:
    """Read a log of joint positions from a CSV file; `columns` are those of the arm's joints, see `asked` of
    `joint_log`."""
    return _joints(path, *read_columns(path), columns)


def _joints(
    path: Path, names: Sequence[str], table: np.ndarray, columns: Mapping[str, str] | Sequence[str] | None = None
) -> JointLog:
    """The log of joint positions in a table (rows, columns)."""
    layout = next((layout for layout in LAYOUTS if layout.columns(names)), None)
    if layout is None:
        at, scale, said = time_column(names)
    else:
        at, scale = names.index(layout.first[0]), layout.seconds
        unit = "s" if scale == 1 else "ms"
        said = f"{layout.what}, angles in rad, times [{unit}] from the column {names[at]}"
    table, repeated = without_repeated_rows(table)
    others = [name for i, name in enumerate(names) if i != at]
    own = layout is not None and columns is None
    asked = layout.columns(names) if layout is not None and own else columns
    log = joint_log(table[:, at] * scale, np.delete(table, at, axis=1), others, asked, str(path), of=names[at])
    if layout is not None and set(log.columns) <= set(layout.columns(names)):
        log = replace(log, unit="rad")
    if own:  # numbered columns have no names of joints
        log = replace(log, names=(), listed=False)
    notes = [f"joints: {said}"]
    notes += [f"joints: left out {repeated} rows that repeat the one before"] if repeated else []
    return replace(log, notes=(*notes, *log.notes))


def joint_log(
    t: np.ndarray,
    table: np.ndarray,
    names: Sequence[str],
    asked: Mapping[str, str] | Sequence[str] | None,
    place: str,
    *,
    of: str,
) -> JointLog:
    """Return the log of the columns that are joints, of a table (S, N) at times t (S,) [s].

    The N columns have `names`; without names, they are the joints in the arm's order. `asked` are the columns of the
    arm's joints: by the joints' names, or in the arm's order; None: they are recognised by the columns' names. For
    messages, `place` is the location of the columns and `of` the name of the times.
    """
    if len(names) != table.shape[1] and (names or asked is not None):
        raise InputError(
            place, list(names), f"{table.shape[1]} names, one for each column", "or leave joint_columns out"
        )
    notes: list[str] = []
    if not names and table.shape[1]:
        columns, called = (), ()
        notes.append(f"the columns of {place} have no names, and are taken in the arm's order")
    elif asked is not None:
        columns, called = _asked(names, asked, place)
    else:
        columns, called, aside = _found(names, place)
        notes += [f"left aside {', '.join(aside)}"] if aside else []
    q = table[:, [names.index(name) for name in columns]] if columns else table
    whole = np.isfinite(q).all(axis=1)
    notes += [] if whole.all() else [f"left out {(~whole).sum()} rows with an empty cell"]
    keep, bad = good_stamps(t[whole], f"{place}: {of}")
    listed = asked is not None and called == columns
    if (asked is None or listed) and len(bare := _without_units(called)) == len(called):
        called = tuple(bare)
    said = (*(f"joints: {note}" for note in notes), *bad)
    return JointLog(t[whole][keep], q[whole][keep], called, columns, _unit(columns, place), listed, said)


def _asked(
    names: Sequence[str], asked: Mapping[str, str] | Sequence[str], place: str
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """The columns that are asked for, and what the arm calls them."""
    columns = tuple(asked.values()) if isinstance(asked, Mapping) else tuple(asked)
    for name in columns:
        if name not in names:
            raise InputError(f"{place}: column", name, "one of " + ", ".join(names)[:300])
    return columns, tuple(asked) if isinstance(asked, Mapping) else columns


def _found(names: Sequence[str], place: str) -> tuple[tuple[str, ...], tuple[str, ...], list[str]]:
    """The columns that call themselves joints, what the arm calls them (nothing: their order tells), and grippers."""
    said = {name: Column.of(name) for name in names}
    found = [name for name in names if said[name].kind == POSITION] or [name for name in names if not said[name].kind]
    joints = [name for name in found if not said[name].holds]
    if not joints:
        rule = "t [s] and one column per joint [rad], named after it"
        raise InputError(
            place, f"columns {', '.join(names)[:200] or 'none'}", rule, "state joint_columns in the sidecar"
        )
    aside = [name for name in found if said[name].holds]
    order = in_numbers(joints)
    if order is not None and not any(said[name].jointed for name in joints):
        return tuple(joints[i] for i in order), (), aside
    return tuple(joints), tuple(name.removeprefix(PREFIX) for name in joints), aside


_UNIT = re.compile(r"[ _]?(\[(deg|rad|°)\]|\((deg|rad|°)\))$|(?<=\w)_(deg|rad)$")  # at the end of a joint's name


def _without_units(names: Sequence[str]) -> list[str]:
    """Different names, without the units at their ends."""
    return list(dict.fromkeys(_UNIT.sub("", name) for name in names))


def reads_back(names: Sequence[str]) -> bool:
    """Whether columns `position_NAME` of a log are read as joints of these names, in this order."""
    try:
        _, called, aside = _found([PREFIX + name for name in names], "")
    except InputError:
        return False
    return called == tuple(names) and not aside and not _unit([PREFIX + name for name in names], "")


def _unit(names: Sequence[str], place: str) -> str:
    """The unit of angles that the names state, if any does."""
    units = {Column.of(name).unit for name in names} - {""}
    if len(units) > 1:
        raise InputError(f"{place}: columns", ", ".join(names)[:200], "one unit for all joints")
    return next(iter(units), "")
