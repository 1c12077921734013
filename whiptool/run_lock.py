"""Who writes in a run folder: one process at a time, which others can name."""

from __future__ import annotations

import json
import os
import shlex
import socket
import sys
from datetime import datetime
from pathlib import Path

from filelock import FileLock, Timeout

from whiptool.errors import InputError

LOCK = ".lock"


class RunLock:
    """A lock of the operating system on the file `.lock` of a run folder, held until `release` or the end of the
    process.

    The file names its holder. The lock of a killed process is free.

    Args:
        folder: An existing folder.

    Raises:
        InputError: Another process holds the lock; it is named.
        OSError: The file cannot be written.
    """

    def __init__(self, folder: Path) -> None:
        self.path = folder / LOCK
        self._lock = FileLock(self.path, timeout=0, thread_local=False)
        try:
            self._lock.acquire()
        except Timeout:
            allowed = "a folder that no other command works in"
            raise InputError("run folder", str(folder), allowed, _said(self.path)) from None

        holder = {
            "process": os.getpid(),
            "host": socket.gethostname(),
            "since": f"{datetime.now():%Y-%m-%d %H:%M:%S}",
            "command": shlex.join(sys.argv),
        }
        try:
            self.path.write_text(json.dumps(holder) + "\n", encoding="utf-8")  # in place: this very file is locked
        except OSError:
            self.release()
            raise

    def release(self) -> None:
        """Release the lock; the file is removed before, so that no other process's file is removed."""
        if self._lock.is_locked:
            self.path.unlink(missing_ok=True)
            self._lock.release()


def _said(path: Path) -> str:
    """What a lock file says of its holder."""
    try:
        holder = json.loads(path.read_text(encoding="utf-8"))
        return f"process {holder['process']} on {holder['host']} does since {holder['since']}: {holder['command']}"
    except (OSError, ValueError, KeyError, TypeError):
        return "another process does"  # it has the lock, and has not said so yet
