"""The control table of the XM430-W350 with firmware 45 as data.

Source: the manufacturer's manual, https://emanual.robotis.com/docs/en/dxl/x/xm430-w350/ (tables "Control Table of
EEPROM Area" and "Control Table of RAM Area"), https://emanual.robotis.com/docs/en/dxl/protocol2/ (Protocol 2.0). Older
versions of the manual have an Acceleration Limit(40), which the tables of this firmware no longer have.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from whiptool.errors import InputError

MODEL_NUMBER = 1020
FIRMWARE = 45  # the oldest that answers a fast sync read, and has Startup Configuration(60) and backups
RAM = 64  # first address of the RAM area; what lies below is EEPROM
CURRENT_MODE, VELOCITY_MODE, POSITION_MODE, EXTENDED_MODE, CURRENT_BASED_MODE, PWM_MODE = 0, 1, 3, 4, 5, 16
WATCHDOG_UNIT = 0.02  # [s], of Bus Watchdog(98)
WATCHDOG_TRIPPED = -1

# Baud Rate(8): value of the register -> bits per second
BAUD_RATES = {
    0: 9_600,
    1: 57_600,
    2: 115_200,
    3: 1_000_000,
    4: 2_000_000,
    5: 3_000_000,
    6: 4_000_000,
    7: 4_500_000,
}

# Hardware Error Status(70) and Shutdown(63), by bit
HARDWARE_ERRORS = {0: "input voltage", 2: "overheating", 3: "motor encoder", 4: "electrical shock", 5: "overload"}


@dataclass(frozen=True)
class Register:
    """One item of the control table.

    Args:
        address: Address of the first byte.
        size: Number of bytes, little-endian.
        writable: Whether it can be written (access RW).
        default: Initial value.
        low, high: Range of values that may be written.
        signed: Whether the value is signed, in two's complement.
    """

    name: str
    address: int
    size: int
    writable: bool = False
    default: int = 0
    low: int = 0
    high: int = 0
    signed: bool = False

    @property
    def eeprom(self) -> bool:
        """Whether the register keeps its value without power, and is locked while torque is on."""
        return self.address < RAM

    def decode(self, data: bytes) -> int:
        """Return the value of a register's bytes, with its sign."""
        return int.from_bytes(data, "little", signed=self.signed)

    def encode(self, value: int) -> bytes:
        """Return the bytes of a value.

        Raises:
            InputError: The value is not a whole number, or out of the register's range.
        """
        low, high = (self.low, self.high) if self.writable else (-(2**31), 2**32)
        if isinstance(value, bool) or int(value) != value or not low <= value <= high:
            raise InputError(self.name, value, f"a whole number from {low} to {high}")
        return int(value).to_bytes(self.size, "little", signed=self.signed)


def _indirect() -> list[Register]:
    """Indirect Address 1-28, 29-56 and the Indirect Data they lead to."""
    blocks = ((1, 168, 224), (29, 578, 634))
    registers = []
    for first, addresses, data in blocks:
        for i in range(28):
            n = first + i
            registers.append(Register(f"indirect_address_{n}", addresses + 2 * i, 2, True, data + i, RAM, 661))
            registers.append(Register(f"indirect_data_{n}", data + i, 1, True, 0, 0, 255))
    return registers


