"""Signals that wait until what must not be interrupted has ended, such as a packet to a servo, or torque-off."""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
INTERRUPTED = 130  # exit status of a command, of any signal


def end_by_signals_while_importing() -> None:
    """Let SIGINT and SIGTERM end this process in one line if it is a command of whiptool's that begins to import:
    `python -m whiptool.NAME`, or `whiptool`. `Interruptions` then takes them over.
    """
    by_name = sys.argv[:1] == ["-m"] and any(x.removeprefix("-m").split(".")[0] == "whiptool" for x in sys.orig_argv)
    if by_name or os.path.basename(sys.argv[0] if sys.argv else "") == "whiptool":  # noqa: PTH119
        for number in (signal.SIGINT, signal.SIGTERM):
            if signal.getsignal(number) != signal.SIG_IGN:  # a shell's background jobs ignore some
                signal.signal(number, _end)


def _end(number: int, frame: FrameType | None) -> None:
    os.write(2, b"whiptool: interrupted\n")
    os._exit(INTERRUPTED)  # nothing is begun yet, or all is saved


class Listener:
    """Base of objects with signal handlers that `StopSignals` may replace for a while."""

    def note(self, number: int) -> None:
        """Record a signal that was handled by `StopSignals`."""


class StopSignals:
    """Collects signals, which the control loop checks in every cycle, so that torque-off is always completed.

    An exception in a signal handler could leave a packet half sent and torque on. Only two things are interrupted:
    switching torque on, and, by a second signal, a user's callback, which may hang. Outside the main thread, where
    Python has no signal handlers, this class has no effect.

    At the end of its block the previous handlers are restored, and a received signal is sent again, once, unless
    `answered` is set.

    Attributes:
        received: Name of the first signal that came; None: none did.
        answered: Whether the stop has already been reported, so that received signals need no further action.
    """

    def __init__(self) -> None:
        self.received: str | None = None
        self.answered = False
        self._count = 0
        self._raises_at: int | None = None  # so many signals interrupt what is done now; None: it is not interrupted
        self._before: dict[int, Any] = {}

    def _on_signal(self, number: int, frame: FrameType | None) -> None:
        self.received, self._count = self.received or signal.Signals(number).name, self._count + 1
        self._raise_if_due()

    def _raise_if_due(self) -> None:
        if self._raises_at is not None and self._count >= self._raises_at:
            raise KeyboardInterrupt

    @contextmanager
    def interruptible(self, signals: int = 1) -> Iterator[None]:
        """Raise KeyboardInterrupt within a `with` block as soon as `signals` signals have come, including earlier
        signals.
        """
        self._raises_at = signals
        try:
            self._raise_if_due()
            yield
        finally:
            self._raises_at = None

    def listen(self) -> StopSignals:
        """Collect signals from now on, until `close`; returns itself."""
        if threading.current_thread() is threading.main_thread():
            for number in SIGNALS:
                if number == signal.SIGHUP and signal.getsignal(number) == signal.SIG_IGN:  # nohup
                    continue
                self._before[number] = signal.signal(number, self._on_signal)
        return self

    def close(self) -> None:
        """Restore the previous handlers; a signal that was not handled is sent again."""
        number = None if self.received is None else signal.Signals[self.received]
        listeners = {getattr(handler, "__self__", None) for handler in self._before.values()}
        if number is not None and self.answered:
            for listener in listeners:
                if isinstance(listener, Listener):
                    listener.note(number)
        for before, handler in self._before.items():
            signal.signal(before, signal.SIG_DFL if handler is None else handler)  # None: not set from Python
        self._before = {}
        if number is not None and not self.answered:
            signal.raise_signal(number)

    def __enter__(self) -> StopSignals:
        return self.listen()

    def __exit__(self, *_: object) -> None:
        self.close()


@contextmanager
def signals_held() -> Iterator[None]:
    """Delay signals until the end of a `with` block."""
    with StopSignals():
        yield
