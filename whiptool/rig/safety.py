"""Arming and disarming of the servos, and the reaction to faults.

Every fault ends in zero current and torque off. If the line to the servos is lost, their bus watchdog stops them. None
of this replaces a switch that cuts the servos' power, within reach of everyone near the whip.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from enum import IntEnum
from types import TracebackType

import numpy as np

from whiptool.models.numbers import number
from whiptool.rig.dynamixel.control_table import CURRENT_MODE, WATCHDOG_UNIT, in_words, register
from whiptool.rig.dynamixel.joints import Joints, JointSample, check_registers
from whiptool.rig.dynamixel.line import BusError, NoReply, Refused, Unplugged
from whiptool.rig.stops import Interlock, SafetyError, torque_in_words
from whiptool.stop_signals import signals_held


class State(IntEnum):
    """State of the servos' arming."""

    DISARMED = 0  # torque off
    ARMED = 1  # torque on, no current yet
    RUNNING = 2  # currents are commanded
    FAULT = 3  # something was wrong; torque off, until it is armed again


class Safety:
    """Arms, commands and disarms the servos; no other code writes Goal Current or Torque Enable.

    Used as a context manager, the object switches the motors off in any case at the end of the block. After a stop its
    interlock refuses to arm again, until a person has released it.

    Args:
        joints: The servos.
        current: Current limit while armed [A].
        watchdog: Time without instructions after which a servo stops [s], 0.04 to 0.1.
        attempts: Largest number of attempts to switch torque off until every servo confirms it.
        interlock: Interlock that is set after a stop; default: a new one.
    """

    def __init__(
        self,
        joints: Joints,
        *,
        current: float = 2.3,
        watchdog: float = 0.06,
        attempts: int = 5,
        interlock: Interlock | None = None,
    ) -> None:
        highest = 1193 * 2.69e-3
        self.current = number("current", current, low=0, high=highest, strict=True)
        self.watchdog = number("watchdog", watchdog, low=0.04, high=0.1)
        self.joints, self.attempts, self.interlock = joints, attempts, interlock or Interlock()
        self.state = State.DISARMED
        self.reason: SafetyError | None = None
        self._touched = False  # whether a servo may be on
        self._silent: list[int] = []  # ids of servos that did not say that their torque is off
        self.confirmed = False  # whether every servo said that its torque is off
        self.last = np.zeros(joints.n, int)  # Goal Current of the last cycle [counts]

    @property
    def torque(self) -> str:
        """State of the motors as text."""
        return torque_in_words(self.confirmed, self._silent)

    def _tell(self) -> None:
        """Have whoever tells of a stop know what became of the motors."""
        self.interlock.torque_off, self.interlock.torque = self.confirmed, self.torque

    def check(self) -> None:
        """Check that the servos may be armed, before anything is written to them.

        Raises:
            Locked: The arm was stopped, and no person has released it.
            InputError: A servo has register values that strikes do not accept.
            NoReply, Refused, Unplugged: A servo does not answer.
        """
        self.interlock.check()
        check_registers(self.joints.bus)

    def arm(self, interruptible: Callable[[], AbstractContextManager[None]] = nullcontext) -> JointSample:
        """Arm the servos: torque off, limits, mode, Goal Current 0 (which is verified), watchdog, torque on.

        Goal Current is read back because a change of mode sets it to the current limit.

        Args:
            interruptible: Context manager for switching torque on, within which a stop signal raises KeyboardInterrupt
                at once.

        Returns:
            A sample of the joints.

        Raises:
            Locked: The arm was stopped, and no person has released it.
            SafetyError: A step failed; torque is off.
            KeyboardInterrupt: A signal came; torque is off.
        """
        if self.state in (State.ARMED, State.RUNNING):
            raise SafetyError("arm", f"the arm is {self.state.name}")
        self.interlock.check()
        bus, joints = self.joints.bus, self.joints
        self.reason, self.confirmed, self._touched = None, False, True
        self._silent = list(bus.ids)
        self._tell()
        try:
            for id in bus.ids:
                self._set_up(id)
            joints.current_limit = self._limit
            bus.prepare_block()
            sample = joints.read()
            for id in bus.ids:
                bus.write(id, "bus_watchdog", round(self.watchdog / WATCHDOG_UNIT))
            with interruptible():
                for id in bus.ids:
                    bus.write(id, "torque_enable", 1)
        except KeyboardInterrupt:
            self.fault(SafetyError("signal", "a signal to stop came while arming"))
            raise
        except (BusError, SafetyError) as error:
            self.fault(error if isinstance(error, SafetyError) else SafetyError("line", str(error)))
            assert self.reason is not None
            raise self.reason from error
        self.last[:] = 0
        self.state = State.ARMED
        return sample

    @property
    def _limit(self) -> int:
        """Current limit [counts]."""
        return int(self.current / self.joints.units.current)

    def _set_up(self, id: int) -> None:
        """Set up one servo, its torque off, and see that it took everything."""
        bus = self.joints.bus
        bus.write(id, "torque_enable", 0)
        bus.write(id, "bus_watchdog", 0)
        error = bus.read(id, "hardware_error_status")
        if error:
            fix = f"find the cause, then `python -m whiptool.rig.dynamixel --port {bus.device} --reboot {id}`"
            raise SafetyError("hardware", f"servo {id} reports {in_words(error)}; {fix}")
        wanted = {
            "current_limit": self._limit,
            "operating_mode": CURRENT_MODE,
            "goal_pwm": register("pwm_limit").default,  # it limits the voltage in current mode
            "goal_current": 0,
        }
        for name, value in wanted.items():
            bus.write(id, name, value)
        for name, value in wanted.items():
            found = bus.read(id, name)
            if found != value:
                raise SafetyError("arm", f"servo {id}: {name} is {found}, not {value}")

    def command(self, torque: np.ndarray) -> tuple[np.ndarray, bool]:
        """Send joint torques [N m], (n,).

        Returns:
            Goal Currents that were sent [counts], (n,), and whether they were clipped to the limit.

        Raises:
            SafetyError: The arm is not armed, or the torque is not finite.
            Unplugged: The port is gone.
        """
        if not np.isfinite(torque).all():
            raise SafetyError("controller", f"the controller asked for {torque.tolist()} N m, which is not finite")
        wanted = self.joints.counts(torque)
        cut = bool((np.abs(torque - self.joints.torque(wanted)) > self.joints.quantum).any())
        return self._send(wanted), cut

    def hold(self) -> np.ndarray:
        """Send the Goal Currents of the last cycle again, and return them [counts], (n,).

        Raises:
            SafetyError, Unplugged: As in `command`.
        """
        return self._send(self.last)

    def _send(self, counts: np.ndarray) -> np.ndarray:
        if self.state not in (State.ARMED, State.RUNNING):
            raise SafetyError("command", f"no torque while the arm is {self.state.name}")
        self.state = State.RUNNING
        self.last = counts
        self.joints.bus.write_currents(counts)
        return counts

    def fault(self, reason: SafetyError) -> None:
        """Command zero current and switch torque off after a fault; the first reason is kept.

        The servos cannot be armed again until a person has released the interlock.
        """
        self.state = State.FAULT
        self.reason = self.reason or reason
        self.interlock.trip(str(self.reason), lasting=False)
        self._stop()
        lasting = self.reason.kind != "signal" or not self.confirmed
        self.interlock.trip(str(self.reason), lasting=lasting, torque=self.torque)

    def disarm(self) -> None:
        """Command zero current and switch torque off at the end of a run; a state of fault is kept."""
        if self.state == State.FAULT:
            self._stop()
            return
        self.state = State.DISARMED
        self._stop()
        if not self.confirmed:
            self.state, self.reason = State.FAULT, SafetyError("line", "not every servo confirmed that torque is off")
            self.interlock.trip(str(self.reason), torque=self.torque)

    def _stop(self) -> None:
        """Zero current and torque off in two packets that need no answer, until every servo confirms it.

        Signals wait until it is done, however many come.
        """
        with signals_held():
            self.last = np.zeros(self.joints.n, int)
            self._silent = list(self.joints.bus.ids) if self._touched else []
            attempts = 0
            while self._silent and attempts < self.attempts:
                attempts += 1
                try:
                    self.joints.bus.write_currents(self.last)
                    self.joints.bus.write_all("torque_enable", 0)
                    self._silent = [id for id in self._silent if not self._is_off(id)]
                except Unplugged:
                    break  # nothing reaches them any more but their own watchdog
                except BusError:
                    continue
            self.confirmed = not self._silent
            if self._touched:
                self._tell()
            self._touched = not self.confirmed

    def _is_off(self, id: int) -> bool:
        """Whether a servo says that its torque is off.

        Raises:
            Unplugged: The port is gone.
        """
        try:
            return self.joints.bus.read(id, "torque_enable") == 0
        except (NoReply, Refused):
            return False

    def __enter__(self) -> Safety:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        with signals_held():
            if error is not None and self.state in (State.ARMED, State.RUNNING):
                cause = "signal" if isinstance(error, KeyboardInterrupt) else "exception"
                self.fault(SafetyError(cause, f"{type(error).__name__}: {error}"))
                error.add_note(self.torque)
            elif self._touched:
                self.disarm()
