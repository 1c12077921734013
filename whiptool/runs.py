"""Run folders: configuration, trials as they happen, results; what a killed run needs to go on."""

from __future__ import annotations

import csv
import io
import json
import os
import subprocess
from collections.abc import Mapping
from datetime import datetime
from pathlib import Path

import tomli_w

from whiptool import __version__
from whiptool.errors import InputError
from whiptool.models.files import read_toml
from whiptool.models.parameters import ArmParameters
from whiptool.objective import Outcome, Trial
from whiptool.strike import strike_names

CONFIG, TRIALS, RESULT = "config.toml", "trials.csv", "result.json"


def code_version() -> str:
    """The package's version, with the commit where the code is a git checkout."""
    folder = Path(__file__).resolve().parent
    if not (folder.parent / ".git").exists():
        return __version__
    command = ["git", "-C", str(folder), "describe", "--always", "--dirty"]
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=10)
    except (OSError, subprocess.SubprocessError):
        return __version__
    return f"{__version__}+{done.stdout.strip()}"


def default_folder(name: str) -> Path:
    """A new folder `runs/NAME-DATE-TIME` below the current one; a number is added where another run has it.

    Raises:
        InputError: It cannot be made.
    """
    first = Path("runs") / f"{name}-{datetime.now():%Y%m%d-%H%M%S}"
    for number in range(1, 1000):
        path = first if number == 1 else first.with_name(f"{first.name}-{number}")
        try:
            path.mkdir(parents=True)
            return path
        except FileExistsError:
            continue
        except OSError as error:
            raise InputError(
                "run folder", str(path), f"a place that can be written ({error.strerror})", "give --out"
            ) from None
    raise InputError("run folder", str(first), "fewer than 1000 runs a second")


class RunFolder:
    """A folder that holds one run.

    Args:
        path: An existing folder, made by `create`.
    """

    def __init__(self, path: Path) -> None:
        self.path = path

    @classmethod
    def create(cls, path: Path, config: Mapping) -> RunFolder:
        """A new folder with its configuration.

        Raises:
            InputError: It cannot be written, or is not empty.
        """
        path = Path(path)
        try:
            path.mkdir(parents=True, exist_ok=True)
            if any(path.iterdir()):
                raise InputError(
                    "--out", str(path), "a folder that is new or empty", "to go on with a killed run, give --resume"
                )
            write_whole(path / CONFIG, tomli_w.dumps(dict(config)))
        except OSError as error:
            raise InputError("--out", str(path), f"a folder that can be written ({error.strerror})") from None
        return cls(path)

    @classmethod
    def open(cls, path: Path) -> RunFolder:
        """A folder that `create` made.

        Raises:
            InputError: It is not a run folder, or cannot be written.
        """
        path = Path(path)
        if not (path / CONFIG).is_file():
            raise InputError("--resume", str(path), f"a run folder (it has no {CONFIG})")
        if not all(os.access(p, os.W_OK) for p in (path, path / CONFIG)):
            raise InputError("--resume", str(path), "a folder that can be written")
        return cls(path)

    @property
    def config(self) -> dict:
        """The resolved configuration."""
        return read_toml(self.path / CONFIG)

    def write_result(self, result: Mapping) -> None:
        """Write the result at once, so that no half of it is ever seen."""
        write_whole(self.path / RESULT, json.dumps(result, indent=2, allow_nan=False) + "\n")


def write_whole(path: Path, content: str | bytes) -> None:
    """Write a file so that no half of it is ever seen; where it cannot be written, what was there before stays.

    Raises:
        OSError: The disk is full, or the like; it names the file.
    """
    temporary = path.with_name(f".{path.name}.tmp")
    try:
        temporary.write_bytes(content.encode("utf-8") if isinstance(content, str) else content)
        temporary.replace(path)
    except OSError as error:
        temporary.unlink(missing_ok=True)
        raise OSError(error.errno, error.strerror, str(path)) from error


class TrialLog:
    """The trials of a run as CSV, one line written and flushed per trial, numbers at full precision.

    Args:
        path: The file; made with its header if it is not there.
        arm: Names the columns.
    """

    def __init__(self, path: Path, arm: ArmParameters) -> None:
        self.path, self.n = path, arm.n
        self._names = strike_names(arm)
        self._header = [
            "trial",
            *self._names,
            "miss_distance",
            "hit",
            "time",
            "tip_x",
            "tip_y",
            "tip_velocity_x",
            "tip_velocity_y",
            *(f"max_joint_speed_{joint}" for joint in arm.joints),
            *(f"max_torque_{joint}" for joint in arm.joints),
            "diverged",
        ]

    def read(self) -> list[Trial]:
        """All whole lines; a last line that was cut off is removed from the file.

        Raises:
            InputError: The file is not of this arm, or is damaged.
        """
        if not self.path.exists():
            return []
        data = self.path.read_bytes()
        whole = data[: data.rfind(b"\n") + 1]
        if len(whole) < len(data):
            with self.path.open("r+b") as file:
                file.truncate(len(whole))
        rows = list(csv.reader(io.StringIO(whole.decode("utf-8", "replace"))))
        if not rows:
            return []
        if rows[0] != self._header:
            raise InputError(str(self.path), ",".join(rows[0])[:80], "the columns " + ",".join(self._header))
        trials = []
        for number, row in enumerate(rows[1:], start=1):
            try:
                trials.append(self._trial(row))
                assert trials[-1].number == number
            except (ValueError, IndexError, AssertionError):
                raise InputError(
                    f"{self.path}, line {number + 1}",
                    ",".join(row)[:80],
                    "a trial as whiptool writes it",
                    "delete this line and those after it to resume before it",
                ) from None
        return trials

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
            int(o.diverged),
        ]
        new = not self.path.exists() or self.path.stat().st_size == 0
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerows([self._header, row] if new else [row])
        with self.path.open("a", encoding="utf-8") as file:
            file.write(text.getvalue())

    def _trial(self, row: list[str]) -> Trial:
        if len(row) != len(self._header):
            raise ValueError("columns")
        n, start = self.n, 1 + len(self._names)
        numbers = [float(x) for x in row]
        distance, hit, time = numbers[start : start + 3]
        tip, velocity, speeds, torques = (
            tuple(numbers[start + first : start + first + count])
            for first, count in ((3, 2), (5, 2), (7, n), (7 + n, n))
        )
        outcome = Outcome(distance, bool(hit), time, tip, velocity, speeds, torques, bool(numbers[-1]))
        return Trial(int(row[0]), tuple(numbers[1:start]), outcome)
