"""Progress bars and notes on stderr, which a quiet command does not show."""

from __future__ import annotations

import sys
import threading
from typing import Any, ClassVar

import tqdm


class Progress(tqdm.tqdm):
    """A tqdm progress bar without tqdm's semaphore between processes.

    Python would warn of a leaked semaphore whenever a process with a bar is killed, such as a worker of an interrupted
    command.
    """

    quiet: ClassVar[bool] = False  # whether neither bars nor notes are shown in this process

    def __init__(self, *args: Any, disable: bool = False, **kwargs: Any) -> None:
        super().__init__(*args, disable=disable or Progress.quiet, **kwargs)


def note(text: str) -> None:
    """Print a note on stderr, unless the command is quiet."""
    if not Progress.quiet:
        print(text, file=sys.stderr, flush=True)


Progress.set_lock(threading.RLock())
