"""Log of the trials of a run, from which a killed search is resumed."""

from __future__ import annotations

import csv
import dataclasses
import io
import itertools
import math
import re
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from whiptool.errors import InputError
from whiptool.given_files import number_in, read_bytes
from whiptool.models.numbers import LARGEST
from whiptool.models.parameters import AnyArm
from whiptool.models.strike import strike_names
from whiptool.objective import RIG, Arrival, Outcome, Trial
from whiptool.whole_files import append_whole, write_whole

TRIALS = "trials.csv"
_STATUS = ("hit", "miss", "refused", "unseen", "diverged")
_ARRIVAL = ("arrival_angle", "arrival_speed", "cost")
_VECTORS = ("tip", "tip_velocity", "max_joint_speed", "max_torque")
_NUMBERS = re.compile(rb"[-+.,0-9a-z]*")  # and nan, inf: what a kill in the middle of a line leaves


@dataclass(frozen=True)
class TrialColumns:
    """Columns of a log of trials: the trial's number, its strike, and the parts of its outcome."""

    names: tuple[str, ...]  # of a strike's coordinates
    parts: Mapping[str, Sequence[str]]  # names of the columns of each part of an outcome, in order

    @classmethod
    def named(cls, header: Sequence[str]) -> TrialColumns:
        """Return the columns that a log's first line names; raise ValueError if it is not that of a log of trials."""
        names = tuple(header[1 : header.index("miss_distance")])
        left = list(header[1 + len(names) :])
        axes = sum(name in left for name in ("tip_x", "tip_y", "tip_z"))
        joints = sum(name.startswith("max_joint_speed_") for name in left)
        counts = {"miss_distance": 1, "hit": 1, "time": 1, "tip": axes, "tip_velocity": axes}
        counts |= {"max_joint_speed": joints, "max_torque": joints}
        behind = left[sum(counts.values()) :]  # named by whom it concerns, such as a criterion
        counts |= {"miss_error": 1} if behind[:1] == ["miss_error"] else {}
        counts |= {"arrival": len(_ARRIVAL)} if tuple(behind[: len(_ARRIVAL)]) == _ARRIVAL else {}
        behind = left[sum(counts.values()) :]
        counts |= {"values": behind.index("merit"), "merit": 1} if "merit" in behind else {}
        counts |= {"status": 1} | ({"refused": 1} if left[-1:] == ["refused"] else {})
        parts = {part: [left.pop(0) for _ in range(count)] for part, count in counts.items() if len(left) >= count}
        if header[0] != "trial" or parts.get("status") != ["status"] or left:
            raise ValueError(f"no columns of trials: {header}")
        return cls(names, parts)

    @property
    def header(self) -> list[str]:
        """Names of all columns."""
        return ["trial", *self.names, *itertools.chain(*self.parts.values())]

    def trial(self, line: bytes) -> Trial | None:
        """Return the trial in a line without its end; None if it holds none."""
        row = line.decode("utf-8", "replace").split(",")
        if len(row) != len(self.header):
            return None
        cells = iter(row)
        try:
            number = int(next(cells))
            strike = tuple(number_in(next(cells)) for _ in self.names)
            parts = {part: _value(part, [next(cells) for _ in names]) for part, names in self.parts.items()}
        except ValueError:
            return None
        status = parts.pop("status")
        lost = status not in ("hit", "miss")  # its distance is a penalty, and it has no arrival
        if not all(map(math.isfinite, strike)) or not 0 <= parts["miss_distance"] <= (math.inf if lost else LARGEST):
            return None
        if not lost and parts.get("arrival", ()) is None:
            return None
        if status == "refused":
            parts.setdefault("refused", RIG)
        return Trial(number, strike, Outcome(**parts, diverged=status == "diverged", unseen=status == "unseen"))

    def line(self, trial: Trial) -> str:
        """Return the line of a trial."""
        parts = [_cells(part, getattr(trial.outcome, part), len(names)) for part, names in self.parts.items()]
        return _line([trial.number, *map(repr, trial.strike), *itertools.chain(*parts)])


