"""The trials of a run as they happen; what a killed search needs to go on."""

from __future__ import annotations

import csv
import io
import itertools
import math
import re
import sys
from collections.abc import Sequence
from pathlib import Path

from whiptool.errors import InputError
from whiptool.models.planar_arm import AnyArm
from whiptool.models.strike import strike_names
from whiptool.objective import RIG, Arrival, Outcome, Trial
from whiptool.whole_files import append_whole, write_whole

TRIALS = "trials.csv"
_STATUS = ("hit", "miss", "refused", "unseen", "diverged")
_NUMBERS = re.compile(rb"[-+.,0-9a-z]*")  # and nan, inf: what a kill in the middle of a line leaves


class TrialLog:
    """The trials of a run as CSV, one line written and flushed per trial, numbers at full precision.

    Args:
        path: The file; made with its header if it is not there.
        arm: Names the columns.
        names: Names of a strike's numbers; default: those of the arm's joints.
        measured: Miss distances were measured, and have a column of standard errors, NaN where unknown.
        arriving: The target asks for a direction or a speed: there are columns of how the tip arrived, NaN where a
            strike was lost, and of the cost.
        limited: The objective has limits, or takes strikes of the hand: there is a column of what refused a strike,
            empty where nothing did.
        criteria: Names of what hits are judged by: there is a column of each, NaN where a strike was lost, and one of
            the merit, NaN where it is not a hit.
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
        self.path, self.n, self.dimension = path, arm.n, arm.dimension
        self.measured, self.arriving, self.limited, self.criteria = measured, arriving, limited, tuple(criteria)
        axes = "xyz"[: self.dimension]
        self._names = strike_names(arm) if names is None else tuple(names)
        self._header = [
            "trial",
            *self._names,
            "miss_distance",
            "hit",
            "time",
            *(f"tip_{axis}" for axis in axes),
            *(f"tip_velocity_{axis}" for axis in axes),
            *(f"max_joint_speed_{joint}" for joint in arm.joints),
            *(f"max_torque_{joint}" for joint in arm.joints),
            *(["miss_error"] if measured else []),
            *(["arrival_angle", "arrival_speed", "cost"] if arriving else []),
            *([*self.criteria, "merit"] if self.criteria else []),
            "status",
            *(["refused"] if limited else []),
        ]

    def read(self) -> list[Trial]:
        """All trials up to the first line that is damaged.

        A last line that was cut off is removed from the file. Where more is damaged, the file is first renamed,
        with one line on stderr.

        Raises:
            InputError: The file is not of this arm, or its first line is damaged.
        """
        if not self.path.exists():
            return []
        data = self.path.read_bytes()
        *lines, cut_off = data.split(b"\n")
        header = _line(self._header).encode()
        if not header.startswith(b"".join(line + b"\n" for line in lines[:1]) or cut_off):
            given = data[:80].decode("utf-8", "backslashreplace")
            fix = "move it away: resumed without it, the run makes its trials again"
            raise InputError(str(self.path), given, "the columns " + ",".join(self._header), fix)
        trials: list[Trial] = []
        for line in lines[1:]:
            trial = self._trial(line)
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
        """Add one trial; it is in the file when this returns."""
        o = trial.outcome
        row = [
            trial.number,
            *map(repr, trial.strike),
            repr(o.miss_distance),
            int(o.hit),
            repr(o.time),
            *map(repr, o.tip),
            *map(repr, o.tip_velocity),
            *map(repr, o.max_joint_speed),
            *map(repr, o.max_torque),
            *([repr(_or_nan(o.miss_error))] if self.measured else []),
            *(map(repr, _arrival_columns(o.arrival)) if self.arriving else []),
            *(
                [*map(repr, o.values or [math.nan] * len(self.criteria)), repr(_or_nan(o.merit))]
                if self.criteria
                else []
            ),
            o.status,
            *([o.refused or ""] if self.limited else []),
        ]
        new = not self.path.exists() or self.path.stat().st_size == 0
        append_whole(self.path, (_line(self._header) if new else "") + _line(row))

    def _trial(self, line: bytes) -> Trial | None:
        """The trial in a line; None where it holds none."""
        row = line.decode("utf-8", "replace").split(",")
        if len(row) != len(self._header):
            return None
        refused = (row.pop() or None) if self.limited else None
        status = row.pop()
        if status not in _STATUS:
            return None
        if status == "refused" and not self.limited:
            refused = RIG
        n, d, start = self.n, self.dimension, 1 + len(self._names)
        try:
            number, numbers = int(row[0]), [float(x) for x in row]
        except ValueError:
            return None
        rest = iter(numbers[start:])
        distance, hit, time = itertools.islice(rest, 3)
        tip, velocity, speeds, torques = (tuple(itertools.islice(rest, count)) for count in (d, d, n, n))
        error = _known(next(rest)) if self.measured else None
        arrival = _arrival(*itertools.islice(rest, 3)) if self.arriving else None
        values = tuple(itertools.islice(rest, len(self.criteria)))
        merit = _known(next(rest)) if self.criteria else None
        judged = () if any(map(math.isnan, values)) else values
        outcome = Outcome(
            distance,
            bool(hit),
            time,
            tip,
            velocity,
            speeds,
            torques,
            status == "diverged",
            error,
            arrival,
            judged,
            merit,
            refused,
            status == "unseen",
        )
        return Trial(number, tuple(numbers[1:start]), outcome)


def _or_nan(value: float | None) -> float:
    return math.nan if value is None else value


def _known(value: float) -> float | None:
    return None if math.isnan(value) else value


def _arrival_columns(arrival: Arrival | None) -> tuple[float, float, float]:
    """Angle, speed and cost as they stand in the file: NaN where it has no value."""
    return (math.nan, math.nan, math.nan) if arrival is None else (_or_nan(arrival.angle), arrival.speed, arrival.cost)


def _arrival(angle: float, speed: float, cost: float) -> Arrival | None:
    """What `_arrival_columns` wrote."""
    return None if math.isnan(cost) else Arrival(_known(angle), speed, cost)


def _line(row: Sequence[object]) -> str:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerow(row)
    return text.getvalue()
