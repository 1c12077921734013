"""Processes that answer over a socket: emulated hardware, and clients that must not outlive a motion."""

from __future__ import annotations

import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Callable
from contextlib import suppress
from multiprocessing.connection import Connection
from types import TracebackType
from typing import Any, Self

from whiptool.errors import InputError, WhiptoolError
from whiptool.stop_signals import signals_held

_ENDING = 5.0  # [s] that a process may take to end


def start_child(*words: str) -> tuple[subprocess.Popen[bytes], Connection]:
    """Start `python -m WORDS FD`, and return the process and the connection to its file descriptor FD.

    Ctrl-C does not reach it, so that this process decides what is stopped, as it would on another machine.
    """
    ours, theirs = socket.socketpair()
    with theirs, signals_held():  # else a process could be left that no one ends
        process = subprocess.Popen(
            [sys.executable, "-m", *words, str(theirs.fileno())],
            pass_fds=[theirs.fileno()],
            stdin=subprocess.DEVNULL,
            start_new_session=True,
        )
    return process, Connection(ours.detach())


def end_child(process: subprocess.Popen[bytes]) -> None:
    """Wait until a process that was asked to end has ended; kill it after 5 s."""
    try:
        process.wait(_ENDING)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


class Emulated:
    """Emulated hardware in a separate process, which answers commands one by one. Use it as a context manager, or call
    `close`.

    Args:
        module: Module that is run with `--control FD`.
        options: Options of what is emulated, sent first.

    Attributes:
        begun: Answer of the process to its options.

    Raises:
        InputError: The process refused its options.
        WhiptoolError: The process did not start.
    """

    def __init__(self, module: str, options: Any) -> None:
        self._asking = threading.Lock()
        self._process, self._control = start_child(module, "--control")
        try:
            self._control.send(options)
            refused, self.begun = self._control.recv()
        except BaseException as error:  # also a signal while it starts
            self._control.close()
            self._process.kill()
            self._process.wait()
            if isinstance(error, EOFError | OSError):
                raise WhiptoolError(f"{module} did not start; its error stands above") from error
            raise
        if refused is not None:
            self.close()
            raise InputError(*refused)

    def _ask(self, *command: Any) -> Any:
        """Send a command, and return the answer."""
        with self._asking, signals_held():  # else an answer would be left for the next question
            self._control.send(command)
            return self._control.recv()

    def close(self) -> None:
        """End the process, and wait for it."""
        with suppress(EOFError, OSError):  # it may have ended by itself
            self._ask("quit")
        self._control.close()
        end_child(self._process)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def serve_child(fd: int, make: Callable[[Any, Connection], tuple[Any, Callable[[], None]]]) -> None:
    """Serve as the process of an `Emulated`: receive the options, answer, and answer commands until the end.

    Args:
        fd: File descriptor of the connection.
        make: Function that returns for options and connection what `Emulated.begun` becomes, and the function that
            serves.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    control = Connection(fd)
    try:
        begun, serve = make(control.recv(), control)
        answer: Any = (None, begun)
    except EOFError:  # who started it has ended
        return
    except InputError as error:
        serve, answer = None, ((error.name, error.given, error.allowed, error.fix), None)
    try:
        control.send(answer)
    except OSError:  # likewise
        return
    if serve is not None:
        serve()
