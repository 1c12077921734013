"""Ctrl-C and SIGTERM during a command: the first signal makes it save its state, a second ends it at once."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable
from types import FrameType
from typing import Any

from whiptool.rig.stop_signals import Listener

INTERRUPTED = 130  # exit status, of either signal
TOGETHER = 0.5  # [s] signals of one kind within this time are one: `timeout` tells a process, and then its group
_SIGNALS = (signal.SIGINT, signal.SIGTERM)
_state: list[Callable[[], str]] = []  # of the command that runs


def tell_when_interrupted(state: Callable[[], str]) -> None:
    """Set a function whose text is added to the command's last line if a signal ends it, such as whether torque is
    off."""
    _state[:] = [state]


def with_state(said: str) -> str:
    """Return the last line of an interrupted command with the texts of `tell_when_interrupted` added, each once."""
    return "; ".join([said, *(state for tell in _state if (state := tell()) not in said)])


class Interruptions(Listener):
    """Signal handlers of a command, installed within a `with` block.

    The first signal raises KeyboardInterrupt. A second one, while the command saves and ends, ends the process at once;
    an exception would interrupt the clean-up with a traceback. Signals of the same kind that arrive together with the
    first count as one. While servos may be on, the handlers of `whiptool.rig.stop_signals` replace these, so that
    torque-off is completed; they call `note`.

    Args:
        clock: Returns the present time [s].
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock, self._over = clock, False
        self._first: tuple[int, float] | None = None  # which signal, and when
        self._before: dict[int, Any] = {}

    @property
    def came(self) -> bool:
        """Whether a signal has come."""
        return self._first is not None

    def note(self, number: int) -> None:
        """Record a signal that has already interrupted the command, so that the next one counts as the second."""
        self._first = self._first or (number, self._clock())

    def _on_signal(self, number: int, frame: FrameType | None) -> None:
        if self._first is None:
            self.note(number)
            raise KeyboardInterrupt
        first, came = self._first
        if number == first and self._clock() - came <= TOGETHER:
            return
        os.write(2, (with_state("whiptool: ended at once by a second signal") + "\n").encode())
        os._exit(INTERRUPTED)

    def end(self) -> None:
        """Ignore further signals: all results are saved, and the process is about to end."""
        self._over = True
        for number in self._before:
            signal.signal(number, signal.SIG_IGN)  # also while the interpreter ends

    def __enter__(self) -> Interruptions:
        _state.clear()
        heard = [n for n in _SIGNALS if signal.getsignal(n) != signal.SIG_IGN]  # a shell's background jobs ignore some
        self._before = {number: signal.signal(number, self._on_signal) for number in heard}
        return self

    def __exit__(self, *_: object) -> None:
        if not self._over:
            for number, handler in self._before.items():
                signal.signal(number, handler)
