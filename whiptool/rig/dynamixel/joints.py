"""The servos as joints of the arm, in radians and newton metres instead of counts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from whiptool.errors import InputError
from whiptool.limits.arm_limits import XM430
from whiptool.rig.dynamixel.bus import DynamixelBus
from whiptool.rig.dynamixel.control_table import VOLTAGE_UNIT, XM430_W350, Units


@dataclass(frozen=True)
class JointSample:
    """Measurements of all servos in one control cycle; arrays (n,), one value per joint.

    Args:
        q, v: Position [rad], velocity [rad/s].
        current: Measured current [A], positive for positive torque.
        voltage: Voltage of the supply [V].
        temperature: Temperature [deg C].
        hardware_error: Flags of Hardware Error Status(70).
        torque_on: Torque Enable(64).
        watchdog: Bus Watchdog(98); -1: it has tripped.
        tick: The servos' clocks [ms], modulo 32768.
    """

    q: np.ndarray
    v: np.ndarray
    current: np.ndarray
    voltage: np.ndarray
    temperature: np.ndarray
    hardware_error: np.ndarray
    torque_on: np.ndarray
    watchdog: np.ndarray
    tick: np.ndarray


class Joints:
    """Servos as joints of the arm, in rad and N m.

    Args:
        bus: Bus with the servos.
        zero: Counts of Present Position at q = 0, with the arm hanging straight down, (n,); default: 2048 each.
        direction: +1 if counts increase with the joint's angle, else -1, (n,); default: +1.
        torque_constant: Torque constant at the output [N m/A]; default: stall torque over stall current, 1.78.
        units: Units of the counts.
    """

    def __init__(
        self,
        bus: DynamixelBus,
        *,
        zero: Sequence[int] | None = None,
        direction: Sequence[int] | None = None,
        torque_constant: float = XM430.torque_constant,
        units: Units | None = None,
    ) -> None:
        n, units = len(bus.ids), units or Units()
        self.bus, self.n, self.units = bus, n, units
        self._zero = np.array([2048 * units.fineness] * n if zero is None else zero)
        self._sign = np.array([1] * n if direction is None else direction)
        if len(self._zero) != n or len(self._sign) != n or not np.isin(self._sign, (-1, 1)).all():
            raise InputError("zero, direction", (zero, direction), f"{n} zero counts, and {n} directions of +1 or -1")
        self._per_torque = self._sign / (torque_constant * units.current)
        self.torque_constant = torque_constant
        self.quantum = torque_constant * units.current  # [N m], torque of one count
        self.current_limit = XM430_W350["current_limit"].high * units.current_scale  # counts; lowered by arming

    def read(self) -> JointSample:
        """Measure all joints once.

        Raises:
            NoReply, Refused, Unplugged: See `DynamixelBus.read_block`.
        """
        block = np.array(self.bus.read_block())  # (n, 9)
        torque_on, error, watchdog, tick, current, velocity, position, voltage, temperature = block.T
        units, sign = self.units, self._sign
        return JointSample(
            q=sign * (position - self._zero) * units.position,
            v=sign * velocity * units.velocity,
            current=sign * current * units.current,
            voltage=voltage * VOLTAGE_UNIT,
            temperature=temperature,
            hardware_error=error,
            torque_on=torque_on,
            watchdog=watchdog,
            tick=tick,
        )

    def counts(self, torque: np.ndarray) -> np.ndarray:
        """Return Goal Current [counts] for joint torques [N m], (n,), clipped to the current limit."""
        counts = np.rint(torque * self._per_torque)
        return np.clip(counts, -self.current_limit, self.current_limit).astype(int)

    def torque(self, counts: np.ndarray) -> np.ndarray:
        """Return the joint torques [N m], (n,), that correspond to Goal Currents [counts]."""
        return counts / self._per_torque
