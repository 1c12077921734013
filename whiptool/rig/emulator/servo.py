"""One emulated servo: what its registers do, its state, and its self-protection.

Source: https://emanual.robotis.com/docs/en/dxl/x/xm430-w350/, descriptions of the control table's items.
"""

from __future__ import annotations

import struct

from whiptool.rig.dynamixel.control_table import (
    CURRENT_BASED_MODE,
    CURRENT_MODE,
    EXTENDED_MODE,
    POSITION_MODE,
    PWM_MODE,
    TICKS,
    VELOCITY_MODE,
    VOLTAGE_UNIT,
    WATCHDOG_TRIPPED,
    WATCHDOG_UNIT,
    XM430_W350,
    Register,
    Units,
)
from whiptool.rig.emulator.controllers import FULL_PWM, OFF, REVERSE, TORQUE_ON_BY_GOAL, Controllers, Drive
from whiptool.rig.emulator.memory import GAINS, GOAL_OF, GOAL_UNDER, KEPT_RAM, Memory
from whiptool.rig.emulator.motor import Motor, Protection

# Realtime Tick, Moving and its status, Present PWM, Current, Velocity and Position, the trajectories of velocity and
# position, Present Input Voltage and Temperature are neighbours
_FEEDBACK = struct.Struct("<HBBhhiiiiHB")
_MOST_SHOWN = (2**15 - 1,) * 2 + (2**31 - 1,) * 4  # of the registers with a sign
_TURN = 4096  # [counts]
_NO_HOMING = bytes(4)
_MOST_HOMING = 1_024  # [counts], largest Homing Offset that has an effect in position mode
# Whether a servo is at its goal, or no longer follows its trajectory [counts]; the manual does not give these values
IN_POSITION, NOT_FOLLOWING = 20, 100
OVERLOAD, OVERHEATING, INPUT_VOLTAGE = 1 << 5, 1 << 2, 1 << 0
TORQUE_AT_STARTUP, RESTORE_AT_STARTUP = 1, 2  # bits of Startup Configuration(60)


