"""One emulated servo: motor, registers, access rules and self-protection.

Source: https://emanual.robotis.com/docs/en/dxl/x/xm430-w350/, descriptions of the control table's items.
"""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass

from whiptool.errors import InputError
from whiptool.limits.arm_limits import XM430
from whiptool.models.numbers import number
from whiptool.rig.dynamixel.control_table import (
    CURRENT_MODE,
    TICKS,
    VOLTAGE_UNIT,
    WATCHDOG_TRIPPED,
    WATCHDOG_UNIT,
    XM430_W350,
    Register,
    Units,
)

RATED_VOLTAGE = 12.0  # [V], of the limits of the XM430-W350


@dataclass(frozen=True)
class Motor:
    """Parameters of a motor, all at the output shaft; the default values are those of the XM430-W350 at 12 V.

    The manual gives stall torque, stall current and no-load speed. They fix the winding's resistance `V / i_stall`,
    the back EMF `V / w_0`, and, since an ideal gear would give as many N m/A as V s/rad, the gear's efficiency 0.72.

    Args:
        voltage: Supply voltage [V].
        resistance: Resistance of the winding [ohm].
        back_emf: Back EMF per speed [V s/rad], equal to the torque constant [N m/A] with an ideal gear.
        efficiency: Efficiency of the gear.
        viscous_friction: Viscous friction [N m s/rad].
        dry_friction: Dry friction torque at speeds far above `friction_velocity` [N m].
        friction_velocity: Speed below which dry friction is smoothed [rad/s]; the torque is `-dry_friction v / sqrt(v^2
            + friction_velocity^2)`.
        inertia: Inertia of rotor and gear [kg m^2].

    Raises:
        InputError: A value is not finite, or out of range.
    """

    voltage: float = RATED_VOLTAGE
    resistance: float = RATED_VOLTAGE / XM430.stall_current
    back_emf: float = RATED_VOLTAGE / XM430.no_load_speed
    efficiency: float = XM430.stall_torque / XM430.stall_current / (RATED_VOLTAGE / XM430.no_load_speed)
    viscous_friction: float = 0.0
    dry_friction: float = 0.0
    friction_velocity: float = 0.05
    inertia: float = 0.0

    def __post_init__(self) -> None:
        for name in ("voltage", "resistance", "back_emf", "efficiency", "friction_velocity"):
            object.__setattr__(self, name, number(name, getattr(self, name), low=0, strict=True))
        for name in ("viscous_friction", "dry_friction", "inertia"):
            object.__setattr__(self, name, number(name, getattr(self, name), low=0))
        if self.efficiency > 1:
            raise InputError("efficiency", self.efficiency, "a number > 0 and <= 1")

    @property
    def torque_constant(self) -> float:
        """Torque at the output per current [N m/A]."""
        return self.efficiency * self.back_emf

    def current(self, goal: float, speed: float) -> float:
        """Return the current [A] for a goal [A] at a speed of the output [rad/s], limited by the supply voltage."""
        emf = self.back_emf * speed
        return min(max(goal, (-self.voltage - emf) / self.resistance), (self.voltage - emf) / self.resistance)

    def torque(self, current: float, speed: float) -> float:
        """Return the torque at the output [N m] for a current [A] at a speed [rad/s], less friction."""
        friction = self.viscous_friction * speed
        if self.dry_friction:
            friction += self.dry_friction * speed / math.sqrt(speed * speed + self.friction_velocity**2)
        return self.torque_constant * current - friction


# What a worn-in servo is like: friction of a tenth of the stall torque and less, a rotor of about 0.01 kg m^2 (the
# inertia that models of arms with this servo use). Estimates, not the maker's figures: identify your own.
HARDWARE = Motor(viscous_friction=0.03, dry_friction=0.08, inertia=0.008)


SIZE = max(r.address + r.size for r in XM430_W350.values())
_OWNER: list[Register | None] = [None] * SIZE  # which register holds each byte
for _r in XM430_W350.values():
    _OWNER[_r.address : _r.address + _r.size] = [_r] * _r.size
_INDIRECT = {224 + i: 168 + 2 * i for i in range(28)} | {634 + i: 578 + 2 * i for i in range(28)}
_WHERE = {r.name: (r.address, r.address + r.size, r.signed) for r in XM430_W350.values()}
_FEEDBACK = struct.Struct("<hii")  # Present Current, Velocity and Position are neighbours
_MOST_SHOWN = (2**15 - 1, 2**31 - 1, 2**31 - 1)
_GOALS = ("goal_pwm", "goal_current", "goal_velocity", "goal_position")
_MODES = (0, 1, 3, 4, 5, 16)
RESULT_FAIL, RANGE_ERROR, LENGTH_ERROR, LIMIT_ERROR, ACCESS_ERROR = 1, 4, 5, 6, 7
OVERLOAD, OVERHEATING, INPUT_VOLTAGE = 1 << 5, 1 << 2, 1 << 0


