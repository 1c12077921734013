"""Progress bars."""

from __future__ import annotations

import threading

import tqdm


class Progress(tqdm.tqdm):
    """A progress bar of tqdm for one process.

    tqdm guards its bars by a semaphore that all processes share: Python warns that it leaked when a process that has
    drawn one is killed, as workers of an interrupted command are.
    """


Progress.set_lock(threading.RLock())
