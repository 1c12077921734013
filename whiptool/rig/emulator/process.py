"""The emulator in a process of its own, and a handle on it."""

from __future__ import annotations

import signal
import socket
import subprocess
import sys
from collections.abc import Sequence
from contextlib import suppress
from multiprocessing.connection import Connection
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np

from whiptool.errors import WhiptoolError
from whiptool.rig.emulator.faults import Fault
from whiptool.rig.emulator.server import Server, TwinOptions


class Emulator:
    """A rig that is not there: a process that serves the protocol on a pseudo-terminal.

    `port` is the device to open, as `/dev/ttyUSB0` would be. Use it as a context manager, or call `close`.

    Args:
        options: What is emulated, and how its time runs.

    Raises:
        WhiptoolError: The process did not start.
    """

    def __init__(self, options: TwinOptions | None = None) -> None:
        self.options = options or TwinOptions()
        ours, theirs = socket.socketpair()
        self._process = subprocess.Popen(
            [sys.executable, "-m", "whiptool.rig.emulator", "--control", str(theirs.fileno())],
            pass_fds=[theirs.fileno()],
            stdin=subprocess.DEVNULL,
            start_new_session=True,  # Ctrl-C is for the client; the rig is another machine
        )
        theirs.close()
        self._control: Connection = Connection(ours.detach())
        try:
            self._control.send(self.options)
            self.port: str = self._control.recv()
        except (EOFError, OSError) as error:
            self.close()
            raise WhiptoolError("the emulator did not start; its error stands above") from error

    def _ask(self, *command: Any) -> Any:
        self._control.send(command)
        return self._control.recv()

    def inject(self, *faults: Fault) -> None:
        """Have faults happen."""
        for fault in faults:
            self._ask("add", fault)

    def advance(self, dt: float) -> None:
        """Let simulated time pass [s] without any write: for lock-step."""
        self._ask("advance", float(dt))

    def state(self) -> dict[str, Any]:
        """Time, motors and registers, as an outside observer sees them; see `Server.state`."""
        return self._ask("state")

    def trajectory(self) -> dict[str, np.ndarray]:
        """What arm and whip did: t (T,) [s], q, v (T, n), current [A], torque [N m] (T, a), tip (T, 2) [m]."""
        return self._ask("trajectory")

    def save(self, path: Path | str) -> None:
        """Write `trajectory()` to an NPZ file, without pickle."""
        np.savez_compressed(path, **self.trajectory())  # type: ignore[arg-type]

    def reset(self, start: Sequence[float] | None = None) -> None:
        """As new, at time 0, all faults mended; `port` may change."""
        self.port = self._ask("reset", None if start is None else tuple(map(float, start)))

    def close(self) -> None:
        """End the process."""
        with suppress(EOFError, OSError):  # it may have ended by itself
            self._ask("quit")
        self._control.close()
        try:
            self._process.wait(5)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    def __enter__(self) -> Emulator:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def serve_child(fd: int) -> None:
    """The emulator's process: options come first, the port goes back, then commands."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    control = Connection(fd)
    server = Server(control.recv(), control)
    control.send(server.port)
    server.serve()


def serve_alone(options: TwinOptions, link: str | None) -> None:
    """Serve in the foreground until interrupted; `link` is a symbolic link to make to the device."""
    server = Server(options)
    print(f"emulated servos {list(options.ids)} at {options.baud} baud on {server.port}", flush=True)
    if link:
        Path(link).unlink(missing_ok=True)
        Path(link).symlink_to(server.port)
        print(f"and on {link}", flush=True)
    try:
        server.serve()
    except KeyboardInterrupt:
        pass
    finally:
        if link:
            Path(link).unlink(missing_ok=True)
