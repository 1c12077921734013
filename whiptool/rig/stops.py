"""Errors of strikes that are refused or stopped, and the interlock after a stop, which only a person can release."""

from __future__ import annotations

import itertools
import json
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any

from whiptool.errors import InputError, WhiptoolError
from whiptool.runs import RunLock
from whiptool.whole_files import write_whole

STOPPED = "stopped.json"  # in a run folder
UNENDED = "a program was moving it, and was killed, or still runs"  # what a mark says from before a motion to its end


class SafetyError(WhiptoolError):
    """The arm must not move, or must stop; `kind` names the cause in one word."""

    def __init__(self, kind: str, message: str) -> None:
        super().__init__(f"{kind}: {message}")
        self.kind = kind


class StrikeRefused(InputError):
    """A strike must not be made; nothing was armed, and another strike may be tried."""


class NotConfirmed(InputError):
    """A person did not confirm what was asked; nothing moved, and the session ends.

    Args:
        outcome: What was not done.
    """

    def __init__(self, outcome: str = "nothing was armed") -> None:
        super().__init__("answer", "another answer", "yes")
        self.args = (f"not confirmed; {outcome}",)

    def renamed(self, name: str, fix: str = "") -> InputError:
        """Return the error unchanged: no option of the command is its cause, so that none is named."""
        return self


class StrikeStopped(WhiptoolError):
    """A fault interrupted a strike, or its film was lost; it does not count as a trial, and the session ends.

    Args:
        reason: Reason of the stop.
        struck: Partial result of the strike; None without a result.
        torque: State of the motors, as text.
    """

    def __init__(self, reason: str, struck: Any = None, torque: str = "") -> None:
        self.reason, self.struck, self.torque = reason, struck, torque
        super().__init__("; ".join(part for part in (f"the strike was stopped: {reason}", torque) if part))


class StrikeInterrupted(KeyboardInterrupt):
    """A signal (Ctrl-C, SIGTERM or SIGHUP) came during a strike; it does not count as a trial, and the session ends.

    Args:
        reason: The signal.
        struck: Result of the strike, which may be partial.
        torque: State of the motors, as text.
    """

    def __init__(self, reason: str, struck: Any, torque: str) -> None:
        self.reason, self.struck, self.torque = reason, struck, torque
        super().__init__(reason)
        self.add_note(torque)


class Locked(WhiptoolError):
    """The arm was stopped before, and no person has released it."""


def torque_in_words(confirmed: bool, silent: Sequence[int] = ()) -> str:
    """Return a text on whether torque is off, with instructions if it may be on.

    Args:
        confirmed: Whether every servo confirmed that its torque is off.
        silent: Ids of the servos that did not confirm.
    """
    if confirmed:
        return "torque is off"
    which = f"servo {' and '.join(map(str, silent))}" if silent else "a servo"
    return f"TORQUE MAY STILL BE ON: CUT THE POWER ({which} did not confirm that it is off)"


