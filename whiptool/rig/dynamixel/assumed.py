"""Registers that change the meaning of commands; they are compared with the assumed values before arming."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from whiptool.errors import InputError
from whiptool.rig.dynamixel.bus import DynamixelBus
from whiptool.rig.dynamixel.control_table import register

NO_SECONDARY_ID = 253  # and above: the servo listens to its own id alone


@dataclass(frozen=True)
class Assumed:
    """A servo register and the value that strikes require.

    Args:
        name: Name of the register.
        value: Value that `--for-strikes` sets, which is the manufacturer's default.
        meaning: Purpose of the register, for messages.
        holds: Returns whether a value is acceptable; None: only `value` is.
    """

    name: str
    value: int
    meaning: str
    holds: Callable[[int], bool] | None = None

    def fits(self, found: int) -> bool:
        """Whether the value found in a servo is acceptable."""
        return found == self.value if self.holds is None else self.holds(found)


def _default(name: str, meaning: str, holds: Callable[[int], bool] | None = None) -> Assumed:
    return Assumed(name, register(name).default, meaning, holds)


_SHUTDOWN = register("shutdown").default
ASSUMED = (
    _default("status_return_level", "it answers every instruction"),
    _default("drive_mode", "counts and currents have their usual sign, and Torque Enable alone switches torque on"),
    _default("homing_offset", "2048 counts are the arm hanging straight down"),
    _default("pwm_limit", "the motor gives its whole speed-torque line"),
    _default("secondary_id", "it obeys its own id alone", lambda id: id >= NO_SECONDARY_ID),
    _default("shutdown", "it protects itself from heat, shock and overload", lambda x: x & _SHUTDOWN == _SHUTDOWN),
)


def mismatches(bus: DynamixelBus, id: int) -> list[tuple[Assumed, int]]:
    """Return the registers of a servo whose values strikes do not accept, with these values.

    Raises:
        NoReply, Refused, Unplugged: The servo does not answer.
    """
    found = [(assumed, bus.read(id, assumed.name)) for assumed in ASSUMED]
    return [(assumed, value) for assumed, value in found if not assumed.fits(value)]


def check_registers(bus: DynamixelBus) -> None:
    """Refuse servos with register values that strikes do not accept.

    Raises:
        InputError: A register has another value; the message names servo, register, both values, and the command that
            corrects it.
        NoReply, Refused, Unplugged: A servo does not answer.
    """
    for id in bus.ids:
        for assumed, value in mismatches(bus, id):
            fix = (
                f"set it with `python -m whiptool.rig.dynamixel --port {bus.device} --baud {bus.baud} --ids {id} "
                "--for-strikes`, and see that the arm still hangs at 2048 counts"
            )
            raise InputError(f"servo {id}: {assumed.name}", value, f"{assumed.value}: {assumed.meaning}", fix)


def set_registers(bus: DynamixelBus, id: int) -> list[tuple[Assumed, int]]:
    """Set, with torque off, the registers of a servo whose values strikes do not accept.

    Returns:
        These registers, with their previous values.

    Raises:
        NoReply, Refused, Unplugged: The servo does not answer.
    """
    bus.write_all("status_return_level", register("status_return_level").default)  # first, unanswered: it may be mute
    found = mismatches(bus, id)
    for assumed, _ in found:
        bus.write(id, "torque_enable", 0)
        bus.write(id, assumed.name, assumed.value)
    return found
