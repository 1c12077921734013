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
    """Positions of joints over time, as they stand in a file.

    Args:
        t: Times [s], (S,), strictly increasing.
        q: Positions in the unit of the file, (S, n).
        names: Names of the n columns; empty where their order alone says which is which.
        unit: `rad` or `deg` where the columns' names say it; empty: they do not.
        listed: Whether the columns were listed in the arm's order.
        notes: Assumptions, and columns that were left out.
    """

    t: np.ndarray
    q: np.ndarray
    names: tuple[str, ...]
    unit: str = ""
    listed: bool = False
    notes: tuple[str, ...] = ()


def read_joint_log(path: Path, columns: Mapping[str, str] | Sequence[str] | None = None) -> JointLog:
    """Read a log.

    Args:
        path: The file.
        columns: Columns of the arm's joints: by the joints' names, or in the arm's order; None: as they
            are called.

    Raises:
        InputError: It is not such a file, has no joints, a column is missing, their units differ, or stamps cannot be
            right.
    """
    names, table = read_columns(path)
    at, scale, said = time_column(names)
    table, repeated = without_repeated_rows(table)
    chosen = joint_columns([name for i, name in enumerate(names) if i != at], columns, str(path))
    q = table[:, [names.index(name) for name in chosen.names]]
    whole = np.isfinite(q).all(axis=1)
    notes = [said]
    notes += [f"left out {repeated} rows that repeat the one before"] if repeated else []
    notes += [] if whole.all() else [f"left out {(~whole).sum()} rows with an empty cell"]
    t = table[whole, at] * scale
    keep, bad = good_stamps(t, f"{path}: {names[at]}")
    notes = [f"joints: {note}" for note in notes]
    log = chosen.log(t[keep], q[whole][keep])
    return replace(log, notes=(*notes, *log.notes, *bad))


@dataclass(frozen=True)
class Chosen:
    """Which columns are joints.

    Args:
        names: Names of the columns in the file.
        aliases: Names of the columns in the arm; empty: the same.
        in_order: Whether their order alone says which is which.
        listed: Whether the user listed them in the arm's order.
        unit, notes: As of a `JointLog`.
    """

    names: tuple[str, ...]
    aliases: tuple[str, ...] = ()
    in_order: bool = False
    listed: bool = False
    unit: str = ""
    notes: tuple[str, ...] = ()

    def log(self, t: np.ndarray, q: np.ndarray) -> JointLog:
        """The log of these columns: times (S,) [s], and their numbers (S, n)."""
        names = () if self.in_order else self.aliases or self.names
        return JointLog(t, q, names, self.unit, self.listed, tuple(f"joints: {note}" for note in self.notes))


def joint_columns(names: Sequence[str], asked: Mapping[str, str] | Sequence[str] | None, place: str) -> Chosen:
    """Choose the columns of joints by their names.

    Args:
        names: Names of all columns except that of the time.
        asked: As `columns` of `read_joint_log`.
        place: For errors.

    Raises:
        InputError: A requested column is missing, no column is found, or their units differ.
    """
    if asked is not None:
        listed = list(asked.values()) if isinstance(asked, Mapping) else list(asked)
        for name in listed:
            if name not in names:
                raise InputError(f"{place}: column", name, "one of " + ", ".join(names)[:300])
        if isinstance(asked, Mapping) and any(key != name for key, name in asked.items()):
            return Chosen(tuple(listed), aliases=tuple(asked), unit=_unit(listed, place))
        return Chosen(tuple(listed), listed=True, unit=_unit(listed, place))
    said = {name: Column.of(name) for name in names}
    found = [name for name in names if said[name].kind == POSITION] or [name for name in names if not said[name].kind]
    joints = [name for name in found if not said[name].holds]
    aside = [name for name in found if said[name].holds]
    if not joints:
        rule = "t [s] and one column per joint [rad], named after it"
        raise InputError(place, f"columns {', '.join(names)[:200] or 'none'}", rule, "say joint_columns in the sidecar")
    notes = (f"left aside {', '.join(aside)}",) if aside else ()
    order = in_numbers(joints)
    if order is not None and not any(Column.of(name).jointed for name in joints):
        return Chosen(tuple(joints[i] for i in order), in_order=True, unit=_unit(joints, place), notes=notes)
    aliases = tuple(name.removeprefix(PREFIX) for name in joints)
    return Chosen(tuple(joints), aliases=aliases, unit=_unit(joints, place), notes=notes)


def _unit(names: Sequence[str], place: str) -> str:
    """The unit of angles that the names state, if any does."""
    units = {Column.of(name).unit for name in names} - {""}
    if len(units) > 1:
        raise InputError(f"{place}: columns", ", ".join(names)[:200], "one unit for all joints")
    return next(iter(units), "")
