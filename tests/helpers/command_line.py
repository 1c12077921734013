"""Commands as users call them."""

from __future__ import annotations

import subprocess
import sys

from processes import HANG


def whiptool(command: str, *args: object, cwd, **options) -> subprocess.CompletedProcess:
    words = [sys.executable, "-m", f"whiptool.{command}", *map(str, args)]
    return subprocess.run(words, cwd=cwd, capture_output=True, text=True, timeout=HANG, check=False, **options)


def assert_one_line(done: subprocess.CompletedProcess, *parts: str) -> None:
    assert done.returncode == 2, done.stderr
    assert done.stdout == ""
    assert done.stderr.count("\n") == 1, done.stderr
    for part in parts:
        assert part in done.stderr
