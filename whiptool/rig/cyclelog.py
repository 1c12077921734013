"""Log of every control cycle, written immediately, so that it is complete however a run ends."""

from __future__ import annotations

import json
import math
import struct
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import IntEnum, IntFlag
from io import FileIO
from pathlib import Path
from typing import Any

import numpy as np

from whiptool.errors import InputError
from whiptool.given_files import read_bytes
from whiptool.whole_files import append_to

_LARGEST, _MOST_JOINTS = 2**28, 100  # [bytes] of a log that is read, joints in it


class Phase(IntEnum):
    """Phase of a run of the arm in a control cycle."""

    APPROACH = 0
    SETTLE = 1
    STRIKE = 2
    RETURN = 3


class Flag(IntFlag):
    """Faults of a control cycle, as bit flags."""

    MISSED = 1  # no sample: q, v and the rest are not a number
    OVERRUN = 2  # it ended after the next one's deadline
    SATURATED = 4  # the torque was cut to the current limit
    HELD = 8  # the goal of the cycle before was sent again
    FAULT = 16  # the cycle that ended the run: zero current was commanded
    OUTSIDE = 32  # not a cycle: a fault while arming or disarming, or an exception; the last row


# (name, values per joint or 1, what)
_COLUMNS = (
    ("t", 0),  # scheduled time since the first cycle [s]
    ("stamp", 0),  # the loop's clock when the sample was there [s]
    ("late", 0),  # start of the cycle after its deadline [s]
    ("q", 1),  # [rad]
    ("v", 1),  # [rad/s]
    ("current", 1),  # [A]
    ("goal_current", 1),  # as commanded in this cycle [A]
    ("tau", 1),  # as the controller wanted [N m]
    ("q_d", 1),  # [rad]
    ("voltage", 1),  # [V]
    ("temperature", 1),  # [deg C]
    ("flags", 0),  # of `Flag`
    ("phase", 0),  # of `Phase`
    ("state", 0),  # of `whiptool.rig.safety.State`
)
_MAGIC = "whiptool cycles 1"


class CycleLog:
    """Writes one row per control cycle.

    Args:
        joints: Number of joints.
        path: File to write to, row by row and unbuffered, so that even SIGKILL loses nothing. None: rows are kept in
            memory.
        about: Description of the run, as data for JSON, for the file's first line.
    """

    def __init__(self, joints: int, path: Path | None = None, *, about: dict[str, Any] | None = None) -> None:
        self.joints = joints
        width = sum(joints if per_joint else 1 for _, per_joint in _COLUMNS)
        self._row = struct.Struct(f"<{width}d")
        head = {"format": _MAGIC, "joints": joints, "about": about or {}}
        self._head = (json.dumps(head) + "\n").encode()
        self._memory = bytearray(self._head)
        self._file: FileIO | None = None
        if path is not None:
            self._file = Path(path).open("wb", buffering=0)  # noqa: SIM115  # closed by `close`
            append_to(self._file, self._head)

    def append(self, values: Mapping[str, Any]) -> None:
        """Write one cycle: values of the columns of `Cycles` by name; missing values and None are stored as NaN."""
        row: list[float] = []
        for name, per_joint in _COLUMNS:
            value = values.get(name)
            if value is None:
                row += [math.nan] * (self.joints if per_joint else 1)
            else:
                row += value.tolist() if per_joint else [value]
        data = self._row.pack(*row)
        self._memory += data
        if self._file is not None:
            append_to(self._file, data)

    def cycles(self) -> Cycles:
        """Return the cycles written so far."""
        return _parse(bytes(self._memory), "log")

    def close(self) -> None:
        """Close the file of the log."""
        if self._file is not None:
            self._file.close()
            self._file = None


@dataclass(frozen=True)
class Cycles:
    """Log of a run: C control cycles of an arm of n joints. Values that a missed cycle did not measure are NaN.

    Args:
        t, stamp, late: Scheduled time, clock time of the sample, and delay of the cycle's start [s], (C,) each.
        q, v: Measured positions [rad] and velocities [rad/s], (C, n).
        current, goal_current: Measured and commanded current of the motors [A], (C, n).
        tau: Torque that the controller requested of servos, or that a robot arm measured [N m], (C, n).
        q_d: Desired position [rad], (C, n).
        voltage, temperature: Supply voltage [V] and temperature [deg C] of the servos, (C, n).
        flags, phase, state: Values of `Flag`, `Phase` and `whiptool.rig.safety.State`, (C,) integers.
        about: Description of the run.
    """

    t: np.ndarray
    stamp: np.ndarray
    late: np.ndarray
    q: np.ndarray
    v: np.ndarray
    current: np.ndarray
    goal_current: np.ndarray
    tau: np.ndarray
    q_d: np.ndarray
    voltage: np.ndarray
    temperature: np.ndarray
    flags: np.ndarray
    phase: np.ndarray
    state: np.ndarray
    about: dict[str, Any] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.t)

    @classmethod
    def load(cls, path: Path | str) -> Cycles:
        """Read a file that `CycleLog` wrote, also if the writing process was killed.

        Raises:
            InputError: The file is not a log of cycles.
        """
        return _parse(read_bytes(Path(path), "log of cycles", largest=_LARGEST), str(path))

    @property
    def lost(self) -> np.ndarray:
        """How many samples are missing at each cycle, (C,): by the clock of a robot's controller, whose period is
        `period` of the description [s], those since the cycle before; of servos, 1 in a cycle without a sample.
        """
        period = self.about.get("period")
        if period is None:
            return ((self.flags & Flag.MISSED) > 0).astype(int)
        between = np.diff(self.stamp, prepend=self.stamp[:1])
        return np.maximum(np.rint(between / period).astype(int) - 1, 0)

    @property
    def longest_gap(self) -> float:
        """Longest time between two samples [s]; 0 for fewer than two."""
        return float(np.diff(self.stamp[np.isfinite(self.q).all(axis=1)]).max(initial=0.0))

    def during(self, phase: Phase) -> Cycles:
        """Return the cycles of one phase."""
        keep = self.phase == phase
        return Cycles(*(getattr(self, name)[keep] for name, _ in _COLUMNS), about=self.about)


def _parse(data: bytes, name: str) -> Cycles:
    line, _, rows = data.partition(b"\n")
    try:
        head = json.loads(line)
        joints = int(head["joints"])
        assert head["format"] == _MAGIC
        assert 1 <= joints <= _MOST_JOINTS
        assert isinstance(head["about"], dict)
    except (ValueError, KeyError, TypeError, OverflowError, RecursionError, AssertionError):
        raise InputError(name, line[:40], f"a file that begins with {_MAGIC!r}") from None
    widths = [joints if per_joint else 1 for _, per_joint in _COLUMNS]
    width = sum(widths)
    table = np.frombuffer(rows, np.float64, count=len(rows) // (8 * width) * width).reshape(-1, width)
    arrays, at = [], 0
    for (column, per_joint), w in zip(_COLUMNS, widths, strict=True):
        values = table[:, at : at + w] if per_joint else table[:, at]
        arrays.append(values.astype(int) if column in ("flags", "phase", "state") else values)
        at += w
    return Cycles(*arrays, about=head["about"])
