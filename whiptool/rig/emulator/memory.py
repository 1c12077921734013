"""The registers of an emulated servo, and which writes it refuses.

Source: https://emanual.robotis.com/docs/en/dxl/x/xm430-w350/, descriptions of the control table's items, and
https://emanual.robotis.com/docs/en/dxl/protocol2/, "Error", for the numbers of the errors.
"""

from __future__ import annotations

from whiptool.rig.dynamixel.control_table import (
    CURRENT_BASED_MODE,
    CURRENT_MODE,
    EXTENDED_MODE,
    POSITION_MODE,
    PWM_MODE,
    VELOCITY_MODE,
    WATCHDOG_TRIPPED,
    XM430_W350,
    Register,
    Units,
)

RESULT_FAIL, RANGE_ERROR, LENGTH_ERROR, LIMIT_ERROR, ACCESS_ERROR = 1, 4, 5, 6, 7
SIZE = max(r.address + r.size for r in XM430_W350.values())
_OWNER: list[Register | None] = [None] * SIZE  # which register holds each byte
for _r in XM430_W350.values():
    _OWNER[_r.address : _r.address + _r.size] = [_r] * _r.size
_INDIRECT = {224 + i: 168 + 2 * i for i in range(28)} | {634 + i: 578 + 2 * i for i in range(28)}
_WHERE = {r.name: (r.address, r.address + r.size, r.signed) for r in XM430_W350.values()}
GOAL_OF = {
    CURRENT_MODE: "goal_current", VELOCITY_MODE: "goal_velocity", POSITION_MODE: "goal_position",
    EXTENDED_MODE: "goal_position", CURRENT_BASED_MODE: "goal_position", PWM_MODE: "goal_pwm",
}  # fmt: skip
GOAL_UNDER = {"current_limit": "goal_current", "pwm_limit": "goal_pwm", "velocity_limit": "goal_velocity"}
GAINS = tuple(name for name in XM430_W350 if name.endswith("_gain"))
# What a backup keeps besides EEPROM, and a boot restores if Startup Configuration(60) says so
KEPT_RAM = (*GAINS, "profile_acceleration", "profile_velocity", *(f"indirect_address_{i}" for i in range(1, 57)))
LEADER_BIT = 2  # of Drive Mode(10); the XM430 has no leader and follower
LONGEST_PROFILE = 32_737  # [ms], of a time-based profile
# Protocol 1.0 is not emulated, and a servo set to it would be lost: a real one takes 1 here
_ONLY_PROTOCOL = 2


class Memory:
    """The registers of a servo.

    Args:
        units: Units of the counts.
    """

    def __init__(self, units: Units) -> None:
        self.units = units
        self.memory = bytearray(SIZE)
        for r in XM430_W350.values():
            self.set(r.name, self.default(r))

    def default(self, r: Register) -> int:
        """Return the initial value of a register, in the counts of this servo."""
        return r.default * (self.units.current_scale if r.name == "current_limit" else 1)

    def get(self, name: str) -> int:
        """Return the value of a register."""
        start, end, signed = _WHERE[name]
        return int.from_bytes(self.memory[start:end], "little", signed=signed)

    def set(self, name: str, value: int) -> None:
        """Set a register, bypassing the access rules for clients."""
        start, end, signed = _WHERE[name]
        self.memory[start:end] = value.to_bytes(end - start, "little", signed=signed or value < 0)

    @property
    def shut_down(self) -> bool:
        """Whether a hardware error keeps torque off until a reboot."""
        return bool(self.memory[70] & self.memory[63])

    def read(self, address: int, length: int) -> tuple[int, bytes]:
        """Return error number and bytes of a read; gaps between registers read as zero."""
        end = address + length
        if length < 1 or end > SIZE or not any(_OWNER[address:end]):
            return ACCESS_ERROR, b""
        if address in _INDIRECT or (end - 1) in _INDIRECT:
            return 0, bytes([self.memory[self._resolve(a)] for a in range(address, end)])
        return 0, bytes(self.memory[address:end])

    def _resolve(self, address: int) -> int:
        """Where an indirect data byte leads; any other address is itself."""
        pointer = _INDIRECT.get(address)
        return address if pointer is None else self.memory[pointer] | self.memory[pointer + 1] << 8

    def check(self, address: int, data: bytes, *, eeprom: bool = True) -> tuple[int, list[tuple[Register, int]]]:
        """Return the error number of a write, and the registers that it would set, without setting them.

        Args:
            eeprom: Whether EEPROM may be written, which it may not through the Secondary ID.
        """
        if not data or address + len(data) > SIZE:
            return ACCESS_ERROR, []
        bytes_at = {self._resolve(address + i): byte for i, byte in enumerate(data)}
        writes: list[tuple[Register, int]] = []
        for a in sorted(bytes_at):
            r = _OWNER[a]
            if r is None or not r.writable or (r.eeprom and (self.memory[64] or not eeprom)):
                return ACCESS_ERROR, []
            if any(r.address + i not in bytes_at for i in range(r.size)):
                return LENGTH_ERROR, []
            if a == r.address:
                value = r.decode(bytes(bytes_at[a + i] for i in range(r.size)))
                error = self._refuse(r, value)
                if error:
                    return error, []
                writes.append((r, value))
        return 0, writes

    def _refuse(self, r: Register, value: int) -> int:
        """Error number of a value: first the register's own range, then what other registers limit it to."""
        scale = self.units.current_scale if r.name in ("goal_current", "current_limit") else 1
        if r.name in ("goal_velocity", "goal_position"):
            scale = self.units.fineness
        if not r.low * scale <= value <= r.high * scale:
            in_limits = r.name == "goal_position" and self.memory[11] == POSITION_MODE
            return LIMIT_ERROR if in_limits or r.name == "goal_velocity" else RANGE_ERROR
        if (r.name == "operating_mode" and value not in GOAL_OF) or (r.name == "drive_mode" and value & LEADER_BIT):
            return RANGE_ERROR
        if r.name == "protocol_version" and value != _ONLY_PROTOCOL:
            return RANGE_ERROR
        if r.name.startswith("profile_") and self.memory[10] & 4 and value > LONGEST_PROFILE:
            return RANGE_ERROR
        if r.name == "torque_enable" and value and self.shut_down:
            return RESULT_FAIL
        return self._refuse_goal(r.name, value) if r.name in GOAL_OF.values() else 0

    def _refuse_goal(self, name: str, value: int) -> int:
        if self.get("bus_watchdog") == WATCHDOG_TRIPPED:
            return RANGE_ERROR
        fine = self.units.fineness
        if name == "goal_position":
            if self.memory[11] != POSITION_MODE:
                return 0
            low, high = self.get("min_position_limit") * fine, (self.get("max_position_limit") + 1) * fine - 1
            return 0 if low <= value <= high else LIMIT_ERROR
        limit = {
            "goal_pwm": self.get("pwm_limit"),
            "goal_current": self.get("current_limit"),
            "goal_velocity": self.get("velocity_limit") * fine,
        }[name]
        return 0 if abs(value) <= limit else LIMIT_ERROR
