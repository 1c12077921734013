"""Run folders: configuration, results, and a lock, so that only one process at a time writes."""

from __future__ import annotations

import json
import os
import shlex
import socket
import subprocess
import sys
from collections.abc import Iterator, Mapping
from contextlib import suppress
from datetime import datetime
from pathlib import Path
from types import TracebackType
from typing import Any

import tomli_w
from filelock import FileLock, Timeout

from whiptool.errors import InputError, WhiptoolError, expect
from whiptool.given_files import read_toml
from whiptool.version import __version__
from whiptool.whole_files import is_unfinished, remove_unfinished, write_whole
from whiptool.words import method_name

CITATIONS = "citations.bib"  # in a run folder
ALWAYS = ("wang2024", "todorov2012", "andersson2019", "carpentier2019")  # the framework and the two simulators
WORKS: dict[str, tuple[str, ...]] = {  # keys of the entries in references.bib by what they are the source of
    "lemon2024": (),
    **dict.fromkeys(("nah2020", "nah2020-n10", "nah2020-n15", "nah2020-n20", "nah2020-fitted"), ("nah2020",)),
    "nah2023": ("nah2023",),
    "ur5e": ("menagerie2022",),
    "panda": (),
    "fr3": (),
    "oiac": ("xiong2021",),
    "constant": ("hogan1985",),
    "position": (),
    "directl": ("gablonsky2001", "johnson2007"),
    "gradient": ("kraft1988", "johnson2007"),
    "nlopt": ("johnson2007",),
    "map": (),
    "pareto": ("haimes1971", "kraft1988", "johnson2007"),
    "cmaes": ("hansen2001", "nomura2024"),
    "ga": ("blank2020",),
    "sac": ("haarnoja2018",),
    "td3": ("fujimoto2018",),
    "ddpg": ("lillicrap2016",),
    "ppo": ("schulman2017",),
    "random": (),
    "human": ("krotov2022",),
}


def citations(*names: str) -> str:
    """Return the BibTeX entries of the works to cite, for a bibliography.

    Args:
        names: Names of the used parts: presets (`ur5e`), control laws (`oiac`), search methods and learners (`cmaes`,
            `nlopt:GN_CRS2_LM`), `pareto`, or `human` for the data of Krotov et al. 2022. The works on the framework and
            on the simulators are always included.

    Raises:
        InputError: A name is unknown; the message lists the names.
    """
    keys = list(ALWAYS)
    for name in names:
        expect(str, name=name)
        own = _own(name)
        if own not in WORKS:
            raise InputError("name", name, ", ".join(WORKS))
        keys += WORKS[own]
    entries = _entries()
    return "\n\n".join(entries[key] for key in dict.fromkeys(keys)) + "\n"


def used_by(config: Mapping, result: Mapping) -> Iterator[str]:
    """Yield, from a run's configuration and result, the names of its parts that should be cited."""
    options = config.get("options", {})
    law, model = config.get("controller", {}).get("law"), config.get("model", {}).get("name")
    methods = (options.get("method"), result.get("method"), *options.get("methods", []))
    for name in (config.get("command"), model, options.get("arm"), law, *methods):
        if isinstance(name, str) and _own(name) in WORKS:
            yield name


def _own(name: str) -> str:
    return "nlopt" if name.startswith("nlopt:") else name if name in WORKS else method_name(name)


def _entries() -> dict[str, str]:
    """Return the entries of `references.bib` by key."""
    texts = (Path(__file__).parent / "references.bib").read_text(encoding="utf-8").strip().split("\n\n")
    return {text[text.index("{") + 1 : text.index(",")]: text for text in texts}


CONFIG, RESULT, LOCK = "config.toml", "result.json", ".lock"
_PARTS = ("version", "command", "options", "model", "controller", "bounds", "settings", "free", "recordings")


def code_version() -> str:
    """Return the package's version, with the commit if the code is a git checkout."""
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
    """Return ` with version X` for a run that another version of the code began, else an empty text."""
    version = config.get("version")
    return "" if version == code_version() else f" with version {version}"


