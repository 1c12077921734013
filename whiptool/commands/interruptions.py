"""Ctrl-C and SIGTERM of a command: the first has it save what there is, a second ends it at once."""

from __future__ import annotations

import os
import signal
from types import FrameType
from typing import Any

INTERRUPTED = 130  # exit status, of either signal
_SIGNALS = (signal.SIGINT, signal.SIGTERM)


class Interruptions:
    """Handlers of a command's signals, set within a `with` block.

    The first signal raises KeyboardInterrupt. A second one, while the command saves and ends, ends the process at once:
    an exception would come out of whatever cleans up then, as a traceback. While servos may be on, the handlers of
    `whiptool.rig.stop_signals` stand in their place, so that torque-off is completed.
    """

    def __init__(self) -> None:
        self._came = self._over = False
        self._before: dict[int, Any] = {}

    def _on_signal(self, number: int, frame: FrameType | None) -> None:
        if self._came:
            os.write(2, b"whiptool: ended at once by a second signal\n")
            os._exit(INTERRUPTED)
        self._came = True
        raise KeyboardInterrupt

    def end(self) -> None:
        """Ignore further signals: the command has saved what it could, and the process is about to end."""
        self._over = True
        for number in self._before:
            signal.signal(number, signal.SIG_IGN)  # also while the interpreter ends

    def __enter__(self) -> Interruptions:
        heard = [n for n in _SIGNALS if signal.getsignal(n) != signal.SIG_IGN]  # a shell's background jobs ignore some
        self._before = {number: signal.signal(number, self._on_signal) for number in heard}
        return self

    def __exit__(self, *_: object) -> None:
        if not self._over:
            for number, handler in self._before.items():
                signal.signal(number, handler)
