"""Run folders: configuration, results, and one process at a time that writes there."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Mapping
from contextlib import suppress
from datetime import datetime
from pathlib import Path
from types import TracebackType
from typing import Any

import tomli_w

from whiptool.errors import InputError, WhiptoolError
from whiptool.models.tables import read_toml
from whiptool.references import CITATIONS, citations, used_by
from whiptool.run_lock import LOCK, RunLock
from whiptool.version import __version__
from whiptool.whole_files import is_unfinished, remove_unfinished, write_whole

CONFIG, RESULT = "config.toml", "result.json"


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


def begun_by(config: Mapping[str, Any]) -> str:
    """Return ` with version X` for a run that another version of the code began, else nothing."""
    version = config.get("version")
    return "" if version == code_version() else f" with version {version}"


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
            raise InputError("run folder", str(path), f"a place that can be written ({error.strerror})") from None
    raise InputError("run folder", str(first), "fewer than 1000 runs a second")


class FolderTaken(InputError):
    """A folder in which a run is to begin holds something already."""

    def __init__(self, path: Path) -> None:
        super().__init__("run folder", str(path), "a folder that is new or empty")


class RunFolder:
    """A folder that holds one run, and is this process's alone until `close`.

    As a context manager it is closed in the end; a new one in which an error of whiptool's own left nothing but the
    configuration is removed, so that the corrected command finds the place free.

    Args:
        path: An existing folder.
        lock: Held on it.
        new: Whether this process made the run.
        on_interrupt: Note that an interruption gets, such as how to go on.
    """

    def __init__(self, path: Path, lock: RunLock, *, new: bool, on_interrupt: str = "") -> None:
        self.path, self._lock, self._new, self._on_interrupt = path, lock, new, on_interrupt

    @classmethod
    def create(cls, path: Path, config: Mapping, *, on_interrupt: str = "") -> RunFolder:
        """A new folder with its configuration.

        Raises:
            InputError: It cannot be written, is not empty, or another process writes in it.
        """
        path = Path(path)
        try:
            path.mkdir(parents=True, exist_ok=True)
            if not (path / LOCK).exists():
                _refuse_taken(path)  # before a lock is put into what may be anybody's folder
            lock = RunLock(path)
            try:
                _refuse_taken(path)
                write_whole(path / CONFIG, tomli_w.dumps(dict(config)))
            except BaseException:
                lock.release()
                raise
        except OSError as error:
            raise InputError("run folder", str(path), f"a folder that can be written ({error.strerror})") from None
        return cls(path, lock, new=True, on_interrupt=on_interrupt)

    @classmethod
    def open(cls, path: Path, *, on_interrupt: str = "") -> RunFolder:
        """A folder that `create` made; what a killed process had not finished writing is removed from it.

        Raises:
            InputError: It is not a run folder, cannot be written, or another process writes in it.
        """
        path = Path(path)
        read_config(path)
        try:
            lock = RunLock(path)
        except OSError as error:
            raise InputError("run folder", str(path), f"a folder that can be written ({error.strerror})") from None
        remove_unfinished(path)
        return cls(path, lock, new=False, on_interrupt=on_interrupt)

    @property
    def config(self) -> dict:
        """Return the configuration as it was resolved when the run began."""
        return read_config(self.path)

    def go_on_with(self, options: Mapping) -> None:
        """Write the run's options as they are given now, and remove the result that it ended with under others."""
        if options != self.config["options"]:
            write_whole(self.path / CONFIG, tomli_w.dumps({**self.config, "options": dict(options)}))
            (self.path / RESULT).unlink(missing_ok=True)

    def write_result(self, result: Mapping) -> None:
        """Write the result, and what to cite for it, each at once, so that no half of it is ever seen."""
        write_whole(self.path / CITATIONS, citations(*used_by(self.config, result)))
        write_whole(self.path / RESULT, json.dumps(result, indent=2, allow_nan=False) + "\n")

    def close(self) -> None:
        """Let other processes have the folder."""
        self._lock.release()

    def __enter__(self) -> RunFolder:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._on_interrupt and not isinstance(error, WhiptoolError | OSError | MemoryError | None):
            error.add_note(self._on_interrupt)
        refused = self._new and isinstance(error, WhiptoolError)
        if refused and {entry.name for entry in self.path.iterdir()} <= {CONFIG, LOCK}:
            (self.path / CONFIG).unlink()
            self.close()
            with suppress(OSError):  # it may be the working folder of a shell
                self.path.rmdir()
        self.close()


def check_new(path: Path) -> None:
    """Refuse a folder that `RunFolder.create` would refuse, and leave it as it is.

    Raises:
        InputError: It is not empty, or another process writes in it.
    """
    try:
        if (path / LOCK).exists():
            RunLock(path).release()
        if path.is_dir():
            _refuse_taken(path)
    except OSError as error:
        raise InputError("run folder", str(path), f"a folder that can be written ({error.strerror})") from None


def _refuse_taken(path: Path) -> None:
    """Refuse a folder that holds anything but what a process leaves that was killed before it wrote a configuration."""
    if any(entry.name != LOCK and not is_unfinished(entry) for entry in path.iterdir()):
        raise FolderTaken(path)


def config_of(path: Path, command: str) -> dict:
    """The resolved configuration of a run of a command, see `read_config`.

    Raises:
        InputError: The folder is of another command, or its configuration is damaged.
    """
    config = read_config(path)
    if config.get("command") != command or not isinstance(config.get("options"), dict):
        rule = f"a folder that `whiptool {command}` made, with a complete configuration"
        raise InputError("run_folder", str(path), rule)
    return config


def read_config(path: Path) -> dict:
    """The resolved configuration of a run, whoever writes in its folder.

    Raises:
        InputError: It is not a run folder, or its configuration is damaged.
    """
    if not (path / CONFIG).is_file():
        raise InputError("run folder", str(path), f"a run folder (it has no {CONFIG})")

    return read_toml(path / CONFIG)