def default_folder(name: str) -> Path:
    """Create and return a folder `runs/NAME-DATE-TIME` in the current folder, with a number added if it exists.

    Raises:
        InputError: The folder cannot be created.
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
    """The folder for a new run is not empty."""

    def __init__(self, path: Path) -> None:
        super().__init__("run folder", str(path), "a folder that is new or empty")


class RunFolder:
    """The folder of one run, locked for this process until `close`.

    As a context manager it closes itself at the end. If a whiptool error leaves a new folder with only the
    configuration, it is removed, so that the corrected command can use the same name.

    Args:
        path: An existing folder.
        lock: Lock on the folder.
        new: Whether this process created the run.
        on_interrupt: Text that is added to an interruption's message, such as how to resume.
    """

    def __init__(self, path: Path, lock: RunLock, *, new: bool, on_interrupt: str = "") -> None:
        self.path, self._lock, self._new, self._on_interrupt = path, lock, new, on_interrupt

    @classmethod
    def create(cls, path: Path, config: Mapping, *, on_interrupt: str = "") -> RunFolder:
        """Create a folder with a configuration.

        Raises:
            InputError: The folder cannot be written, is not empty, or another process writes in it.
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
            raise InputError(
                "run folder", str(path), "a folder that can be written", f"reason: {error.strerror}"
            ) from None
        return cls(path, lock, new=True, on_interrupt=on_interrupt)

    @classmethod
    def open(cls, path: Path, *, on_interrupt: str = "") -> RunFolder:
        """Open a folder that `create` made; incomplete files of a killed process are removed.

        Raises:
            InputError: The folder is not a run folder, cannot be written, or another process writes in it.
        """
        path = Path(path)
        read_config(path)
        try:
            lock = RunLock(path)
        except OSError as error:
            raise InputError(
                "run folder", str(path), "a folder that can be written", f"reason: {error.strerror}"
            ) from None
        remove_unfinished(path)
        return cls(path, lock, new=False, on_interrupt=on_interrupt)

    @property
    def config(self) -> dict:
        """Return the configuration with which the run was started."""
        return read_config(self.path)

    def go_on_with(self, options: Mapping) -> None:
        """Store changed options of a resumed run, and remove the result of its previous options."""
        if options != self.config["options"]:
            write_whole(self.path / CONFIG, tomli_w.dumps({**self.config, "options": dict(options)}))
            (self.path / RESULT).unlink(missing_ok=True)

    def write_result(self, result: Mapping) -> None:
        """Write `result.json` (JSON data without NaN) and `citations.bib`; neither is ever incomplete."""
        write_whole(self.path / CITATIONS, citations(*used_by(self.config, result)))
        write_whole(self.path / RESULT, json.dumps(result, indent=2, allow_nan=False) + "\n")

    def close(self) -> None:
        """Release the folder for other processes."""
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
    """Refuse a folder that `RunFolder.create` would refuse, without changing it.

    Raises:
        InputError: The folder is not empty, or another process writes in it.
    """
    try:
        if (path / LOCK).exists():
            RunLock(path).release()
        if path.is_dir():
            _refuse_taken(path)
    except OSError as error:
        raise InputError("run folder", str(path), "a folder that can be written", f"reason: {error.strerror}") from None


def _refuse_taken(path: Path) -> None:
    """Refuse a folder that holds anything but what a process leaves that was killed before it wrote a configuration."""
    if any(entry.name != LOCK and not is_unfinished(entry) for entry in path.iterdir()):
        raise FolderTaken(path)


def config_of(path: Path, command: str) -> dict:
    """Return the configuration that a command stored in its run folder: all its options with their values, and such
    parts as the model.

    Raises:
        InputError: The folder is of another command, or its configuration is damaged.
    """
    config = read_config(path)
    if config.get("command") != command or not isinstance(config.get("options"), dict):
        rule = f"a folder that `whiptool {command}` made, with a complete configuration"
        raise InputError("run_folder", str(path), rule)
    return config


def read_config(path: Path) -> dict:
    """Return the table in a run folder's `config.toml`, even if another process writes in the folder.

    Raises:
        InputError: The folder is not a run folder, or its configuration is damaged.
    """
    if not (path / CONFIG).is_file():
        raise InputError("run folder", str(path), f"a run folder (it has no {CONFIG})")

    table = read_toml(path / CONFIG)
    for part in (part for part in table if part not in _PARTS):
        raise InputError(f"{path / CONFIG}: {part}", table[part], f"only {', '.join(_PARTS)}", "remove it")
    return table


_FREE = "a folder that no other command works in"


class RunLock:
    """A lock of the operating system on a file, held until `release` or the end of the process.

    The file names its holder. The lock of a killed process is free.

    Args:
        folder: An existing folder.
        file: Name of the file in it.
        what, rule: What is locked and what has to be true of it, for messages.

    Raises:
        InputError: Another process holds the lock; it is named.
        OSError: The file cannot be written.
    """

    def __init__(self, folder: Path, file: str = LOCK, what: str = "run folder", rule: str = _FREE) -> None:
        self.path = path = folder / file
        self._lock = FileLock(path, timeout=0, thread_local=False)
        try:
            self._lock.acquire()
        except Timeout:
            raise InputError(what, str(folder if file == LOCK else path), rule, _said(path)) from None

        holder = {
            "process": os.getpid(),
            "host": socket.gethostname(),
            "since": f"{datetime.now():%Y-%m-%d %H:%M:%S}",
            "command": shlex.join(sys.argv),
        }
        try:
            self.path.write_text(json.dumps(holder) + "\n", encoding="utf-8")  # in place: this very file is locked
        except OSError:
            self.release()
            raise

    def release(self) -> None:
        """Release the lock; the file is removed before, so that no other process's file is removed."""
        if self._lock.is_locked:
            self.path.unlink(missing_ok=True)
            self._lock.release()


def _said(path: Path) -> str:
    """What a lock file says of its holder."""
    try:
        holder = json.loads(path.read_text(encoding="utf-8"))
        return f"process {holder['process']} on {holder['host']} does since {holder['since']}: {holder['command']}"
    except (OSError, ValueError, KeyError, TypeError):
        return "another process does"  # it has the lock, and has not said so yet