_TABLE = [
    #         name                   addr  size  rw   default  low      high
    Register("model_number", 0, 2, default=MODEL_NUMBER),
    Register("model_information", 2, 4),
    Register("firmware_version", 6, 1, default=FIRMWARE),
    Register("id", 7, 1, True, 1, 0, 252),
    Register("baud_rate", 8, 1, True, 1, 0, 7),
    Register("return_delay_time", 9, 1, True, 250, 0, 254),
    Register("drive_mode", 10, 1, True, 0, 0, 13),
    Register("operating_mode", 11, 1, True, POSITION_MODE, 0, 16),
    Register("secondary_id", 12, 1, True, 255, 0, 255),
    Register("protocol_version", 13, 1, True, 2, 1, 2),
    Register("homing_offset", 20, 4, True, 0, -1_044_479, 1_044_479, True),
    Register("moving_threshold", 24, 4, True, 10, 0, 1_023),
    Register("temperature_limit", 31, 1, True, 80, 0, 100),
    Register("max_voltage_limit", 32, 2, True, 160, 95, 160),
    Register("min_voltage_limit", 34, 2, True, 95, 95, 160),
    Register("pwm_limit", 36, 2, True, 885, 0, 885),
    Register("current_limit", 38, 2, True, 1_193, 0, 1_193),
    Register("velocity_limit", 44, 4, True, 200, 0, 1_023),
    Register("max_position_limit", 48, 4, True, 4_095, 0, 4_095),
    Register("min_position_limit", 52, 4, True, 0, 0, 4_095),
    Register("startup_configuration", 60, 1, True, 0, 0, 3),
    Register("shutdown", 63, 1, True, 52, 0, 255),
    Register("torque_enable", 64, 1, True, 0, 0, 1),
    Register("led", 65, 1, True, 0, 0, 1),
    Register("status_return_level", 68, 1, True, 2, 0, 2),
    Register("registered_instruction", 69, 1),
    Register("hardware_error_status", 70, 1),
    Register("velocity_i_gain", 76, 2, True, 1_920, 0, 16_383),
    Register("velocity_p_gain", 78, 2, True, 100, 0, 16_383),
    Register("position_d_gain", 80, 2, True, 0, 0, 16_383),
    Register("position_i_gain", 82, 2, True, 0, 0, 16_383),
    Register("position_p_gain", 84, 2, True, 800, 0, 16_383),
    Register("feedforward_2nd_gain", 88, 2, True, 0, 0, 16_383),
    Register("feedforward_1st_gain", 90, 2, True, 0, 0, 16_383),
    Register("bus_watchdog", 98, 1, True, 0, 0, 127, True),
    Register("goal_pwm", 100, 2, True, 885, -885, 885, True),
    Register("goal_current", 102, 2, True, 1_193, -1_193, 1_193, True),
    Register("goal_velocity", 104, 4, True, 0, -1_023, 1_023, True),
    Register("profile_acceleration", 108, 4, True, 0, 0, 32_767),
    Register("profile_velocity", 112, 4, True, 0, 0, 32_767),
    Register("goal_position", 116, 4, True, 0, -1_048_575, 1_048_575, True),
    Register("realtime_tick", 120, 2),
    Register("moving", 122, 1),
    Register("moving_status", 123, 1),
    Register("present_pwm", 124, 2, signed=True),
    Register("present_current", 126, 2, signed=True),
    Register("present_velocity", 128, 4, signed=True),
    Register("present_position", 132, 4, signed=True),
    Register("velocity_trajectory", 136, 4, signed=True),
    Register("position_trajectory", 140, 4, signed=True),
    Register("present_input_voltage", 144, 2),
    Register("present_temperature", 146, 1),
    Register("backup_ready", 147, 1),
    *_indirect(),
]
XM430_W350: dict[str, Register] = {register.name: register for register in _TABLE}
TICKS = 32_768  # Realtime Tick(120) counts milliseconds modulo this


def register(name: str) -> Register:
    """Return the register called `name`.

    Raises:
        InputError: The control table has no register of that name.
    """
    if name not in XM430_W350:
        raise InputError("register", name, "a name of the XM430-W350's control table, such as goal_current")
    return XM430_W350[name]


@dataclass(frozen=True)
class Units:
    """SI values of one count of the servo's registers: those of the manual, divided by `fineness`.

    Args:
        fineness: Factor by which counts are finer, for current at most 16 (its register has two bytes). It is 1 for a
            real servo, and may be larger for an emulated servo, to study the effect of quantisation.
    """

    fineness: int = 1

    @property
    def current(self) -> float:
        """Current per count [A]: 2.69 mA."""
        return 2.69e-3 / min(self.fineness, 16)

    @property
    def velocity(self) -> float:
        """Velocity per count [rad/s]: 0.229 rev/min."""
        return 0.229 * 2 * math.pi / 60 / self.fineness

    @property
    def position(self) -> float:
        """Angle per count [rad]: 1/4096 rev."""
        return 2 * math.pi / 4096 / self.fineness

    @property
    def current_scale(self) -> int:
        """Number of current counts per count of the real servo."""
        return min(self.fineness, 16)


VOLTAGE_UNIT = 0.1  # [V], of Present Input Voltage(144)
RATED_VOLTAGE = 12.0  # [V], of the limits of the XM430-W350


def in_words(flags: int) -> str:
    """Return the flags of Hardware Error Status(70) as text."""
    return ", ".join(text for bit, text in HARDWARE_ERRORS.items() if flags >> bit & 1) or f"0x{flags:02x}"
