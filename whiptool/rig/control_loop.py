"""The control loop of the rig: move to the start posture, wait, strike, return; every cycle is logged."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from whiptool.errors import InputError
from whiptool.impedance.arm import Arm
from whiptool.impedance.controller import Controller
from whiptool.impedance.laws import ConstantImpedance
from whiptool.models.parameters import Model
from whiptool.models.strike import Strike
from whiptool.rig.cyclelog import CycleLog, Flag, Phase
from whiptool.rig.dynamixel.joints import Guards, Joints, JointSample, Watch
from whiptool.rig.dynamixel.line import NoReply, Refused, Unplugged
from whiptool.rig.loop_options import CappedLoop, LoopOptions
from whiptool.rig.safety import Safety, State
from whiptool.rig.stops import SafetyError, StrikeRefused
from whiptool.rig.struck import Run
from whiptool.stop_signals import StopSignals


class Clock(Protocol):
    """Source of the control loop's time."""

    def now(self) -> float:
        """Time [s] since a fixed instant; it never decreases."""
        ...

    def sleep_until(self, t: float) -> None:
        """Wait until time t [s]; return immediately if it is past."""
        ...


class WallClock:
    """The system's monotonic clock. To reduce jitter, `sleep_until` sleeps until `spin` [s] before the deadline and
    then busy-waits.
    """

    def __init__(self, spin: float = 2e-4) -> None:
        self.spin = spin

    def now(self) -> float:
        """Return the time of this clock [s]; see `Clock`."""
        return time.monotonic()

    def sleep_until(self, t: float) -> None:
        """Sleep until a time of this clock [s]; see `Clock`."""
        left = t - time.monotonic()
        if left > self.spin:
            time.sleep(left - self.spin)
        while time.monotonic() < t:
            pass


class StepClock:
    """Clock whose time advances only in `sleep_until`. It serves an emulated rig in lock step, whose simulated time
    advances with the loop's writes.
    """

    def __init__(self) -> None:
        self._t = 0.0

    def now(self) -> float:
        """Return the time of this clock [s]; see `Clock`."""
        return self._t

    def sleep_until(self, t: float) -> None:
        """Sleep until a time of this clock [s]; see `Clock`."""
        self._t = max(self._t, t)


def posture_controller(model: Model, options: LoopOptions) -> Controller:
    """Return a controller with constant stiffness `omega^2 I` and damping `2 zeta omega I`, which holds the arm.

    I is the inertia of the hanging arm with the whip's mass at its hand [kg m^2]; omega and zeta are
    `options.stiffness` and `options.damping`.
    """
    arm = Arm(model)
    q = np.zeros(arm.n)
    J = arm.gravity_jacobians(q)[-1]  # of the hand, (2, n)
    inertia = arm.inertia(q) + model.whip.mass * J.T @ J
    K, B = options.stiffness**2 * inertia, 2 * options.damping * options.stiffness * inertia
    return Controller(ConstantImpedance(K=_rows(K), B=_rows(B)))


def _rows(matrix: np.ndarray) -> tuple[tuple[float, ...], ...]:
    return tuple(tuple(float(x) for x in row) for row in matrix)


def move(q_from: np.ndarray, q_to: np.ndarray, speed: float) -> Strike:
    """Return a minimum-jerk movement between two postures (n,) [rad] that lasts at least 0.2 s.

    Args:
        q_from, q_to: Start and end posture [rad], (n,).
        speed: Largest speed of any joint's reference [rad/s].
    """
    # the largest speed of the polynomial of Eq. 1 is 15/8 of the mean
    longest = float(np.abs(np.asarray(q_to) - np.asarray(q_from)).max())
    return Strike(tuple(q_from), tuple(q_to), max(0.2, 1.875 * longest / speed))


