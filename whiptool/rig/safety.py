"""Arming and disarming the servos, and what is done after a fault.

Every fault ends in zero current and torque off. Where the line to the servos is gone, their own bus watchdog stops
them. None of this replaces a switch that cuts the servos' power, within reach of whoever stands beside the whip.
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable
from enum import IntEnum
from types import FrameType, TracebackType
from typing import Any

import numpy as np

from whiptool.models.parameters import number
from whiptool.rig.dynamixel.bus import BusError, Unplugged
from whiptool.rig.dynamixel.control_table import CURRENT_MODE, WATCHDOG_UNIT, in_words
from whiptool.rig.dynamixel.joints import Joints, JointSample
from whiptool.rig.guards import Guards, SafetyError, Watch


class State(IntEnum):
    """State that the arm's safety is in."""

    DISARMED = 0  # torque off
    ARMED = 1  # torque on, no current yet
    RUNNING = 2  # currents are commanded
    FAULT = 3  # something was wrong; torque off, until it is armed anew


class Safety:
    """The only door to the motors: nothing else writes Goal Current or Torque Enable.

    As a context manager it leaves the motors off, whatever ended the block.

    Args:
        joints: The servos.
        current: Current limit while armed [A].
        watchdog: A servo stops when it hears nothing for this long [s], 0.04 to 0.1.
        attempts: How often torque off is tried, at most, until every servo confirms it.
    """

    def __init__(self, joints: Joints, *, current: float = 2.3, watchdog: float = 0.06, attempts: int = 5) -> None:
        highest = 1193 * 2.69e-3
        self.current = number("current", current, low=0, high=highest, strict=True)
        self.watchdog = number("watchdog", watchdog, low=0.04, high=0.1)
        self.joints, self.attempts = joints, attempts
        self.state = State.DISARMED
        self.reason: SafetyError | None = None
        self._touched = False  # whether a servo may be on
        self.confirmed = False  # whether every servo said that its torque is off
        self.last = np.zeros(joints.n, int)  # Goal Current of the last cycle [counts]

    def arm(self) -> JointSample:
        """Switch the servos on: torque off, current limit, mode, Goal Current 0 *and read back*, watchdog, torque on.

        Goal Current is read back because a change of mode sets it to the current limit.

        Returns:
            The joints as they are.

        Raises:
            SafetyError: A step failed; torque is off.
        """
        if self.state in (State.ARMED, State.RUNNING):
            raise SafetyError("arm", f"the arm is {self.state.name}")
        bus, joints = self.joints.bus, self.joints
        limit = int(self.current / joints.units.current)
        self.reason, self.confirmed, self._touched = None, False, True
        try:
            for id in bus.ids:
                bus.write(id, "torque_enable", 0)
                bus.write(id, "bus_watchdog", 0)
                error = bus.read(id, "hardware_error_status")
                if error:
                    fix = f"find the cause, then `python -m whiptool.rig.dynamixel --port {bus.device} --reboot {id}`"
                    raise SafetyError("hardware", f"servo {id} reports {in_words(error)}; {fix}")
                bus.write(id, "current_limit", limit)
                bus.write(id, "operating_mode", CURRENT_MODE)
                bus.write(id, "goal_current", 0)
                for name, wanted in (("operating_mode", CURRENT_MODE), ("current_limit", limit), ("goal_current", 0)):
                    found = bus.read(id, name)
                    if found != wanted:
                        raise SafetyError("arm", f"servo {id}: {name} is {found}, not {wanted}")
            joints.current_limit = limit
            bus.prepare_block()
            sample = joints.read()
            for id in bus.ids:
                bus.write(id, "bus_watchdog", round(self.watchdog / WATCHDOG_UNIT))
            for id in bus.ids:
                bus.write(id, "torque_enable", 1)
        except (BusError, SafetyError) as error:
            self.fault(error if isinstance(error, SafetyError) else SafetyError("line", str(error)))
            assert self.reason is not None
            raise self.reason from error
        self.last[:] = 0
        self.state = State.ARMED
        return sample

    def command(self, torque: np.ndarray) -> tuple[np.ndarray, bool]:
        """Send joint torques [N m], (n,).

        Returns:
            Goal Currents as sent [counts], (n,), and whether they were cut to the limit.

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
        """Send the Goal Currents of the last cycle again.

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
        """Command zero current and switch torque off after a fault; the first reason is kept."""
        self.state = State.FAULT
        self.reason = self.reason or reason
        self._stop()

    def disarm(self) -> None:
        """Command zero current and switch torque off at the end of a run; a fault stays a fault."""
        if self.state != State.FAULT:
            self.state = State.DISARMED
        self._stop()
        if not self.confirmed and self.state != State.FAULT:
            self.state, self.reason = State.FAULT, SafetyError("line", "not every servo confirmed that torque is off")

    def _stop(self) -> None:
        """Zero current and torque off in two packets that need no answer, until every servo confirms it."""
        bus = self.joints.bus
        self.last = np.zeros(self.joints.n, int)
        if not self._touched:
            self.confirmed = True
            return
        self.confirmed = False
        for _ in range(self.attempts):
            try:
                bus.write_currents(self.last)
                bus.write_all("torque_enable", 0)
                self.confirmed = all(bus.read(id, "torque_enable") == 0 for id in bus.ids)
            except Unplugged:
                return  # nothing reaches them any more but their own watchdog
            except BusError:
                continue
            if self.confirmed:
                self._touched = False
                return

    def __enter__(self) -> Safety:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if error is not None and self.state in (State.ARMED, State.RUNNING):
            self.fault(SafetyError("exception", f"{type(error).__name__}: {error}"))
        elif self._touched:
            self.disarm()


class StopSignals:
    """SIGINT and SIGTERM as a wish that the loop sees in its next cycle; a second SIGINT interrupts at once.

    An exception out of a handler could leave a packet half sent. Outside of the main thread it does nothing.
    """

    def __init__(self) -> None:
        self.received: str | None = None
        self._before: dict[int, Any] = {}

    def _on_signal(self, number: int, frame: FrameType | None) -> None:
        if self.received is not None and number == signal.SIGINT:
            raise KeyboardInterrupt
        self.received = signal.Signals(number).name

    def __enter__(self) -> StopSignals:
        if threading.current_thread() is threading.main_thread():
            self._before = {n: signal.signal(n, self._on_signal) for n in (signal.SIGINT, signal.SIGTERM)}
        return self

    def __exit__(self, *_: object) -> None:
        restore: Callable[[int, Any], Any] = signal.signal
        for n, handler in self._before.items():
            restore(n, handler)


__all__ = ["Guards", "Safety", "SafetyError", "State", "StopSignals", "Watch"]
