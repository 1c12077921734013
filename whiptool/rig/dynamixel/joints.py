"""The servos as joints of the arm, in radians and newton metres, their assumed registers, and guards of a run.

Registers that change the meaning of commands are compared with the assumed values before arming. Guards check the
measurements of every control cycle; the first violation ends the run.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from whiptool.errors import InputError
from whiptool.limits.arm_limits import XM430
from whiptool.models.numbers import number
from whiptool.rig.dynamixel.bus import DynamixelBus
from whiptool.rig.dynamixel.control_table import (
    FIRMWARE,
    RATED_VOLTAGE,
    TICKS,
    VOLTAGE_UNIT,
    WATCHDOG_TRIPPED,
    XM430_W350,
    Units,
    in_words,
    register,
)
from whiptool.rig.dynamixel.encoders import Encoders
from whiptool.rig.stops import SafetyError


@dataclass(frozen=True)
class JointSample:
    """Measurements of all servos in one control cycle; arrays (n,), one value per joint.

    Args:
        q, v: Position [rad], velocity [rad/s].
        current: Measured current [A], positive for positive torque.
        voltage: Voltage of the supply [V].
        temperature: Temperature [deg C].
        hardware_error: Value of the register Hardware Error Status(70), a set of bit flags.
        torque_on: Value of the register Torque Enable(64); 0 with torque off.
        watchdog: Value of the register Bus Watchdog(98); -1 if the watchdog has tripped.
        tick: The servos' clocks [ms], modulo 32768.
        emf: Speed that the motor has at least, as its back EMF tells [rad/s]: of what its voltage and current tell, all
            that exceeds 0.4 rad/s and a quarter of the winding's voltage drop; 0: it may be at rest.
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
    emf: np.ndarray | float = 0.0


