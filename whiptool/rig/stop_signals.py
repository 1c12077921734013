"""Ctrl-C, SIGTERM and SIGHUP while servos may be on: noted, so that none of them cuts a packet or torque-off short."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


class Listener:
    """Has handlers of signals, in whose place those of `StopSignals` stand for a while."""

    def note(self, number: int) -> None:
        """Take note of a signal that has already ended what was done."""


class StopSignals:
    """Signals as a wish that the loop sees in its next cycle; however many come, torque-off is completed.

    An exception out of a handler could leave a packet half sent, and torque on. Two things are interrupted all the
    same: the switching on of torque, and, by a second signal, a callback that is not ours and may hang. Outside of the
    main thread Python knows no handlers: it does nothing.

    When its block has ended, the handlers are as before. A signal that came then does what it would have done, once,
    unless `answered` says that what was done ends anyway.

    Attributes:
        received: Name of the first signal that came; None: none did.
        answered: Whether a stop has been reported already; further signals of the block add nothing to it.
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
        """Raise KeyboardInterrupt within this block once so many signals have come, also if they came before it."""
        self._raises_at = signals
        try:
            self._raise_if_due()
            yield
        finally:
            self._raises_at = None

    def listen(self) -> StopSignals:
        """Note signals from now on, until `close`."""
        if threading.current_thread() is threading.main_thread():
            for number in SIGNALS:
                if number == signal.SIGHUP and signal.getsignal(number) == signal.SIG_IGN:  # nohup
                    continue
                self._before[number] = signal.signal(number, self._on_signal)
        return self

    def close(self) -> None:
        """Set the handlers as before; a signal that was not handled is sent again."""
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
    """Have signals wait until the block has ended; then they do what they would have done."""
    with StopSignals():
        yield