class Servo(Memory):
    """An emulated servo: its registers and its state.

    It is switched on at q = 0, where the count of turns begins, and then put where the arm starts.

    Args:
        id: Id on the bus.
        motor: Motor, for its supply voltage.
        units: Units of the counts.
        baud: Value of Baud Rate(8).
        return_delay: Value of Return Delay Time(9) [2 us].
        protection: Thresholds at which the servo shuts itself down.
        reboot_time: Time for which it does not answer after a reboot [s].
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
        reboot_time: float = 0.0,
    ) -> None:
        super().__init__(units or Units())
        self.motor, self.protection, self.reboot_time = motor, protection or Protection(), reboot_time
        self._per_count, self._per_speed, self._per_tick = self.units.current, self.units.velocity, self.units.position
        self.volts = motor.voltage  # [V] of the supply
        self.registered: tuple[int, bytes] | None = None
        self.stuck = self.flickers = self.dead = self.deaf = False
        self.jump = 0.0  # [rad] by which the encoder's reading is off
        self._flicker, self._turns = 0, 0.0  # [counts], and speed whatever the encoder says [rad/s]
        self.heat = 0.0  # [K] above what the model says: an injected fault
        self.temperature = self.protection.ambient
        self._silent = self._overloaded = self.booting = 0.0  # [s]
        self.q = self.v = self.current = 0.0  # at the output
        self._fine = self.units.fineness
        self._zero = _TURN // 2 * self._fine  # Present Position at q = 0 without Homing Offset [counts]
        self._t = self._born = 0.0  # [s], of the last measurement and of the last boot
        self._backup: dict[str, int] = {}
        self.controllers = Controllers(self, fineness=self._fine, ampere=self._per_count)
        self._switch_on(id=id, baud_rate=baud, return_delay_time=return_delay)

    def _switch_on(self, **kept: int) -> None:
        for name, value in kept.items():
            self.set(name, value)
        self.boot()
        self.booting = 0.0

    # -- boots ---------------------------------------------------------------------------------------------------

    def boot(self) -> None:
        """Power on: set RAM to its initial values or to the backup; EEPROM is kept. It does not answer for a while."""
        for r in XM430_W350.values():
            if not r.eeprom:
                self.set(r.name, self.default(r))
        self._reset_goals()
        if self.get("startup_configuration") & RESTORE_AT_STARTUP:
            for name in KEPT_RAM:
                self.set(name, self._backup.get(name, self.get(name)))
        self.set("backup_ready", bool(self._backup))
        self.registered, self._silent, self._overloaded, self._born = None, 0.0, 0.0, self._t
        self.current, self.booting = 0.0, self.reboot_time
        self.within_one_turn()
        if not self.booting:
            self._wake()

    def _wake(self) -> None:
        """The boot is over: it holds where it is, if Startup Configuration(60) says so."""
        self.set("goal_position", self._ticks())
        self.controllers.rest(self._ticks() / self._fine)
        self.set("torque_enable", self.get("startup_configuration") & TORQUE_AT_STARTUP)
        self.show()

    def factory_reset(self, option: int) -> bool:
        """Reset registers to their defaults: all for the option 0xFF, all but the id for 1, all but id and baud rate
        for 2. Return False for another option.
        """
        if option not in (0xFF, 1, 2):
            return False
        keep = {0xFF: (), 1: ("id",), 2: ("id", "baud_rate")}[option]
        kept = {name: self.get(name) for name in keep}
        for r in XM430_W350.values():
            self.set(r.name, self.default(r))
        self._switch_on(**kept)
        return True

    def backup(self) -> bool:
        """Keep EEPROM, gains, profile and indirect addresses; return False, and do nothing, with torque on."""
        if self.torque_on:
            return False
        names = [r.name for r in XM430_W350.values() if r.eeprom and r.writable]
        self._backup = {name: self.get(name) for name in (*names, *KEPT_RAM)}
        self.set("backup_ready", 1)
        return True

    def restore(self) -> bool:
        """Restore EEPROM from the backup and reboot; return False, and do nothing, with torque on or no backup."""
        if self.torque_on or not self._backup:
            return False
        for name, value in self._backup.items():
            if XM430_W350[name].eeprom:
                self.set(name, value)
        self.boot()
        return True

    def _reset_goals(self) -> None:
        """A change of mode resets gains and profile, and sets Goal Current and Goal PWM to their *limits*."""
        self.set("goal_pwm", self.get("pwm_limit"))
        self.set("goal_current", self.get("current_limit"))
        for name in ("goal_velocity", "profile_acceleration", "profile_velocity", *GAINS):
            self.set(name, XM430_W350[name].default)

    # -- state ---------------------------------------------------------------------------------------------------

    @property
    def torque_on(self) -> bool:
        """Whether the motor is driven."""
        return bool(self.memory[64]) and not self.dead

    @property
    def hears(self) -> bool:
        """Whether it hears what is said on the line: it has power, the line's baud rate, and has booted."""
        return not (self.dead or self.deaf or self.booting)

    @property
    def alert(self) -> int:
        """Alert bit of a status packet's error byte: 0x80 while Hardware Error Status (70) is not 0, else 0."""
        return 0x80 if self.memory[70] else 0

    # -- what clients do -----------------------------------------------------------------------------------------

    def heard(self) -> None:
        """Reset the bus watchdog, because an instruction for some servo was received."""
        self._silent = 0.0

    def write(self, address: int, data: bytes, *, eeprom: bool = True) -> int:
        """Write bytes to the registers from `address` on, all of them or none; return the error number, 0 for none."""
        error, writes = self.check(address, data, eeprom=eeprom)
        for r, value in writes:
            was = self.get(r.name)
            self.set(r.name, value)
            self._take_effect(r, value, changed=value != was)
        goal = GOAL_OF[self.memory[11]]
        if any(r.name == goal for r, _ in writes):  # after all registers, so that the profile is of their new values
            self._begin()
        return error

    def _take_effect(self, r: Register, value: int, *, changed: bool) -> None:
        name = r.name
        if name == "operating_mode" and changed:
            self._reset_goals()
            if value in (POSITION_MODE, EXTENDED_MODE):
                self.within_one_turn()
        elif name == "torque_enable" and value and changed:
            self._start()
            self.set("goal_position", self._ticks())
            if self.memory[11] == VELOCITY_MODE:
                self.controllers.go()
        elif name in GOAL_UNDER:
            most = value * (self._fine if name == "velocity_limit" else 1)
            self.set(GOAL_UNDER[name], max(-most, min(self.get(GOAL_UNDER[name]), most)))
        elif name in ("homing_offset", "drive_mode"):
            self.show()

    def _start(self) -> None:
        """Torque is switched on."""
        if self.memory[11] == POSITION_MODE:
            self.within_one_turn()
        self.controllers.rest(self._ticks() / self._fine)

    def _begin(self) -> None:
        """The goal of the mode was written: begin its profile; Drive Mode(10) may have it switch torque on."""
        if not self.memory[64] and self.memory[10] & TORQUE_ON_BY_GOAL and not self.shut_down:
            self._start()
            self.set("torque_enable", 1)
        if self.memory[64] and self.memory[11] not in (CURRENT_MODE, PWM_MODE):
            self.controllers.go()
            self.show()

    def clear_turns(self) -> bool:
        """Bring Present Position within one turn; return False, and do nothing, while it moves. The manual does not say
        what becomes of a goal that is held: it comes along, so that the servo stays where it is.
        """
        if self.memory[122]:
            return False
        before = self._zero
        self.within_one_turn()
        if self.torque_on:
            self.set("goal_position", self.get("goal_position") + self._zero - before)
            self.controllers.rest(self.get("goal_position") / self._fine)
            self.show()
        return True

    def within_one_turn(self) -> None:
        """Forget the turns: Present Position without Homing Offset is within 0 and 4095 counts from now on."""
        turn, half = _TURN * self._fine, _TURN // 2 * self._fine
        self._zero = half - (self._ticks() - self._homing() - self._zero + half) // turn * turn
        self.show()

    # -- what happens to it --------------------------------------------------------------------------------------

    @property
    def _sign(self) -> int:
        return -1 if self.memory[10] & REVERSE else 1

    def drive(self) -> Drive:
        """Return the current that is wanted [A], and the lowest and highest voltage [V], at the output."""
        if not self.torque_on:
            return OFF
        current, low, high = self.controllers.drive(self.volts)
        return (current, low, high) if self._sign > 0 else (-current, -high, -low)

    def control(self) -> None:
        """Go on by one period of the controllers, with torque on."""
        if self.torque_on:
            self.controllers.step(self._ticks() / self._fine, self._sign * self.v / self._per_speed / self._fine)

    def _homing(self) -> int:
        homing = self.get("homing_offset")
        ignored = self.memory[11] == POSITION_MODE and abs(homing) > _MOST_HOMING * self._fine
        return 0 if ignored else homing

    def _ticks(self) -> int:
        ticks = self._sign * round((self.q + self.jump) / self._per_tick) + self._zero + self._flicker
        return ticks + self._homing() if self.memory[20:24] != _NO_HOMING else ticks

    def feel(self, q: float, v: float, current: float, t: float) -> None:
        """Update the measured position q [rad], speed v [rad/s] and current [A] at time t [s]."""
        self._flicker, self._turns = int(self.flickers and not self._flicker), v
        if not self.stuck:
            self.q, self.v = q, v
        self.current, self._t = current, t
        self.show()

    def show(self) -> None:
        """Write measured and planned values into the registers: tick, PWM, current, velocity, position, voltage, ..."""
        memory, sign, ticks, pwm = self.memory, self._sign, self._ticks(), 0
        speed = 0 if self.stuck else sign * round(self.v / self._per_speed)
        planned = (False, 0, 0, ticks)
        if self.torque_on:
            volts = self.current * self.motor.resistance + self.motor.back_emf * self._turns
            pwm = sign * round(volts / self.volts * FULL_PWM)
            if memory[11] not in (CURRENT_MODE, PWM_MODE):
                planned = self._planned(ticks)
        moving = planned[0] or abs(speed) > (memory[24] | memory[25] << 8) * self._fine
        milliseconds = int((self._t - self._born) * 1000 + 1e-6)
        warm = min(255, round(self.temperature + self.heat))
        measured = (pwm, sign * round(self.current / self._per_count), speed, ticks, *planned[2:])
        shown = milliseconds % TICKS, moving, planned[1]
        supply = round(self.volts / VOLTAGE_UNIT), warm
        try:
            _FEEDBACK.pack_into(memory, 120, *shown, *measured, *supply)
        except struct.error:  # a loop that diverges goes beyond what a register can show, before anybody ends it
            held = [max(-most, min(x, most)) for x, most in zip(measured, _MOST_SHOWN, strict=True)]
            _FEEDBACK.pack_into(memory, 120, *shown, *held, *supply)

    def _planned(self, ticks: int) -> tuple[bool, int, int, int]:
        """Whether a profile to a position is in progress, Moving Status, Velocity and Position Trajectory."""
        p, v = self.controllers.trajectory()
        v = round(v * self._fine)
        if self.memory[11] == VELOCITY_MODE:
            return False, 0, v, ticks
        p, ongoing = round(p * self._fine), self.controllers.ongoing
        arrived = abs(self.get("goal_position") - ticks) <= IN_POSITION * self._fine
        lost = abs(p - ticks) > NOT_FOLLOWING * self._fine
        return ongoing, arrived | ongoing << 1 | lost << 3 | self.controllers.profile.kind << 4, v, p

    def age(self, dt: float) -> None:
        """Advance watchdog, temperature, overload and boot by dt [s]."""
        p = self.protection
        if self.booting:
            self.booting = max(0.0, self.booting - dt)
            if not self.booting:
                self._wake()
        power = self.current**2 * self.motor.resistance
        self.temperature += (p.ambient + p.heating * power - self.temperature) * min(dt / p.warming_time, 1.0)
        self._overloaded = self._overloaded + dt if abs(self.current) > p.overload_current else 0.0
        error = 0
        if self._overloaded > p.overload_time:
            error |= OVERLOAD
        if self.temperature + self.heat > self.get("temperature_limit"):
            error |= OVERHEATING
        if not self.get("min_voltage_limit") <= round(self.volts / VOLTAGE_UNIT) <= self.get("max_voltage_limit"):
            error |= INPUT_VOLTAGE
        if error:
            self.memory[70] |= error
        if self.shut_down:
            self.memory[64] = 0
        watchdog = self.get("bus_watchdog")
        if watchdog > 0 and self.memory[64]:
            self._silent += dt
            if self._silent > watchdog * WATCHDOG_UNIT + 1e-9:
                self._stop()

    def _stop(self) -> None:
        """The watchdog stops the servo and clears its goals and profile.

        The manual: "the DYNAMIXEL will stop", its goals read-only until 0 is written to the watchdog. It does not say
        that Torque Enable is cleared, so it is not: in current mode stopping means zero current, in position and
        velocity modes holding where it is. Goal PWM, and Goal Current in current-based position mode, are limits there
        and stay.
        """
        self.set("bus_watchdog", WATCHDOG_TRIPPED)
        mode = self.memory[11]
        if mode == PWM_MODE:
            self.set("goal_pwm", 0)
        if mode != CURRENT_BASED_MODE:
            self.set("goal_current", 0)
        for name in ("goal_velocity", "profile_acceleration", "profile_velocity"):
            self.set(name, 0)
        self.set("goal_position", self._ticks())
        self.controllers.rest(self._ticks() / self._fine)

    def __repr__(self) -> str:
        return f"Servo(id={self.get('id')}, torque_on={self.torque_on})"
