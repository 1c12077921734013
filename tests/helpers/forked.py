"""Inputs that are tried in forked processes, so that one that never ends, or takes all memory, is seen and named."""

from __future__ import annotations

import multiprocessing
import os
import resource
import shutil
import signal
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path

LONGEST = 60.0  # [s] of processor time of one input: what takes as long does not end
SILENT = 600.0  # [s] of the clock without an answer: what waits for a pipe or a lock takes no processor time
MOST = 2 << 30  # [bytes] of memory that one input may take


@dataclass(frozen=True)
class Input:
    """One hostile input.

    Args:
        label: Words that name it.
        answer: Function that gives it to the library, in an empty folder that is the working folder too, and returns
            what is wrong with the answer; empty: nothing is.
    """

    label: str
    answer: Callable[[Path], str]


def faults(inputs: Sequence[Input], *, silent: float = SILENT) -> list[str]:
    """Return what is wrong with the answers to some inputs, one text for each input whose answer is wrong.

    One process tries them one after the other; where it is stopped, another goes on with the next input.
    """
    with tempfile.TemporaryDirectory(prefix="hostile-", ignore_cleanup_errors=True) as folder:
        return _faults(inputs, Path(folder), silent)


def _faults(inputs: Sequence[Input], place: Path, silent: float) -> list[str]:
    context = multiprocessing.get_context("fork")
    found, done = [], 0
    while done < len(inputs):
        mine, its = context.Pipe(duplex=False)
        process = context.Process(target=_try_all, args=(inputs[done:], place, its))
        process.start()
        its.close()
        while done < len(inputs):
            said = _said(mine, process.pid or 0, silent)
            wrong = said if said is not None else "its process ended without an answer"
            done += 1
            if wrong:
                found.append(f"{inputs[done - 1].label}: {wrong}")
            if said is None or said.startswith("stopped"):
                break
        process.kill()
        process.join()
        mine.close()
    return found


def _said(pipe: Connection, pid: int, silent: float) -> str | None:
    """Return what a process says of its next input; None: it has ended."""
    begun, used = time.monotonic(), _used(pid)
    while not pipe.poll(0.05):
        if _resident(pid) > MOST:
            return f"stopped: it took more than {MOST / 2**30:g} GB"
        if _used(pid) - used > LONGEST or time.monotonic() - begun > silent:
            return "stopped: it did not end"
    try:
        return pipe.recv()
    except EOFError:
        return None


def _used(pid: int) -> float:
    """Processor time [s] of a process; 0 after its end."""
    try:
        words = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return 0.0
    return (int(words[11]) + int(words[12])) / os.sysconf("SC_CLK_TCK")


def _resident(pid: int) -> int:
    try:
        return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * resource.getpagesize()
    except (OSError, IndexError):
        return 0


def _try_all(inputs: Sequence[Input], place: Path, pipe: Connection) -> None:
    """Answer for one input after the other."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    before = Path.cwd()
    nowhere = os.open(os.devnull, os.O_RDWR)
    for stream in (0, 1, 2):  # what is printed past Python, such as by a parser in C
        os.dup2(nowhere, stream)
    for one in inputs:
        folder = Path(tempfile.mkdtemp(dir=place))
        os.chdir(folder)
        try:
            wrong = one.answer(folder)
        except BaseException as error:
            wrong = f"{type(error).__name__} of the test itself: {error}"
        finally:
            os.chdir(before)
            shutil.rmtree(folder, ignore_errors=True)
        pipe.send(wrong)
    os._exit(0)
