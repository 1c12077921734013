"""Ctrl-C, SIGTERM and SIGHUP while servos may be on: noted, so that none of them cuts a packet or torque-off short."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


class StopSignals:
    """Signals as a wish that the loop sees in its next cycle; however many come, torque-off is completed.

    An exception out of a handler could leave a packet half sent, and torque on. Only a callback that is not ours and
    may hang is interrupted, by a second signal. Outside of the main thread Python knows no handlers: it does nothing.

    Attributes:
        received: Name of the first signal that came; None: none did.
    """

    def __init__(self) -> None:
        self.received: str | None = None
        self._interruptible = False
        self._before: dict[int, Any] = {}

    def _on_signal(self, number: int, frame: FrameType | None) -> None:
        again, self.received = self.received is not None, self.received or signal.Signals(number).name
        if again and self._interruptible:
            raise KeyboardInterrupt

    @contextmanager
    def interruptible(self) -> Iterator[None]:
        """A second signal raises KeyboardInterrupt within this block."""
        self._interruptible = True
        try:
            yield
        finally:
            self._interruptible = False

    def __enter__(self) -> StopSignals:
        if threading.current_thread() is threading.main_thread():
            for number in SIGNALS:
                if number == signal.SIGHUP and signal.getsignal(number) == signal.SIG_IGN:  # nohup
                    continue
                self._before[number] = signal.signal(number, self._on_signal)
        return self

    def __exit__(self, *_: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, signal.SIG_DFL if handler is None else handler)  # None: not set from Python


@contextmanager
def signals_held() -> Iterator[None]:
    """Have signals wait until the block has ended; then they do what they would have done."""
    held = StopSignals()
    try:
        with held:
            yield
    finally:
        if held.received is not None:
            signal.raise_signal(signal.Signals[held.received])
