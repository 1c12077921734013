"""Servos on a bus: `python -m whiptool.rig.dynamixel` finds them, and sets them up."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Literal

from whiptool.commands import cli
from whiptool.commands.options.option_group import Conditions, OptionGroup, unless, whole
from whiptool.errors import InputError

if TYPE_CHECKING:
    from whiptool.rig.dynamixel.bus import DynamixelBus

Baud = Literal[9_600, 57_600, 115_200, 1_000_000, 2_000_000, 3_000_000, 4_000_000, 4_500_000]
LAST_ID = 252
_SERVOS = "See which servos are there, and set them up."
# [s] that a reply may take, once. The SDK gives a ping up after 34 ms: two periods of a USB adapter's latency timer
# (16 ms) and 2 ms. That is plenty for a servo, but no time for an emulated one that shares its processor with others,
# nor for this process: with eight busy ones on two cores, fewer than half of the pings came back so soon. The SDK's own
# scan, a broadcast ping, waits 0.8 s. A servo that is not there costs a second for each baud rate that is tried.
PATIENCE = 1.0


@dataclass(frozen=True, kw_only=True)
class ServoOptions(OptionGroup):
    """Options of `python -m whiptool.rig.dynamixel`, which finds the servos on a bus and sets them up."""

    only_with: ClassVar[Conditions] = dict.fromkeys(
        ("ids", "set_baud", "set_return_delay", "set_id", "for_strikes"), unless("reboot")
    )

    port: str
    """Serial device, such as /dev/ttyUSB0."""
    baud: Baud = 1_000_000
    """Baud rate at which the servos communicate now."""
    ids: tuple[int, ...] = (1, 2)
    """Ids of the servos."""
    set_baud: Baud | None = None
    """Set all servos to this baud rate."""
    set_return_delay: int | None = None
    """Set the Return Delay Time of all servos, in units of 2 us."""
    set_id: int | None = None
    """Set the id of the single servo in --ids. No other servo on the line may have it."""
    for_strikes: bool = False
    """Set the registers that change the meaning of commands (drive mode, homing offset, PWM limit, ...) to the values
    that strikes assume."""
    reboot: int | None = None
    """Reboot the servo with this id, which clears a shutdown."""

    def check(self) -> None:
        super().check()
        if not self.ids or len(set(self.ids)) < len(self.ids) or not all(0 <= id <= LAST_ID for id in self.ids):
            raise InputError("--ids", self.ids, f"different numbers from 0 to {LAST_ID}")
        for name, value, most in (
            ("--set-return-delay", self.set_return_delay, 254),
            ("--set-id", self.set_id, LAST_ID),
            ("--reboot", self.reboot, LAST_ID),
        ):
            if value is not None:
                whole(name, value, low=0, high=most)
        if self.set_id is not None and len(self.ids) != 1:
            raise InputError("--set-id", self.set_id, "together with one id in --ids")


def _set_up(o: ServoOptions) -> int:
    """Do what is asked of the servos, and say what they answered."""
    from whiptool.rig.dynamixel.bus import DynamixelBus
    from whiptool.rig.dynamixel.control_table import BAUD_RATES
    from whiptool.rig.dynamixel.joints import set_registers

    rate = {bps: value for value, bps in BAUD_RATES.items()}
    with DynamixelBus(o.port, o.ids, baud=o.baud, timeout=PATIENCE) as bus:
        if o.reboot is not None:
            bus.instruct(o.reboot, 8)
            print(f"servo {o.reboot} reboots")
            return 0
        for id in o.ids:
            print(_told(bus, id))
        if o.set_id is not None:
            _refuse_taken(bus, o)
        if o.for_strikes:
            for id in o.ids:
                for assumed, found in set_registers(bus, id):
                    print(f"{assumed.name} of {id} was {found}, and is now {assumed.value}")
        for name, value in (
            ("return_delay_time", o.set_return_delay),
            ("id", o.set_id),
            ("baud_rate", None if o.set_baud is None else rate[o.set_baud]),  # last: it ends the talk at this rate
        ):
            if value is None:
                continue
            for id in (o.set_id,) if name == "baud_rate" and o.set_id is not None else o.ids:
                bus.write(id, "torque_enable", 0)  # the EEPROM is locked while torque is on
                bus.write(id, name, value)
            print(f"{name} of {', '.join(map(str, o.ids))} is now {value}")
    return 0


def _told(bus: DynamixelBus, id: int) -> str:
    """What a servo answers, and what of it strikes would not be made with."""
    from whiptool.rig.dynamixel.control_table import Units, in_words
    from whiptool.rig.dynamixel.joints import mismatches
    from whiptool.rig.dynamixel.line import NoReply

    try:
        model, firmware = bus.ping(id)
    except NoReply:
        raise bus.absent(id) from None
    volts, warm = bus.read(id, "present_input_voltage") / 10, bus.read(id, "present_temperature")
    error, counts = bus.read(id, "hardware_error_status"), bus.read(id, "present_position")
    degrees = math.degrees((counts - 2048) * Units().position)
    said = [
        f"servo {id}: model {model}, firmware {firmware}, {volts:.1f} V, {warm} deg C",
        f"position {counts} ({degrees:+.1f} deg from 2048), {in_words(error) if error else 'no error'}",
    ]
    said += [f"{a.name} is {found}, strikes assume {a.value}" for a, found in mismatches(bus, id)]
    return ", ".join(said)


def _refuse_taken(bus: DynamixelBus, o: ServoOptions) -> None:
    """Refuse an id that another servo on the line answers to: two of one id cannot be distinguished any more.

    Raises:
        InputError: It is taken.
    """
    from whiptool.rig.dynamixel.line import Damaged, NoReply

    if o.set_id is None or o.set_id in o.ids:
        return
    try:
        bus.ping(o.set_id)
    except Damaged:
        pass  # of several at once
    except NoReply:
        return
    fix = f"give that one another id first, or unplug it; --ids {o.set_id} shows it"
    raise InputError("--set-id", o.set_id, "an id that no other servo on the line has", fix)


main = cli.command(ServoOptions, "rig.dynamixel", _SERVOS, _set_up, prog="python -m whiptool.rig.dynamixel")