class TrialLog:
    """Log of a run's trials as CSV; each trial is written and flushed as one line, with numbers at full precision.

    The file is created with a header if it does not exist; coordinates of a strike are named `names`, by default after
    the joints of the arm. Columns are added: `measured`: standard errors of miss distances, NaN if unknown; `arriving`:
    the arrival, NaN if the strike diverged or was refused, and the cost; `limited`: the limit by which a strike was
    refused, or empty; `criteria`: each of them, NaN if the strike diverged or was refused, and the merit, NaN if it
    does not hit.
    """

    def __init__(
        self,
        path: Path,
        arm: AnyArm,
        *,
        names: Sequence[str] | None = None,
        measured: bool = False,
        arriving: bool = False,
        limited: bool = False,
        criteria: Sequence[str] = (),
    ) -> None:
        self.path = path
        axes = "xyz"[: arm.dimension]
        parts = {  # of an outcome, and their columns
            **{name: [name] for name in ("miss_distance", "hit", "time")},
            **{name: [f"{name}_{axis}" for axis in axes] for name in ("tip", "tip_velocity")},
            **{name: [f"{name}_{joint}" for joint in arm.joints] for name in ("max_joint_speed", "max_torque")},
            **({"miss_error": ["miss_error"]} if measured else {}),
            **({"arrival": _ARRIVAL} if arriving else {}),
            **({"values": list(criteria), "merit": ["merit"]} if criteria else {}),
            "status": ["status"],
            **({"refused": ["refused"]} if limited else {}),
        }
        self.columns = TrialColumns(strike_names(arm) if names is None else tuple(names), parts)

    def read(self) -> list[Trial]:
        """Return all trials up to the first damaged line.

        An incomplete last line is removed from the file. If more is damaged, the file is renamed first, which is
        reported on stderr.

        Raises:
            InputError: The first line is not the header of such a log.
        """
        if not self.path.exists():
            return []
        data = read_bytes(self.path, "log of trials")
        *lines, cut_off = data.split(b"\n")
        header = _line(self.columns.header).encode()
        if not header.startswith(b"".join(line + b"\n" for line in lines[:1]) or cut_off):
            begin = data[:80].decode("latin-1").replace("\n", " ")
            given = begin if begin.isascii() and begin.isprintable() else "bytes that are not text"
            fix = "move it away: resumed without it, the run makes its trials again"
            raise InputError(str(self.path), given, "the columns " + ",".join(self.columns.header), fix)
        trials: list[Trial] = []
        for line in lines[1:]:
            trial = self.columns.trial(line)
            if trial is None or trial.number != len(trials) + 1:
                break
            trials.append(trial)
        whole = b"".join(line + b"\n" for line in lines[: 1 + len(trials)])
        if len(trials) < len(lines[1:]) or (lines and not _NUMBERS.fullmatch(cut_off)):
            self._put_aside(data, intact=len(trials))
        if len(whole) < len(data):
            write_whole(self.path, whole)
        return trials

    def _put_aside(self, data: bytes, *, intact: int) -> None:
        """Keep a damaged file under another name, and say so."""
        names = (self.path.with_name(f"{self.path.stem}-damaged-{i}{self.path.suffix}") for i in itertools.count(1))
        aside = next(name for name in names if not name.exists())
        write_whole(aside, data)
        print(
            f"whiptool: {self.path}, line {intact + 2}: no trial as whiptool writes it; the {intact} before it are "
            f"kept, those after it are made again; the file as it was is {aside}",
            file=sys.stderr,
        )

    def append(self, trial: Trial) -> None:
        """Add one trial; it is written to the file when this returns."""
        new = not self.path.exists() or self.path.stat().st_size == 0
        append_whole(self.path, (_line(self.columns.header) if new else "") + self.columns.line(trial))


def _cells(part: str, value: Any, count: int) -> list[str]:
    """Return a part of an outcome as it stands in its columns; NaN where it has no value."""
    if part in ("status", "refused"):
        return [value or ""]
    if part == "hit":
        return [str(int(value))]
    if value is None or value == ():
        return ["nan"] * count
    numbers = dataclasses.astuple(value) if part == "arrival" else value if isinstance(value, tuple) else (value,)
    return ["nan" if x is None else repr(x) for x in numbers]


def _value(part: str, cells: list[str]) -> Any:
    """Return what `_cells` wrote; raise ValueError if it is not such a part."""
    if part == "status":
        return _STATUS[_STATUS.index(cells[0])]
    if part == "refused":
        return cells[0] or None
    numbers = tuple(map(number_in, cells))
    if part == "arrival":
        angle, speed, cost = numbers
        if cost < 0:
            raise ValueError(f"a cost of {cost}")
        return None if math.isnan(cost) else Arrival(_known(angle), speed, cost)
    if part == "values":
        return () if any(map(math.isnan, numbers)) else numbers
    if part in ("miss_error", "merit"):
        return _known(numbers[0])
    if part == "hit":
        return bool(("0", "1").index(cells[0]))
    return numbers if part in _VECTORS else numbers[0]


def _known(value: float) -> float | None:
    return None if math.isnan(value) else value


def _line(row: Sequence[object]) -> str:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerow(row)
    return text.getvalue()