@dataclass(frozen=True)
class Protection:
    """Thresholds at which a servo shuts itself down; they are estimates, as the manual states only the errors.

    Args:
        overload_current: Current above which a servo is overloaded [A].
        overload_time: Duration of an overload after which it shuts down [s].
        ambient: Temperature of a servo at rest [deg C].
        heating: Steady temperature rise per power dissipated in the winding [K/W].
        warming_time: Time constant of the temperature [s].
    """

    overload_current: float = 1.9
    overload_time: float = 2.0
    ambient: float = 30.0
    heating: float = 4.0
    warming_time: float = 200.0


class Servo:
    """An emulated servo: its registers and its state.

    Args:
        id: Id on the bus.
        motor: Motor, for its supply voltage.
        units: Units of the counts.
        baud: Value of Baud Rate(8).
        return_delay: Value of Return Delay Time(9) [2 us].
    """

    def __init__(
        self,
        id: int,
        motor: Motor,
        *,
        units: Units | None = None,
        baud: int = 3,
        return_delay: int = 0,
        protection: Protection | None = None,
    ) -> None:
        self.motor, self.units, self.protection = motor, units or Units(), protection or Protection()
        self._kept = {"id": id, "baud_rate": baud, "return_delay_time": return_delay}
        self._per_count, self._per_speed, self._per_tick = self.units.current, self.units.velocity, self.units.position
        self._volts = round(motor.voltage / VOLTAGE_UNIT)
        self.memory = bytearray(SIZE)
        self.registered: tuple[int, bytes] | None = None
        self.stuck = self.dead = self.deaf = False
        self.heat = 0.0  # [K] above what the model says: an injected fault
        self.temperature = self.protection.ambient
        self._silent = self._overloaded = 0.0  # [s]
        self.q = self.v = self.current = 0.0  # at the output
        for r in XM430_W350.values():
            self.set(r.name, r.default * (self.units.current_scale if r.name == "current_limit" else 1))
        for name, value in self._kept.items():
            self.set(name, value)
        self.boot()

    def get(self, name: str) -> int:
        """Return the value of a register."""
        start, end, signed = _WHERE[name]
        return int.from_bytes(self.memory[start:end], "little", signed=signed)

    def set(self, name: str, value: int) -> None:
        """Set a register, bypassing the access rules for clients."""
        start, end, signed = _WHERE[name]
        self.memory[start:end] = value.to_bytes(end - start, "little", signed=signed or value < 0)

    def boot(self) -> None:
        """Power on: set RAM to its initial values; EEPROM is kept."""
        for r in XM430_W350.values():
            if not r.eeprom:
                self.set(r.name, r.default)
        self._reset_goals()
        self.registered, self._silent, self._overloaded = None, 0.0, 0.0

    def factory_reset(self, option: int) -> bool:
        """Reset registers to their defaults: all for the option 0xFF, all but the id for 1, all but id and baud rate
        for 2. Return False for another option.
        """
        if option not in (0xFF, 1, 2):
            return False
        keep = {0xFF: (), 1: ("id",), 2: ("id", "baud_rate")}[option]
        kept = {name: self.get(name) for name in keep}
        for r in XM430_W350.values():
            self.set(r.name, r.default * (self.units.current_scale if r.name == "current_limit" else 1))
        for name, value in kept.items():
            self.set(name, value)
        self.boot()
        return True

    def _reset_goals(self) -> None:
        """A change of mode sets Goal Current and Goal PWM to their *limits*."""
        self.set("goal_pwm", self.get("pwm_limit"))
        self.set("goal_current", self.get("current_limit"))
        self.set("goal_velocity", 0)
        self.set("profile_acceleration", 0)
        self.set("profile_velocity", 0)

    @property
    def torque_on(self) -> bool:
        """Whether the motor is driven."""
        return bool(self.memory[64]) and not self.dead

    @property
    def shut_down(self) -> bool:
        """Whether a hardware error keeps torque off until a reboot."""
        return bool(self.memory[70] & self.memory[63])

    @property
    def alert(self) -> int:
        """Alert bit of a status packet's error byte: 0x80 while Hardware Error Status (70) is not 0, else 0."""
        return 0x80 if self.memory[70] else 0

    # -- what clients do -----------------------------------------------------------------------------------------

    def heard(self) -> None:
        """Reset the bus watchdog, because an instruction for some servo was received."""
        self._silent = 0.0

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

    def check(self, address: int, data: bytes) -> tuple[int, list[tuple[Register, int]]]:
        """Return the error number of a write, and the registers that it would set, without setting them."""
        if not data or address + len(data) > SIZE:
            return ACCESS_ERROR, []
        bytes_at = {self._resolve(address + i): byte for i, byte in enumerate(data)}
        writes: list[tuple[Register, int]] = []
        for a in sorted(bytes_at):
            r = _OWNER[a]
            if r is None or not r.writable or (r.eeprom and self.memory[64]):
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
        scale = self.units.current_scale if r.name in ("goal_current", "current_limit") else 1
        low, high = r.low * scale, r.high * scale
        if r.name in ("goal_velocity", "goal_position"):
            low, high = -(2**31), 2**31 - 1
        if not low <= value <= high or (r.name == "operating_mode" and value not in _MODES):
            return RANGE_ERROR
        if r.name in _GOALS and self.get("bus_watchdog") == WATCHDOG_TRIPPED:
            return RANGE_ERROR
        if r.name == "goal_current" and abs(value) > self.get("current_limit"):
            return LIMIT_ERROR
        if r.name == "goal_pwm" and abs(value) > self.get("pwm_limit"):
            return LIMIT_ERROR
        if r.name == "torque_enable" and value and self.shut_down:
            return RESULT_FAIL
        return 0

    def write(self, address: int, data: bytes) -> int:
        """Perform a write completely or leave all registers unchanged, and return its error number."""
        error, writes = self.check(address, data)
        for r, value in writes:
            before = self.get(r.name)
            self.set(r.name, value)
            if r.name == "operating_mode" and value != before:
                self._reset_goals()
            elif r.name == "torque_enable" and value and not before:
                self.set("goal_position", self.get("present_position"))
            elif r.name == "current_limit":
                goal = self.get("goal_current")
                self.set("goal_current", max(-value, min(goal, value)))
        return error

    # -- what happens to it --------------------------------------------------------------------------------------

    def goal(self) -> float:
        """Current that the firmware commands [A], by operating mode; 0 with torque off.

        Current mode is exact. Position, velocity and PWM modes are proportional laws with fixed gains, not the
        firmware's controllers.
        """
        if not self.torque_on:
            return 0.0
        mode, units = self.memory[11], self.units
        sign = -1.0 if self.memory[10] & 1 else 1.0  # Drive Mode(10): reverse
        if mode == CURRENT_MODE:
            return sign * self.get("goal_current") * self._per_count
        limit = self.get("current_limit") * units.current
        if mode == 16:
            volts = sign * self.get("goal_pwm") / 885 * self.motor.voltage
            return (volts - self.motor.back_emf * self.v) / self.motor.resistance
        if mode == 1:
            return max(-limit, min(3.0 * (sign * self.get("goal_velocity") * units.velocity - self.v), limit))
        if mode == 5:
            limit = min(limit, abs(self.get("goal_current")) * units.current)
        error = (self.get("goal_position") - self._ticks()) * units.position * sign
        return max(-limit, min(10.0 * error - 1.0 * self.v, limit))

    def _ticks(self) -> int:
        sign = -1 if self.memory[10] & 1 else 1
        return round(sign * self.q / self._per_tick) + 2048 * self.units.fineness + self.get("homing_offset")

    def feel(self, q: float, v: float, current: float, t: float) -> None:
        """Update the measured position q [rad], speed v [rad/s] and current [A] at time t [s]."""
        if not self.stuck:
            self.q, self.v = q, v
        sign = -1 if self.memory[10] & 1 else 1
        self.current = current
        speed = 0 if self.stuck else round(v / self._per_speed)
        shown = sign * round(current / self._per_count), sign * speed, self._ticks()
        # a loop that diverges goes beyond what a register can show, before anybody ends it
        held = [max(-most, min(x, most)) for x, most in zip(shown, _MOST_SHOWN, strict=True)]
        _FEEDBACK.pack_into(self.memory, 126, *held)
        self.set("present_input_voltage", self._volts)
        self.memory[146] = min(255, round(self.temperature + self.heat))
        self.set("realtime_tick", int(t * 1000 + 1e-6) % TICKS)
        self.memory[122] = abs(v) > self.get("moving_threshold") * self._per_speed * self.units.fineness

    def age(self, dt: float) -> None:
        """Advance watchdog, temperature and overload by dt [s]."""
        p = self.protection
        power = self.current**2 * self.motor.resistance
        self.temperature += (p.ambient + p.heating * power - self.temperature) * min(dt / p.warming_time, 1.0)
        self._overloaded = self._overloaded + dt if abs(self.current) > p.overload_current else 0.0
        error = 0
        if self._overloaded > p.overload_time:
            error |= OVERLOAD
        if self.temperature + self.heat > self.get("temperature_limit"):
            error |= OVERHEATING
        if not self.get("min_voltage_limit") <= self._volts <= self.get("max_voltage_limit"):
            error |= INPUT_VOLTAGE
        if error:
            self.memory[70] |= error
        if self.shut_down:
            self.memory[64] = 0
        watchdog = self.get("bus_watchdog")
        if watchdog > 0 and self.memory[64]:
            self._silent += dt
            if self._silent > watchdog * WATCHDOG_UNIT + 1e-9:
                # The manual: "the DYNAMIXEL will stop", its goals read-only until 0 is written to the watchdog. It
                # does not say that Torque Enable is cleared, so it is not; in current mode stopping means zero current.
                self.set("bus_watchdog", WATCHDOG_TRIPPED)
                self.set("goal_current", 0)
                self.set("goal_pwm", 0)
                self.set("goal_velocity", 0)
                self.set("goal_position", self.get("present_position"))

    def __repr__(self) -> str:
        return f"Servo(id={self.get('id')}, torque_on={self.torque_on})"