class Interlock:
    """Prevents arming of the servos after a stop until a person has released it.

    A fault is also recorded in files, which later calls read; a signal is not recorded, as it came from a person. The
    files are written before a motion and removed after its orderly end, so that a killed program leaves them. One
    program at a time reads, writes and removes them: who connects to the arm holds their locks until it leaves the arm.

    Attributes:
        stop: Reason why the arm was stopped; None: it was not stopped, or was released.
        torque_off: Whether every servo has confirmed that its torque is off; None: nothing was armed.
        torque: State of the motors as text.
    """

    def __init__(self) -> None:
        self.stop: str | None = None
        self.torque_off: bool | None = None
        self.torque = "nothing was armed"
        self._marks: list[Path] = []
        self._elsewhere: list[Path] = []  # files of the same stop, which other calls watched
        self._recorded = False  # a fault of the present motion, in the files
        self._holds = 0  # how many blocks hold the locks

    def watch(self, mark: Path) -> None:
        """Record faults in the file `mark`; if it exists, a fault of an earlier call is taken from it."""
        if mark not in self._marks:
            self._marks.append(mark)
        if mark.exists():
            reason, files = _read(mark)
            self.stop = self.stop or reason
            self._elsewhere += [file for file in files if file.name == STOPPED]

    @contextmanager
    def held(self) -> Iterator[None]:
        """Hold the locks of the arm's files in a `with` block, at whose beginning the files are read again. Files in
        run folders have the folders' locks.

        Raises:
            InputError: Another program holds a lock, or a file's folder cannot be written.
        """
        with ExitStack() as stack:
            for mark in [] if self._holds else self._marks:
                if mark.name != STOPPED:
                    stack.callback(_lock(mark).release)
                self.watch(mark)
            self._holds += 1
            stack.callback(setattr, self, "_holds", self._holds - 1)
            yield

    def trip(self, reason: str, *, lasting: bool = True, torque: str = "") -> None:
        """Lock, and record the stop in the files. No exception is raised, because torque is switched off afterwards.

        Args:
            reason: Reason why the arm was stopped; the first reason is kept.
            lasting: Whether the stop is recorded for later calls.
            torque: State of the motors, as text.
        """
        self.stop = self.stop or reason
        if lasting:
            self._recorded = True
            self._record(self.stop, torque)

    @contextmanager
    def moving(self) -> Iterator[None]:
        """Keep the files while the arm may move in a `with` block; afterwards they remain only if a fault was recorded.

        A later call that finds them after this program was killed asks a person, as after a fault.

        Raises:
            Locked: The arm was stopped, and not released.
            InputError: Another program uses the arm, or a file cannot be written; nothing may move.
        """
        with self.held():
            self.check()
            self._recorded = False
            try:
                self._record(UNENDED, self.torque, needed=True)
                yield
            finally:
                if not self._recorded:
                    for mark in self._marks:
                        with suppress(OSError):
                            mark.unlink()

    def _record(self, reason: str, torque: str, *, needed: bool = False) -> None:
        """Write the files; one that cannot be written is said, or refused where it is needed."""
        record: dict[str, Any] = {"reason": reason, "torque": torque, "time": time.strftime("%Y-%m-%dT%H:%M:%S%z")}
        record["files"] = [str(mark.absolute()) for mark in self._marks]
        for mark in self._marks:
            try:
                mark.parent.mkdir(parents=True, exist_ok=True)
                write_whole(mark, json.dumps(record, indent=1) + "\n")
            except OSError as error:
                said = f"{mark}, which says that the arm was stopped, cannot be written: {error}"
                if needed:
                    raise InputError(
                        "file", str(mark), "a file that can be written", f"nothing moved; {said}"
                    ) from None
                print(f"whiptool: {said}", file=sys.stderr)

    def check(self) -> None:
        """Refuse to continue after a stop.

        Raises:
            Locked: The arm was stopped, and not released.
        """
        if self.stop is not None:
            raise Locked(
                f"nothing is armed: the arm was stopped ({self.stop}), and no person has said that the cause is gone; "
                "the next command for this arm asks a person; in Python, `interlock.release()` says it"
            )

    def release(self) -> None:
        """Allow arming again: a person has removed the cause of the stop, and no one is near the arm.

        The files that record the stop, also those in the folders of other runs, are renamed with a number and kept.

        Raises:
            InputError: Another program uses the arm.
        """
        with self.held():
            self.stop = None
            for mark in (*self._marks, *self._elsewhere):
                names = (mark.with_name(f"{mark.stem}-{i}{mark.suffix}") for i in itertools.count(1))
                with suppress(FileNotFoundError, NotADirectoryError):
                    mark.rename(next(name for name in names if not name.exists()))


def _lock(mark: Path) -> RunLock:
    """The lock of an arm's file."""
    try:
        mark.parent.mkdir(parents=True, exist_ok=True)
        return RunLock(mark.parent, mark.stem + ".lock", "lock of the arm", "an arm that no other command uses")
    except OSError as error:
        raise InputError("lock of the arm", mark.stem, "a file that can be written for its lock", str(error)) from None


def _read(mark: Path) -> tuple[str, list[Path]]:
    """The reason that a mark tells, and all files that tell it; a mark that cannot be read is a stop, too."""
    try:
        record = json.loads(mark.read_text(encoding="utf-8"))
        return str(record["reason"]), [Path(file) for file in record.get("files", [])]
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return f"{mark} cannot be read", []
