"""How a strike ends that is not carried out, and the lock that a stop leaves: a person opens it, and nothing else."""

from __future__ import annotations

import itertools
import json
import sys
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from whiptool.errors import InputError, WhiptoolError
from whiptool.whole_files import write_whole

STOPPED = "stopped.json"  # in a run folder


class SafetyError(WhiptoolError):
    """The arm must not move, or must stop; `kind` names the cause in one word."""

    def __init__(self, kind: str, message: str) -> None:
        super().__init__(f"{kind}: {message}")
        self.kind = kind


class StrikeRefused(InputError):
    """A strike that must not be made; nothing was armed, and another strike may be asked for."""


class NotConfirmed(InputError):
    """A person did not say that the arm may move; nothing was armed, and the session is over."""

    def __init__(self, strike: Sequence[float]) -> None:
        super().__init__("strike", strike, "one that was confirmed")
        self.args = ("not confirmed; nothing was armed",)

    def renamed(self, name: str, fix: str = "") -> InputError:
        """The same error: no option is at fault."""
        return self


class StrikeStopped(WhiptoolError):
    """A strike that was interrupted by a fault, or whose film was lost: it does not count as a trial, and the session
    is over.

    Args:
        reason: Why.
        struck: Result of the strike, for the records; None: the port keeps none.
        torque: State of the motors, in words.
    """

    def __init__(self, reason: str, struck: Any = None, torque: str = "") -> None:
        self.reason, self.struck, self.torque = reason, struck, torque
        super().__init__("; ".join(part for part in (f"the strike was stopped: {reason}", torque) if part))


class StrikeInterrupted(KeyboardInterrupt):
    """A strike during which a signal came (Ctrl-C, SIGTERM or SIGHUP): it does not count as a trial, and the session is
    over.

    Args:
        reason: The signal.
        struck: Result of the strike, for the records.
        torque: State of the motors, in words.
    """

    def __init__(self, reason: str, struck: Any, torque: str) -> None:
        self.reason, self.struck, self.torque = reason, struck, torque
        super().__init__(reason)
        self.add_note(torque)


class Locked(WhiptoolError):
    """The arm was stopped before, and no person has released it."""


def torque_in_words(confirmed: bool, silent: Sequence[int] = ()) -> str:
    """Say whether torque is off, and what to do if it may not be.

    Args:
        confirmed: Whether every servo said that its torque is off.
        silent: Ids of the servos that did not.
    """
    if confirmed:
        return "torque is off"
    which = f"servo {' and '.join(map(str, silent))}" if silent else "a servo"
    return f"TORQUE MAY STILL BE ON: CUT THE POWER ({which} did not confirm that it is off)"


class Interlock:
    """Keeps the servos from being armed after a stop, until a person has released them.

    A fault also leaves a mark in files, so that later calls know of it. A signal leaves none: it came from a person.

    Attributes:
        stop: Why the arm was stopped; None: it was not, or it was released.
        torque_off: Whether every servo has confirmed that its torque is off; None: nothing was armed.
        torque: The same in words, as a message tells it.
    """

    def __init__(self) -> None:
        self.stop: str | None = None
        self.torque_off: bool | None = None
        self.torque = "nothing was armed"
        self._marks: list[Path] = []

    def watch(self, mark: Path) -> None:
        """Leave a mark in this file after a fault; a mark that it has is one of an earlier call."""
        if mark not in self._marks:
            self._marks.append(mark)
        if mark.exists():
            self.stop = self.stop or _read(mark)

    def trip(self, reason: str, *, lasting: bool = True, torque: str = "") -> None:
        """Lock, and leave a mark in the files; it does not raise, since torque goes off after it.

        Args:
            reason: Why the arm was stopped; the first reason is kept.
            lasting: Whether later calls are to know of it.
            torque: State of the motors, in words.
        """
        self.stop = self.stop or reason
        if not lasting:
            return
        record = {"reason": self.stop, "torque": torque, "time": time.strftime("%Y-%m-%dT%H:%M:%S%z")}
        for mark in self._marks:
            try:
                mark.parent.mkdir(parents=True, exist_ok=True)
                write_whole(mark, json.dumps(record, indent=1) + "\n")
            except OSError as error:
                print(
                    f"whiptool: {mark}, which says that the arm was stopped, cannot be written: {error}",
                    file=sys.stderr,
                )

    def check(self) -> None:
        """Refuse to go on after a stop.

        Raises:
            Locked: The arm was stopped, and not released.
        """
        if self.stop is not None:
            raise Locked(
                f"nothing is armed: the arm was stopped ({self.stop}), and no person has said that the cause is gone; "
                "the next call with --resume or with this --port asks, from Python release() of the interlock says it"
            )

    def release(self) -> None:
        """Let the servos be armed again: a person has found the cause of the stop, and everybody is away.

        The marks are renamed with a number, so that a record of what happened remains.
        """
        self.stop = None
        for mark in self._marks:
            names = (mark.with_name(f"{mark.stem}-{i}{mark.suffix}") for i in itertools.count(1))
            with suppress(FileNotFoundError):
                mark.rename(next(name for name in names if not name.exists()))


def _read(mark: Path) -> str:
    """The reason that a mark tells; one that cannot be read is a stop, too."""
    try:
        return str(json.loads(mark.read_text(encoding="utf-8"))["reason"])
    except (OSError, ValueError, KeyError, TypeError):
        return f"{mark} cannot be read"
