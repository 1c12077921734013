"""Guards, which check the measurements of every control cycle; the first violation ends the run."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from whiptool.errors import InputError
from whiptool.limits.arm_limits import XM430
from whiptool.models.numbers import number
from whiptool.rig.dynamixel.control_table import TICKS, WATCHDOG_TRIPPED, in_words
from whiptool.rig.dynamixel.joints import JointSample
from whiptool.rig.stops import SafetyError


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
        missed: Number of consecutive cycles without a sample that is a fault.
        overruns: Number of consecutive cycles that end too late that is a fault.
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
    missed: int = 3
    overruns: int = 5

    def __post_init__(self) -> None:
        for name in ("speed", "current", "temperature", "tracking", "stale", "frozen"):
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

    def sample(self, t: float, s: JointSample, q_d: np.ndarray) -> SafetyError | None:
        """Check a sample at time t [s] with reference q_d [rad], (n,); return the fault, if any."""
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
        return self._stale(t, s) or self._frozen(s, q_d)

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
