"""Assignment of the columns of a joint log to the joints of an arm, by their names in any spelling.

A name is split into words: `/arm1/joint_states/shoulder_pan_joint/position [deg]` is of `shoulder pan`, a position, in
degrees. A column belongs to a joint if both have the same words, or the words of one end with those of the other, as
after a namespace. Names with a number only, such as `actual_q_0`, state only the order.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from whiptool.errors import InputError

POSITION, TIME = "position", "time"
WIDEST = 50.0  # [rad], eight turns of a joint
WIDEST_WAY = 4 * np.pi  # [rad] between a joint's ends in one log
_JOINT = {"joint", "jnt", "j"}
_KINDS = {
    POSITION: {"position", "positions", "pos", "q", "angle", "angles"},
    "command": {"target", "desired", "command", "commanded", "reference", "setpoint", "goal", "action"},
    "other": {
        "velocity", "velocities", "vel", "speed", "qd", "dq", "acceleration", "acc", "qdd", "ddq", "effort", "efforts",
        "torque", "torques", "tau", "moment", "force", "current", "voltage", "temperature", "error",
    },
    TIME: {"t", "time", "timestamp", "stamp", "seconds", "secs", "sec"},
}  # fmt: skip
_SAID = {"actual", "measured", "state", "states", "observation"}  # of a position: that it was measured
_ANGLES = {"rad": "rad", "radian": "rad", "radians": "rad", "deg": "deg", "degree": "deg", "degrees": "deg", "°": "deg"}
SECONDS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "ns": 1e-9}
_TIMES = {unit: unit for unit in SECONDS}
_WORD = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-zµ]+|\d+|°")
_HAND = {"gripper", "finger", "fingers"}  # of what an arm holds the whip with


@dataclass(frozen=True)
class Column:
    """Information in the name of a column.

    Args:
        words: Words of the name in lower case, without those for quantity and unit.
        kind: `position`, `command`, `other` (a speed, a torque, ...), `time`, or empty if not stated.
        unit: `rad`, `deg`, or one of `SECONDS`; empty if not stated.
        jointed: Whether the name contains the word joint, as `joint_1` does and `q1` does not.
    """

    words: tuple[str, ...]
    kind: str
    unit: str
    jointed: bool

    @classmethod
    def of(cls, name: str) -> Column:
        """Parse the name of a column."""
        found = [word.lower() for word in _WORD.findall(name)]
        kinds = [kind for word in found for kind, words in _KINDS.items() if word in words]
        kind = next((kind for kind in (TIME, "other", "command", POSITION) if kind in kinds), "")
        units = _TIMES if kind == TIME else _ANGLES
        unit = next((units[word] for word in reversed(found[1:]) if word in units), "")
        spent = _JOINT | _SAID | set().union(*_KINDS.values())
        words = [word for i, word in enumerate(found) if word not in spent and not (i and word in units)]
        return cls(tuple(words), kind, unit, bool(_JOINT & set(found)))

    @property
    def number(self) -> int | None:
        """Index from the number or letter of a name without other words: 0 for `actual_q_0`, 1 for `b`; else None."""
        if len(self.words) != 1:
            return None
        word = self.words[0]
        return int(word) if word.isdigit() else ord(word) - ord("a") if re.fullmatch("[a-z]", word) else None

    @property
    def holds(self) -> bool:
        """Whether the column belongs to a gripper, which is not a joint of the arm."""
        return bool(_HAND & set(self.words))


def in_numbers(names: Sequence[str]) -> list[int] | None:
    """Return the order of columns whose names are only numbered, such as `q2, q1`; None if a name is not numbered, or a
    number is missing.
    """
    numbers = [number for name in names if (number := Column.of(name).number) is not None]
    if len(numbers) < len(names) or sorted(numbers) not in (list(range(len(names))), list(range(1, len(names) + 1))):
        return None
    return [int(i) for i in np.argsort(numbers)]


def order_of(names: Sequence[str], joints: Sequence[str], *, listed: bool = False) -> list[int]:
    """Return the index of the log's column for each joint of an arm.

    Args:
        names: Names of the columns.
        joints: Names of the arm's joints.
        listed: Whether the user listed the columns in the arm's order; names of other joints are then allowed.

    Raises:
        InputError: A joint has no column or several columns; `given` of the error lists the columns.
    """
    columns, wanted = [Column.of(name) for name in names], [Column.of(joint).words for joint in joints]
    exact = [[i for i, c in enumerate(columns) if c.words == words] for words in wanted]
    taken = {i for found in exact for i in found}
    free = [i for i in range(len(columns)) if i not in taken]
    found = [of or [i for i in free if _ends(columns[i].words, words)] for of, words in zip(exact, wanted, strict=True)]
    if all(len(of) == 1 for of in found) and len({of[0] for of in found}) == len(joints):
        return [of[0] for of in found]
    if not any(found) and len(names) == len(joints):
        order = list(range(len(names))) if listed else in_numbers(names)
        if order is not None:
            return order
    twice = next((joint for joint, of in zip(joints, found, strict=True) if len(of) > 1), None)
    missing = ", ".join(joint for joint, of in zip(joints, found, strict=True) if not of)
    why = f"there are several for {twice}" if twice else f"no column is for {missing}" if missing else "one is of two"
    fix = "say which is which in the sidecar: joint_columns = {" + ", ".join(f'{x} = "COLUMN"' for x in joints) + "}"
    raise InputError(
        "joints", ", ".join(names), f"one column for each joint of the arm: {', '.join(joints)}", f"{why}; {fix}"
    )


def _ends(a: tuple[str, ...], b: tuple[str, ...]) -> bool:
    """Whether the words of one name end with those of the other, which are not a number alone."""
    short, long = sorted((a, b), key=len)
    return bool(short) and not all(word.isdigit() for word in short) and long[-len(short) :] == short


def check_angles(q: np.ndarray, names: Sequence[str]) -> None:
    """Refuse columns (S, a) that no joint's angle in rad can be."""
    for i, column in enumerate(q.T):
        widest, way = np.abs(column).max(), np.ptp(column)
        if widest <= WIDEST and way <= WIDEST_WAY:
            continue
        name = f"joints_q, column {names[i]}" if i < len(names) else "joints_q"
        given = float(widest) if not widest <= WIDEST else f"a way of {way:.4g}"
        rule = f"finite angles within {WIDEST:g} rad, over a way of {WIDEST_WAY:.3g} rad"
        cure = "are these degrees (joint_units), or is it no joint (joint_columns)?"
        raise InputError(name, given, rule, cure)


def read_by_name(names: Sequence[str], order: Sequence[int]) -> list[str]:
    """What was read by which name, where it is not as it stands, and what was left aside."""
    if not names or list(order) == list(range(len(names))):
        return []
    aside = [name for i, name in enumerate(names) if i not in order]
    called = ", ".join(names[i] for i in order)
    return [f"joints by name, in the arm's order: {called}" + (f"; left aside: {', '.join(aside)}" if aside else "")]