class Joints:
    """Servos as joints of the arm, in rad and N m.

    Args:
        bus: Bus with the servos.
        zero: Value of Present Position [counts] at q = 0, where the arm hangs straight down, (n,); default: 2048 each.
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
        """Measure all joints once, and return the sample.

        Raises:
            NoReply, Refused, Unplugged: See `DynamixelBus.read_block`.
        """
        block = np.array(self.bus.read_block())  # (n, 10)
        torque_on, error, watchdog, tick, pwm, current, velocity, position, voltage, temperature = block.T
        units, sign = self.units, self._sign
        drop = current * units.current / XM430.stall_current  # of the winding, as a share of the rated voltage
        emf = pwm / XM430_W350["pwm_limit"].high * voltage * VOLTAGE_UNIT / RATED_VOLTAGE - drop
        sure = np.maximum(0.0, np.abs(emf) - 0.25 * np.abs(drop) - 0.4 / XM430.no_load_speed)
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
            emf=sign * np.sign(emf) * sure * XM430.no_load_speed,
        )

    def positions(self) -> np.ndarray:
        """Measure the positions alone [rad], (n,), also before `DynamixelBus.prepare_block`.

        Raises:
            NoReply, Refused, Unplugged: A servo does not answer.
        """
        counts = np.array([self.bus.read(id, "present_position") for id in self.bus.ids])
        return self._sign * (counts - self._zero) * self.units.position

    def counts(self, torque: np.ndarray) -> np.ndarray:
        """Return Goal Current [counts] for joint torques [N m], (n,), clipped to the current limit."""
        counts = np.rint(torque * self._per_torque)
        return np.clip(counts, -self.current_limit, self.current_limit).astype(int)

    def torque(self, counts: np.ndarray) -> np.ndarray:
        """Return the joint torques [N m], (n,), that correspond to Goal Currents [counts]."""
        return counts / self._per_torque


NO_SECONDARY_ID = 253  # and above: the servo listens to its own id alone


@dataclass(frozen=True)
class Assumed:
    """A servo register and the value that strikes require.

    Args:
        name: Name of the register.
        value: Value that `--for-strikes` sets, which is the manufacturer's default.
        meaning: Purpose of the register, for messages.
        holds: Function that returns whether a value is acceptable; None: only `value` is.
        since: First firmware that has the register.
    """

    name: str
    value: int
    meaning: str
    holds: Callable[[int], bool] | None = None
    since: int = 0

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
    Assumed("startup_configuration", 0, "its torque is off after a reboot", since=FIRMWARE),
)


def mismatches(bus: DynamixelBus, id: int) -> list[tuple[Assumed, int]]:
    """Return the registers of a servo whose values strikes do not accept, with these values.

    Raises:
        NoReply, Refused, Unplugged: The servo does not answer.
    """
    firmware = bus.read(id, "firmware_version")
    found = [(assumed, bus.read(id, assumed.name)) for assumed in ASSUMED if firmware >= assumed.since]
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


@dataclass(frozen=True)
class Guards:
    """Limits of a run; exceeding one ends it in a fault.

    Args:
        low, high: Lowest and highest joint positions [rad]: a single number for all joints, or one for each.
        speed: Largest speed of a joint [rad/s]; default: 1.25 times the motor's no-load speed.
        current: Largest measured current [A].
        temperature: Highest temperature [deg C]; the servo's own limit is 80.
        voltage: Lowest supply voltage [V].
        tracking: Largest tracking error of a joint [rad].
        stale: Largest lag of the servos' clocks behind the loop's between two samples [s].
        frozen: Largest movement of the reference while a joint's encoder does not change [rad].
        push: Largest mean torque beyond gravity's [N m] while a joint's encoder changes by a count at most.
        jump: Largest difference between a joint's change of position and what its velocities say [rad], see `Encoders`.
        missed: Number of consecutive cycles without a sample at which the run ends.
        overruns: Number of consecutive cycles ending too late at which the run ends.
    """

    low: float | tuple[float, ...] = -3.5
    high: float | tuple[float, ...] = 4.5
    speed: float = 1.25 * XM430.no_load_speed
    current: float = 2.6
    temperature: float = 70.0
    voltage: float = 9.5
    tracking: float = 1.2
    stale: float = 0.01
    frozen: float = 0.3
    push: float = 1.5
    jump: float = 0.01
    missed: int = 3
    overruns: int = 5

    def __post_init__(self) -> None:
        for name in ("speed", "current", "temperature", "tracking", "stale", "frozen", "push", "jump"):
            number(name, getattr(self, name), low=0, strict=True)
        if np.any(np.asarray(self.low) >= np.asarray(self.high)):
            raise InputError("low, high", (self.low, self.high), "low below high")
        if self.missed < 1 or self.overruns < 1:
            raise InputError("missed, overruns", (self.missed, self.overruns), "whole numbers >= 1")


class Watch:
    """Checks every cycle of a run against the guards, and returns the first violation."""

    def __init__(self, guards: Guards, joints: int) -> None:
        self.guards = guards
        self._missed = self._overruns = 0
        self._tick: tuple[float, np.ndarray] | None = None  # time and servo clocks of the last sample
        self._encoders = Encoders(joints, jump=guards.jump, push=guards.push)
        self._still_q: np.ndarray | None = None  # of each joint: where its encoder stands ..
        self._still_ref = np.zeros(joints)  # .. and where the reference was when it came there

    def missed(self, why: str = "") -> SafetyError | None:
        """Count a cycle without a sample; return the fault if there were too many in a row.

        Args:
            why: Error message of the bus.
        """
        self._missed += 1
        if self._missed >= self.guards.missed:
            return SafetyError("missed", f"no sample in {self._missed} cycles in a row" + (f": {why}" if why else ""))
        return None

    def timing(self, overran: bool) -> SafetyError | None:
        """Record whether a cycle ended too late; return the fault if there were too many in a row."""
        self._overruns = self._overruns + 1 if overran else 0
        if self._overruns >= self.guards.overruns:
            return SafetyError("overrun", f"{self._overruns} cycles in a row ended too late")
        return None

    def sample(self, t: float, s: JointSample, q_d: np.ndarray, *forces: np.ndarray) -> SafetyError | None:
        """Check a sample at time t [s], reference q_d [rad], (n,); return a fault. `forces` are load and inertia as in
        `Encoders.read`.
        """
        g = self.guards
        self._missed = 0
        lag = q_d - s.q
        fine = (
            (s.hardware_error == 0)
            & (s.watchdog != WATCHDOG_TRIPPED)
            & (s.torque_on != 0)
            & (s.q >= g.low)
            & (s.q <= g.high)
            & (np.abs(s.v) <= g.speed)
            & (np.abs(s.current) <= g.current)
            & (s.temperature <= g.temperature)
            & (s.voltage >= g.voltage)
            & (np.abs(lag) <= g.tracking)
        )
        if not fine.all():
            return self._name(s, lag)
        return self._stale(t, s) or self._encoders.read(s.q, s.v, s.tick, s.emf, *forces) or self._frozen(s, q_d)

    def _name(self, s: JointSample, lag: np.ndarray) -> SafetyError:
        """The limit that a bad sample exceeds, the gravest first."""
        g = self.guards
        if s.hardware_error.any():
            i = int(s.hardware_error.argmax())
            return SafetyError("hardware", f"joint {i} reports {in_words(int(s.hardware_error[i]))}")
        if (s.watchdog == WATCHDOG_TRIPPED).any():
            return SafetyError("watchdog", "a servo's bus watchdog has tripped")
        if not s.torque_on.all():
            return SafetyError("torque", "a servo's torque is off: it lost power or shut itself down")
        for kind, value, good in (
            ("position", s.q, (s.q >= g.low) & (s.q <= g.high)),
            ("speed", s.v, np.abs(s.v) <= g.speed),
            ("current", s.current, np.abs(s.current) <= g.current),
            ("temperature", s.temperature, s.temperature <= g.temperature),
            ("voltage", s.voltage, s.voltage >= g.voltage),
            ("tracking", lag, np.abs(lag) <= g.tracking),
        ):
            if not good.all():
                i = int(np.argmin(good))
                return SafetyError(kind, f"joint {i}: {float(value[i]):.4g}")
        return SafetyError("sample", "a measured value is not a number")

    def _stale(self, t: float, s: JointSample) -> SafetyError | None:
        last, self._tick = self._tick, (t, s.tick)
        if last is None:
            return None
        behind = t - last[0] - ((s.tick - last[1]) % TICKS) * 1e-3
        if (np.abs(behind) > self.guards.stale).any():
            return SafetyError("stale", f"the servos' clocks and the loop's differ by {np.abs(behind).max():.3f} s")
        return None

    def _frozen(self, s: JointSample, q_d: np.ndarray) -> SafetyError | None:
        moved = np.ones(len(s.q), bool) if self._still_q is None else s.q != self._still_q
        self._still_q = s.q
        self._still_ref = np.where(moved, q_d, self._still_ref)
        gone = np.abs(q_d - self._still_ref)
        if (gone > self.guards.frozen).any():
            i = int(gone.argmax())
            return SafetyError("frozen", f"the encoder of joint {i} stands still while it should move")
        return None
