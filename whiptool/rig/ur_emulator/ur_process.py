"""An emulated UR in a separate process, as tests and rehearsals start it."""

from __future__ import annotations

import socket
import subprocess
import sys
import threading
from contextlib import suppress
from multiprocessing.connection import Connection
from types import TracebackType
from typing import Any

import numpy as np

from whiptool.errors import InputError, WhiptoolError
from whiptool.rig.stops import signals_held
from whiptool.rig.ur_emulator.ur_controller import UrFault, UrOptions


class UrEmulator:
    """An emulated UR5e; `host` is the address that a client connects to. Use it as a context manager.

    Args:
        options: Options of the robot.

    Raises:
        InputError: Its ports are taken.
        WhiptoolError: The process did not start.
    """

    def __init__(self, options: UrOptions | None = None) -> None:
        self.options = options or UrOptions()
        self.host = self.options.host
        self._asking = threading.Lock()
        ours, theirs = socket.socketpair()
        self._process = subprocess.Popen(
            [sys.executable, "-m", "whiptool.rig.ur_emulator", "--control", str(theirs.fileno())],
            pass_fds=[theirs.fileno()],
            stdin=subprocess.DEVNULL,
            start_new_session=True,  # Ctrl-C is for the client; the robot is another machine
        )
        theirs.close()
        self._control: Connection = Connection(ours.detach())
        try:
            self._control.send(self.options)
            refused = self._control.recv()
        except (EOFError, OSError) as error:
            self.close()
            raise WhiptoolError("the emulated robot did not start; its error stands above") from error
        if refused is not None:
            self.close()
            raise InputError(*refused)

    def _ask(self, *command: Any) -> Any:
        with self._asking, signals_held():  # else an answer would be left for the next question
            self._control.send(command)
            return self._control.recv()

    def inject(self, *faults: UrFault) -> None:
        """Schedule faults."""
        for fault in faults:
            self._ask("add", fault)

    def state(self) -> dict[str, Any]:
        """Return time, safety mode, whether a program runs, payload, positions, speeds, and the log."""
        return self._ask("state")

    def history(self) -> np.ndarray:
        """Return the true motion of every period: time [s], positions [rad], speeds [rad/s], whether servoj was
        commanded, (T, 14).
        """
        return self._ask("history")

    def close(self) -> None:
        """End the process, and wait for it."""
        with suppress(EOFError, OSError):  # it may have ended by itself
            self._ask("quit")
        self._control.close()
        try:
            self._process.wait(5)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    def __enter__(self) -> UrEmulator:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
