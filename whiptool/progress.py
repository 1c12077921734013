"""What is shown of work that goes on: progress bars and notes on stderr, none of them where a command is quiet."""

from __future__ import annotations

import sys
import threading
from typing import Any, ClassVar

import tqdm


class Progress(tqdm.tqdm):
    """A progress bar of tqdm for one process.

    tqdm guards its bars by a semaphore that all processes share: Python warns that it leaked when a process that has
    drawn one is killed, as workers of an interrupted command are.
    """

    quiet: ClassVar[bool] = False  # whether neither bars nor notes are shown in this process

    def __init__(self, *args: Any, disable: bool = False, **kwargs: Any) -> None:
        super().__init__(*args, disable=disable or Progress.quiet, **kwargs)


def note(text: str) -> None:
    """Tell on stderr what is being done, unless the command is quiet."""
    if not Progress.quiet:
        print(text, file=sys.stderr, flush=True)


Progress.set_lock(threading.RLock())
