"""An emulated UR in a separate process, as tests and rehearsals start it."""

from __future__ import annotations

from typing import Any

import numpy as np

from whiptool.rig.child_process import Emulated
from whiptool.rig.ur_emulator.ur_controller import UrFault, UrOptions


class UrEmulator(Emulated):
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
        super().__init__("whiptool.rig.ur_emulator", self.options)

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
