"""Logs of a robot's joints: CSV with a column of times and one per joint, at the robot's own rate.

The time is the column that is called so (`t`, `time`, `timestamp`, `stamp`, perhaps with its unit, as in `t [ms]`),
else the first. Joints are found by the columns' names, as `whiptool.recording.joint_columns` takes them apart: columns
that say that they are positions where there are such, else all that are not speeds, torques, commands or grippers.
Columns that are merely numbered are in the order of their numbers. The key `joint_columns` of a sidecar says which are
the arm's joints.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from whiptool.errors import InputError
from whiptool.recording.clock import good_stamps
from whiptool.recording.joint_columns import POSITION, Column, in_numbers
from whiptool.recording.readers.table import read_columns, time_column, without_repeated_rows

PREFIX = POSITION + "_"  # of a joint's name, as in the trajectories that whiptool exports


@dataclass(frozen=True, eq=False)
class JointLog:
    """Positions of joints over time, as read from a file.

    Args:
        t: Times [s], (S,), strictly increasing.
        q: Positions in the unit of the file, (S, n).
        names: Names of the n joints; empty if they are in the arm's order.
        columns: Names of their columns in the file.
        unit: `rad` or `deg` if the columns' names state it; else empty.
        listed: Whether the columns were listed in the arm's order.
        notes: Assumptions, and columns and rows that were left out.
    """

    t: np.ndarray
    q: np.ndarray
    names: tuple[str, ...] = ()
    columns: tuple[str, ...] = ()
    unit: str = ""
    listed: bool = False
    notes: tuple[str, ...] = ()


def read_joint_log(path: Path, columns: Mapping[str, str] | Sequence[str] | None = None) -> JointLog:
    """Read a joint log.

    Args:
        path: The file.
        columns: See `asked` of `joint_log`.

    Raises:
        InputError: The file is not a joint log, has no joints, lacks a column, units differ, or time stamps are
            implausible.
    """
    names, table = read_columns(path)
    at, scale, said = time_column(names)
    table, repeated = without_repeated_rows(table)
    others = [name for i, name in enumerate(names) if i != at]
    log = joint_log(table[:, at] * scale, np.delete(table, at, axis=1), others, columns, str(path), of=names[at])
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
    """Return the log of the columns that are joints.

    Args:
        t: Times [s], (S,).
        table: The other columns, (S, N).
        names: Names of the N columns; empty: the columns have no names, and are the joints in the arm's order.
        asked: Columns of the arm's joints: by the joints' names, or in the arm's order; None: they are recognised by
            the columns' names.
        place: Location of the columns, for messages.
        of: Name of the times.

    Raises:
        InputError: The number of names is not that of columns, a requested column is missing, no column is a joint,
            their units differ, or time stamps are implausible.
    """
    if len(names) != table.shape[1] and (names or asked is not None):
        raise InputError(place, list(names), f"{table.shape[1]} names, one for each column", "or no joint_columns")
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
        raise InputError(place, f"columns {', '.join(names)[:200] or 'none'}", rule, "say joint_columns in the sidecar")
    aside = [name for name in found if said[name].holds]
    order = in_numbers(joints)
    if order is not None and not any(said[name].jointed for name in joints):
        return tuple(joints[i] for i in order), (), aside
    return tuple(joints), tuple(name.removeprefix(PREFIX) for name in joints), aside


def _unit(names: Sequence[str], place: str) -> str:
    """The unit of angles that the names state, if any does."""
    units = {Column.of(name).unit for name in names} - {""}
    if len(units) > 1:
        raise InputError(f"{place}: columns", ", ".join(names)[:200], "one unit for all joints")
    return next(iter(units), "")