class RigLoop:
    """The control loop that makes strikes with servos.

    Args:
        joints: The servos.
        model: Model for gravity compensation; its arm has as many joints as there are servos.
        controller: Controller of the strike; its `torque_limit` is used, its `control_period` is not.
        options: Settings of the loop.
        guards: Limits whose violation ends a run.
        clock: Clock of the loop; default: the monotonic clock.

    Raises:
        InputError: The model's arm has another number of joints.
    """

    def __init__(
        self,
        joints: Joints,
        model: Model,
        controller: Controller,
        *,
        options: LoopOptions | None = None,
        guards: Guards | None = None,
        clock: Clock | None = None,
        safety: Safety | None = None,
    ) -> None:
        controller.check_fits(model.arm)
        if joints.n != model.arm.n:
            raise InputError("servos", joints.n, f"{model.arm.n}, one per arm joint")
        self.joints, self.model, self.controller = joints, model, controller
        self.options, self.guards = options or LoopOptions(), guards or Guards()
        self.clock = clock or WallClock()
        self.safety = safety or Safety(joints)
        self.arm = Arm(model)
        self._posture = posture_controller(model, self.options)

    def run(
        self,
        strike: Strike,
        *,
        path: Path | None = None,
        about: dict[str, Any] | None = None,
        on_cycle: Callable[[int, Phase], None] | None = None,
        believed: Model | None = None,
        signals: StopSignals | None = None,
    ) -> Run:
        """Arm the servos, move to the start, wait, strike, return and disarm. A fault or signal ends it early without
        an exception.

        After a fault or signal no loop with the same interlock arms the servos until a person has released it by
        `safety.interlock.release()`.

        Args:
            strike: The strike to make.
            path: File to which the cycles are logged as they happen; None: memory only.
            about: Description to store with the log.
            on_cycle: Called at the start of every cycle with its number and phase, for a camera's trigger; it must be
                quick.
            believed: Model with the posterior mean of whip and arm, with which the strike is simulated beforehand;
                default: the loop's model.
            signals: Object that collects stop signals, such as Ctrl-C, from arming on, and that the caller closes after
                writing the records. Default: a new object, which is closed when torque is off.

        Raises:
            StrikeRefused: The rehearsal refuses the strike.
            InputError: The strike is of another arm, or a servo has register values that strikes do not accept.
            Locked: The arm was stopped, and no person has released it.
            NoReply, Refused, Unplugged: A servo does not answer before it is armed.
        """
        n = self.joints.n
        if len(strike.q_i) != n:
            raise InputError("strike", strike.vector.tolist(), f"{2 * n + 1} numbers, for an arm of {n} joints")
        if self.options.rehearse:
            self.check(strike, believed)
        self.safety.check()
        about = {"strike": strike.vector.tolist(), "rate": self.options.rate, **(about or {})}
        log = CycleLog(n, path, about=about)
        self._missed = self._overruns = self._k = 0
        self._phase, self._logged_fault = Phase.APPROACH, False
        self.safety.reason = None
        try:
            with ExitStack() as own:
                heard = own.enter_context(StopSignals()) if signals is None else signals.listen()
                self._armed(strike, log, heard, on_cycle)
                if heard.received and self.safety.state != State.FAULT:  # it came after the last cycle
                    self.safety.fault(SafetyError("signal", f"{heard.received} came"))
                heard.answered = self.safety.state == State.FAULT
        finally:
            self._close(log)
        return Run(
            cycles=log.cycles(),
            fault=self.safety.reason,
            torque_off=self.safety.confirmed,
            missed=self._missed,
            overruns=self._overruns,
            torque=self.safety.torque,
        )

    def _armed(
        self, strike: Strike, log: CycleLog, heard: StopSignals, on_cycle: Callable[[int, Phase], None] | None
    ) -> None:
        """Arm, go through all cycles, disarm; a fault or a signal is what the safety says afterwards."""
        with self.safety as safety:
            try:
                first = safety.arm(heard.interruptible)
                self._cycles(strike, first, log, heard, on_cycle)
                safety.disarm()
            except (SafetyError, Unplugged) as error:
                reason = error if isinstance(error, SafetyError) else SafetyError("unplugged", str(error))
                if safety.state != State.FAULT:
                    safety.fault(reason)
            except KeyboardInterrupt:
                safety.fault(SafetyError("signal", f"{heard.received or 'Ctrl-C'} came"))

    def _close(self, log: CycleLog) -> None:
        """Close the record; a fault outside of the cycles is its last row."""
        if self.safety.state == State.FAULT and not self._logged_fault:
            zero, flags = np.zeros(self.joints.n, int), Flag.FAULT | Flag.OUTSIDE
            now = {"t": self._k / self.options.rate, "stamp": self.clock.now(), "late": 0.0}
            log.append(self._row(zero, **now, flags=flags))
        log.close()

    def check(self, strike: Strike, believed: Model | None = None) -> None:
        """Simulate a strike beforehand and refuse it if it is not safe; see `whiptool.rig.rehearsal`.

        Raises:
            StrikeRefused: The strike must not be made; the message says why.
        """
        from whiptool.rig.rehearsal import rehearse

        rehearsal = rehearse(self.model, self.controller, strike, self.options, guards=self.guards, believed=believed)
        if rehearsal.refused is not None:
            raise StrikeRefused(
                "strike",
                strike.vector.tolist(),
                "a strike that the motors and the loop can carry out",
                rehearsal.refused,
            )

    def _plan(self, strike: Strike, q: np.ndarray) -> Iterator[tuple[Phase, CappedLoop, float]]:
        """Phases with their controllers and durations; the return starts from where the arm then is."""
        o, q_i = self.options, np.array(strike.q_i)
        posture = lambda path: CappedLoop(self._posture, self.arm, path, None)  # noqa: E731
        if np.abs(q - q_i).max() > 2 * self.joints.units.position:
            path = move(q, q_i, o.approach_speed)
            yield Phase.APPROACH, posture(path), path.D
        if o.settle:
            yield Phase.SETTLE, posture(Strike(strike.q_i, strike.q_i, 1.0)), o.settle
        yield Phase.STRIKE, CappedLoop(self.controller, self.arm, strike, o.caps), strike.D + o.t_stay
        if o.go_back:
            path = move(self._sample.q, q, o.approach_speed)
            yield Phase.RETURN, posture(path), path.D

    def _cycles(
        self,
        strike: Strike,
        first: JointSample,
        log: CycleLog,
        signals: StopSignals,
        on_cycle: Callable[[int, Phase], None] | None,
    ) -> None:
        """All cycles of all phases; raises what ends them early, after the cycle in question is on record."""
        period, clock, watch = 1.0 / self.options.rate, self.clock, Watch(self.guards, self.joints.n)
        self._sample = first
        start, k = clock.now(), 0
        for phase, loop, duration in self._plan(strike, first.q):
            begin, cycles, self._phase = k, max(1, math.ceil(duration / period - 1e-9)), phase
            while k - begin < cycles:
                deadline = start + k * period  # absolute: a late cycle does not shift the ones after it
                clock.sleep_until(deadline)
                if on_cycle is not None:
                    with signals.interruptible(2):
                        on_cycle(k, phase)
                self._cycle(k * period, deadline, (k - begin) * period, loop, watch, log, signals)
                end = clock.now()
                k += 1
                self._k = k
                overran = end > start + k * period
                if overran:
                    self._overruns += 1
                    k = max(k, math.floor((end - start) / period))  # deadlines that are past are not made up for
                error = watch.timing(overran)
                if error is not None:
                    raise error

    def _cycle(
        self,
        t: float,
        deadline: float,
        in_phase: float,
        loop: CappedLoop,
        watch: Watch,
        log: CycleLog,
        signals: StopSignals,
    ) -> None:
        """Run one control cycle: read the servos, check the limits, command torques, record."""
        joints, safety, n = self.joints, self.safety, self.joints.n
        started, flags = self.clock.now(), 0
        q_d = loop.strike.reference(in_phase)[0]
        sample: JointSample | None = None
        error: SafetyError | Unplugged | None = None
        tau, counts = None, np.zeros(n, int)
        try:
            try:
                sample = joints.read()
            except (NoReply, Refused) as lost:
                self._missed += 1
                flags |= Flag.MISSED | Flag.HELD
                error = watch.missed(str(lost))
            stamp = self.clock.now()
            if sample is not None:
                self._sample = sample
                acts = joints.torque_constant * sample.current
                rigid = self.arm.feedforward(sample.q, sample.v, np.zeros(n)) + self.arm.gravity_compensation(sample.q)
                load = np.array([acts - rigid, joints.torque(safety.last) - acts])
                error = watch.sample(stamp, sample, q_d, load, self.arm.inertia(sample.q))
            if signals.received and error is None:
                error = SafetyError("signal", f"{signals.received} came")
            if error is None and sample is not None:
                torque = loop.torque(in_phase, sample.q, sample.v)
                tau = torque
                counts, cut = safety.command(torque)
                flags |= Flag.SATURATED if cut else 0
            elif error is None:
                counts = safety.hold()
        except (SafetyError, Unplugged) as raised:
            stamp, error = self.clock.now(), raised
        if error is not None:
            flags |= Flag.FAULT
            counts = np.zeros(n, int)
            reason = error if isinstance(error, SafetyError) else SafetyError("unplugged", str(error))
            safety.fault(reason)
            self._logged_fault = True
        times = {"t": t, "stamp": stamp, "late": started - deadline}
        log.append(self._row(counts, sample, **times, flags=flags, tau=tau, q_d=q_d))
        if error is not None:
            raise error

    def _row(self, counts: np.ndarray, sample: JointSample | None = None, **own: Any) -> dict[str, Any]:
        """Return a cycle as the record takes it; `own` are times, flags, torque and reference."""
        seen = ("q", "v", "current", "voltage", "temperature")
        measured = {} if sample is None else {name: getattr(sample, name) for name in seen}
        goal = counts * self.joints.units.current
        return {**own, **measured, "goal_current": goal, "phase": self._phase, "state": self.safety.state}
