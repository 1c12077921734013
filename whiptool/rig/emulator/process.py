"""Interface of the emulator, which runs in a separate process."""

from __future__ import annotations

import socket
import subprocess
import sys
import threading
from collections.abc import Sequence
from contextlib import suppress
from multiprocessing.connection import Connection
from types import TracebackType
from typing import Any, Protocol

import numpy as np

from whiptool.errors import WhiptoolError
from whiptool.rig.dynamixel.bus import DynamixelBus
from whiptool.rig.emulator.faults import Fault
from whiptool.rig.emulator.physics import TwinOptions
from whiptool.rig.stops import signals_held


class Client(Protocol):
    """A port to the emulated servos that counts the bytes that it has sent and received."""

    sent: int
    received: int


class Emulator:
    """An emulated rig: a process that implements the servos' protocol on a pseudo-terminal.

    `port` is the device to open, as `/dev/ttyUSB0` would be. Use it as a context manager, or call `close`.

    Args:
        options: Options of the emulated arm.

    Raises:
        WhiptoolError: The process did not start.
    """

    def __init__(self, options: TwinOptions | None = None) -> None:
        self.options = options or TwinOptions()
        self._client: Client | None = None
        self._asking = threading.Lock()
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

    def bus(
        self, *, ids: Sequence[int] = (), baud: int | None = None, timeout: float = 0.05, fast: bool = True
    ) -> DynamixelBus:
        """Return a bus to the servos. In lock step a reply is missing only if the emulator sent none, so that runs
        are reproducible on any machine.

        Args:
            ids: Ids of the servos; default: all.
            baud: Baud rate [bit/s]; default: that of the servos.
            timeout, fast: As in `DynamixelBus`; in lock step the timeout is extended while a reply is under way.

        Returns:
            A `DynamixelBus`; a bus returned earlier is no longer in lock step.
        """
        o = self.options
        bus = DynamixelBus(self.port, ids or o.ids, baud=baud or o.baud, timeout=timeout, fast=fast)
        if o.lockstep:
            bus.follow(self)
        return bus

    def follow(self, client: Client) -> None:
        """Count this client's bytes from now on, and execute later calls only after all its earlier bytes were
        processed.
        """
        self._ask("count")
        client.sent = client.received = 0
        self._client = client

    def given(self) -> int:
        """Return the number of bytes that the emulator has written; see `whiptool.rig.dynamixel.line.Peer`."""
        try:
            return self._ask("given")
        except EOFError as error:
            raise OSError("the emulator has ended") from error

    def _ask(self, *command: Any) -> Any:
        with self._asking, signals_held():  # else an answer would be left for the next question
            self._control.send((0 if self._client is None else self._client.sent, *command))
            return self._control.recv()

    def inject(self, *faults: Fault) -> None:
        """Schedule faults in the emulator.

        Raises:
            InputError: A fault is of a servo that is not there; none is scheduled.
        """
        for fault in faults:
            fault.check_servo(len(self.options.ids))
        for fault in faults:
            self._ask("add", fault)

    def advance(self, dt: float) -> None:
        """Advance simulated time by dt [s] without a write, in lock step."""
        self._ask("advance", float(dt))

    def state(self) -> dict[str, Any]:
        """Return time, motors and registers; see `Server.state`."""
        return self._ask("state")

    def trajectory(self) -> dict[str, np.ndarray]:
        """Return the true motion, as from `whiptool.rig.emulator.physics.Physics.trajectory`."""
        return self._ask("trajectory")

    def reset(self, start: Sequence[float] | None = None) -> None:
        """Return to the initial state at time 0 without faults; `port` may change."""
        self.port = self._ask("reset", None if start is None else tuple(map(float, start)))
        if self._client is not None:
            self._client.sent = self._client.received = 0

    def close(self) -> None:
        """End the emulator's process, and wait for it."""
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
