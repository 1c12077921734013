"""Commands as users call them."""

from __future__ import annotations

import contextlib
import io
import subprocess
import sys

from processes import HANG

from whiptool.commands.cli import main_of


def whiptool(command: str, *args: object, cwd, **options) -> subprocess.CompletedProcess:
    """Call a command in a process of its own."""
    words = [sys.executable, "-m", f"whiptool.{command}", *map(str, args)]
    return subprocess.run(words, cwd=cwd, capture_output=True, text=True, timeout=HANG, check=False, **options)


def called(command: str, *args: object, cwd) -> subprocess.CompletedProcess:
    """Call a command in this process: the same without the seconds in which a process imports."""
    words, out, err = list(map(str, args)), io.StringIO(), io.StringIO()
    main = main_of(command)
    with contextlib.chdir(cwd), contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        status = main(words)
    return subprocess.CompletedProcess([command, *words], status, out.getvalue(), err.getvalue())


def assert_one_line(done: subprocess.CompletedProcess, *parts: str) -> None:
    assert done.returncode == 2, done.stderr
    assert done.stdout == ""
    assert done.stderr.count("\n") == 1, done.stderr
    for part in parts:
        assert part in done.stderr
