"""Settings of the whole process that whiptool changes for a while, such as a library's number of threads."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager


class HeldSetting:
    """A setting that is changed while any thread needs it, and put back when the last one has ended.

    Args:
        change: Function that changes the setting, and returns a function that puts it back.
        in_each: Whether every thread has the setting to itself, and new threads have that of the last that changed it.
    """

    def __init__(self, change: Callable[[], Callable[[], object]], *, in_each: bool = False) -> None:
        self._change, self._in_each, self._lock, self._users = change, in_each, threading.Lock(), 0

    @contextmanager
    def held(self) -> Iterator[None]:
        """Change the setting within a `with` block."""
        with self._lock:
            put_back = self._change()
            self._put_back = self._put_back if self._users else put_back
            self._users += 1
        try:
            yield
        finally:
            with self._lock:
                self._users -= 1
                if self._in_each or not self._users:
                    self._put_back()
