"""Interface of the emulator, which runs in a separate process."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np

from whiptool.rig.child_process import Emulated
from whiptool.rig.dynamixel.bus import DynamixelBus
from whiptool.rig.emulator.faults import Fault
from whiptool.rig.emulator.physics import TwinOptions


class Client(Protocol):
    """A port to the emulated servos that counts the bytes that it has sent and received."""

    sent: int
    received: int


class Emulator(Emulated):
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
        super().__init__("whiptool.rig.emulator", self.options)
        self.port: str = self.begun

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
        """Send a command that is carried out after all bytes that the client has sent, and return the answer."""
        return super()._ask(0 if self._client is None else self._client.sent, *command)

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
