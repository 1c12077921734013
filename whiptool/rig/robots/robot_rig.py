"""Strikes with a robot arm that has its own controller: to the start, at rest, the strike, and its recording."""

from __future__ import annotations

import dataclasses
import json
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.signal import savgol_filter

from whiptool.errors import InputError
from whiptool.given_files import build_from, parsing, read_json
from whiptool.identification.servo_lag import ServoLag, fit_servo_lag
from whiptool.impedance.controller import Controller
from whiptool.impedance.laws import PositionControl
from whiptool.limits.all_limits import AllLimits, unchecked_by
from whiptool.limits.clearance import Clearance
from whiptool.limits.limits import Limits
from whiptool.limits.robot_trajectory import Execution, beginning
from whiptool.models.joint_trajectory import JointTrajectory
from whiptool.models.parameters import Model
from whiptool.models.strike import Strike
from whiptool.models.trajectory import Trajectory
from whiptool.progress import note
from whiptool.rig.cyclelog import CycleLog, Cycles, Phase
from whiptool.rig.robots.addresses import state_file
from whiptool.rig.robots.robot import Robot, Sample, payload_of
from whiptool.rig.safety import State
from whiptool.rig.session import FilmedRig
from whiptool.rig.stops import SafetyError, StrikeRefused
from whiptool.rig.struck import Attempt, Motion, Run, Struck
from whiptool.rig.virtual_film import VirtualFilm
from whiptool.rollout.servo_replay import replay_trajectory
from whiptool.stop_signals import StopSignals
from whiptool.whole_files import write_whole

LAG = "lag.json"
HELD = "the robot's own controller holds the arm"
RESTS = f"the arm is at rest, and {HELD}"  # after a signal
_HANGING = 0.2  # [s] before a strike from which a whip is simulated
_FEW = 0.01  # part of the states that may be missing without a note
_MOVED = 0.05  # [rad] of a command, from which on a lag is fitted
_RATE, _WINDOW = 500.0, 15  # [1/s] of the measured motion as the simulated whip follows it; samples that smooth it


class RobotRig(FilmedRig):
    """A robot arm that follows joint positions by its own controller.

    From where the arm stands it moves slowly to the strike's start, rests, strikes, and stays at the strike's end. A
    whip that is simulated hangs on the measured motion of the joints, and virtual cameras film it.

    Args:
        model: The nominal model of whip and arm.
        robot: Driver of the robot.
        port: Name of the robot in records.
        limits: Limits that strikes have to keep.
        film: Virtual cameras of a simulated whip, with its true model; None: the whip is real.
        shared: `camera`, `confirm`, `target`, `options`, `interlock`, as `FilmedRig` takes them; of the options
            `settle` and `t_stay` apply.
    """

    def __init__(
        self,
        model: Model,
        robot: Robot,
        *,
        port: str = "robot",
        limits: Sequence[Limits] = (),
        film: VirtualFilm | None = None,
        **shared: Any,
    ) -> None:
        super().__init__(model, Controller(PositionControl()), **shared)
        if robot.n != model.arm.n:
            raise InputError("robot", f"{robot.n} joints", f"{model.arm.n}, as the arm of {model.name} has")
        self.robot, self.port, self.limits, self._film = robot, port, AllLimits(limits), film
        self._kept = False  # whether the lag is that of an earlier run
        self._stands: np.ndarray | None = None  # where the arm stood when it was last asked; None: it has moved since

    def _connected(self) -> Robot:
        return self.robot

    def trajectory(self, strike: Strike, posture: np.ndarray, believed: Model | None = None) -> JointTrajectory:
        """Return the movement from a posture to the strike's start, the rest, the strike and the stay.

        Args:
            strike: The strike.
            posture: Present positions of the joints [rad], (n,).
            believed: The posterior mean of whip and arm, with which the strike is simulated; default: the rig's model.

        Raises:
            StrikeRefused: A command is beyond the limits of the joints or of the robot's controller, the arm comes too
                close to itself or the floor, or the simulated strike breaks a limit; the message says which.
        """
        trajectory, said = self._judged(strike, posture, believed)
        if said is not None:
            raise StrikeRefused("strike", strike.vector.tolist(), "a strike within the limits of the robot", said)
        return trajectory

    def refusal(self, strike: Strike, believed: Model | None = None) -> str | None:
        """Return why a strike would be refused from where the arm stands now, see `Rig.refusal`.

        Where it stands is asked once between two strikes: the robot is connected, and nothing moves.

        Raises:
            InputError: The robot cannot be reached, or no strike is possible from where its arm stands.
        """
        if self._stands is None:
            with self.interlock.held(), self.robot as arm:
                self._stands = arm.posture()
            posture = tuple(self._stands.tolist())
            if said := Execution(posture=posture).refused_posture(self.model, self.limits.members):
                raise InputError("posture", posture, "one in which the arm keeps clear of itself and the floor", said)
        return self._judged(strike, self._stands, believed)[1]

    def _judged(
        self, strike: Strike, posture: np.ndarray, believed: Model | None
    ) -> tuple[JointTrajectory, str | None]:
        """The movement from a posture, and what it exceeds."""
        o, limits = self.options, self.limits.members
        execution = Execution(posture=tuple(posture.tolist()), rate=self.robot.rate, rest=o.settle)
        trajectory, said = execution.judged(believed or self.model, strike, o.t_stay, limits)
        if said is None and (beyond := trajectory.beyond(self.robot.limits)):
            said = beyond.by_parts(beginning(strike, trajectory, o.t_stay))
        return trajectory, said

    def _ask(self, motion: Motion) -> None:
        self._note_end(motion.strike, None)
        super()._ask(motion)

    def _note_end(self, strike: Strike, believed: Model | None) -> None:
        """Say whether the whip lies on the floor where a strike ends."""
        if below := self._below_floor(np.array(strike.q_f), believed):
            note(f"at the end of the strike the whip lies on the floor: hanging it would reach {below:.2f} m below it")

    def _below_floor(self, q: np.ndarray, believed: Model | None) -> float:
        """How far below the floor the tip of the hanging whip would be [m]; 0: it hangs clear, or there is no floor."""
        clearances = [x for x in self.limits.members if isinstance(x, Clearance)]
        heights = (x.above_floor(q[None], believed or self.model) for x in clearances)
        return max((-float(x[0]) for x in heights if x is not None and x[0] < 0), default=0.0)

    def _planned(self, arm: Robot, attempt: Attempt) -> Motion:
        self._recall_lag(attempt.log)
        posture = arm.posture()
        trajectory = self.trajectory(attempt.strike, posture, attempt.believed)
        if self._below_floor(posture, attempt.believed):
            note(
                "the whip lies on the floor where the arm stands: the way to the start lifts it clear, and it has "
                f"{self.options.settle:g} s of rest to hang still before the strike"
            )
        reach = np.ptp(trajectory.q, axis=0)
        name, end = trajectory.joints[int(reach.argmax())], float(trajectory.t[-1])
        unchecked = unchecked_by(self.limits.members)
        return Motion(attempt.strike, self.port, name, float(reach.max()), end, unchecked, trajectory)

    def _run(self, arm: Robot, attempt: Attempt, motion: Motion) -> Run:
        strike, log, signals, trajectory = attempt.strike, attempt.log, attempt.signals, motion.trajectory
        assert trajectory is not None
        self._stands = None
        arm.set_payload(payload_of(self.model))
        begins = beginning(strike, trajectory, self.options.t_stay)
        about = {"strike": strike.vector.tolist(), "rate": arm.rate, "period": 1 / arm.rate, "strike_begins": begins}
        watch = _Watch(CycleLog(arm.n, log, about=about), trajectory, begins, signals.listen(), attempt.on_cycle)
        fault: SafetyError | None = None
        self.interlock.torque = held = HELD
        try:
            arm.follow(trajectory, watch.record, watch.stop)
        except SafetyError as error:
            fault = error
        except BaseException as error:
            self.interlock.trip(f"exception: {type(error).__name__}: {error}", torque=HELD)
            raise
        finally:
            watch.log.close()
        fault = watch.error or fault
        if fault is None and signals.received:  # it came after the last cycle
            fault = SafetyError("signal", f"{signals.received} came")
        if fault is not None:
            self.interlock.torque = held = RESTS if fault.kind == "signal" else HELD
            self.interlock.trip(str(fault), lasting=fault.kind != "signal", torque=held)
        signals.answered = fault is not None
        cycles = watch.log.cycles()
        if fault is None:
            self._note_end(strike, attempt.believed)
            self._learn_lag(cycles, log)
        missed = int(cycles.lost.sum())
        if missed > _FEW * len(cycles):
            note(
                f"{missed} of {len(cycles) + missed} states of the robot were not received, the longest gap is "
                f"{1e3 * cycles.longest_gap:.0f} ms: this computer or its network is busy"
            )
        return Run(cycles, fault, torque_off=None, missed=missed, overruns=None, torque=held)

    def _recall_lag(self, log: Path | None) -> None:
        """Take the lag of the joints that an earlier strike of the run has left, or else the last one of this robot."""
        if not self.robot.leads or self.robot.lag is not None:
            return
        for file in [] if log is None else sorted(log.parent.parent.glob(f"strike-*/{LAG}")):
            self.robot.lag, _ = _lag_in(file)
        kept = kept_lag(self.port)
        if self.robot.lag is None and kept is not None and kept.is_file():
            (self.robot.lag, date), self._kept = _lag_in(kept), True
            lag = f"{1e3 * self.robot.lag.total:.1f} ms"
            note(f"the commands lead by {lag}, the lag of the joints found on {date} ({kept}; delete it to forget it)")

    def _learn_lag(self, cycles: Cycles, log: Path | None) -> None:
        """Fit the lag of the joints to a recording. The fit with the least standard error is printed and kept, for this
        run and for later ones of the robot; later commands lead by it. The first fit replaces that of another run.
        """
        if not self.robot.leads or np.ptp(cycles.q_d, axis=0).max() < _MOVED:
            return
        found, known = fit_servo_lag(cycles.t, cycles.q_d, cycles.q, period=1 / self.robot.rate), self.robot.lag
        if known is not None and not self._kept and known.errors[0] <= found.errors[0]:
            return
        self.robot.lag, self._kept = found, False
        note(f"{found}; the next commands lead by that")
        table = dataclasses.asdict(found)
        if log is not None:
            write_whole(log.with_name(LAG), json.dumps(table) + "\n")
        if kept := kept_lag(self.port):
            kept.parent.mkdir(parents=True, exist_ok=True)
            write_whole(kept, json.dumps(table | {"date": time.strftime("%Y-%m-%d")}) + "\n")

    def _strike(self, strike: Strike, folder: Path | None, believed: Model | None, signals: StopSignals) -> Struck:
        struck = super()._strike(strike, folder, believed, signals)
        film = self._film
        if film is None:
            return struck
        path = whip_on(film.model, struck.run.cycles, self.model.arm.names)
        struck = dataclasses.replace(struck, truth=path)
        return self._seen(struck, signals, lambda: self._recorded(struck.run, folder, film.of(path, strike)))


def kept_lag(port: str) -> Path | None:
    """Return the file that keeps the lag of a robot's joints for later runs; None: the port is no robot's address."""
    return state_file("lags", port) if "://" in port else None


def _lag_in(file: Path) -> tuple[ServoLag, str]:
    """Return the lag in a file, and the date on which it was found; empty: the file is of a run, and has none.

    Raises:
        InputError: The file is damaged.
    """
    with parsing(file, "a lag of joints"):
        table = dict(read_json(file))
        date = str(table.pop("date", ""))
        return build_from(ServoLag, table, "", errors=tuple(map(float, table.pop("errors")))), date


class _Watch:
    """What a driver calls in every cycle: the record of its samples, and the question whether to stop.

    Attributes:
        log: Log of the cycles.
        error: A fault that is not the robot's, such as a lost camera; it stops the robot.
    """

    def __init__(
        self,
        log: CycleLog,
        trajectory: JointTrajectory,
        begins: float,
        signals: StopSignals,
        on_cycle: Callable[[int, Phase], None],
    ) -> None:
        self.log = log
        self.error: SafetyError | None = None
        self._signals, self._on_cycle, self._count = signals, on_cycle, 0
        self._begins, self._step = begins, float(trajectory.t[1])
        resting = np.flatnonzero(~trajectory.v.any(axis=1))
        rests = resting[(resting > 0) & (trajectory.t[resting] < self._begins)]
        self._rests = float(trajectory.t[rests[0]]) if len(rests) else self._begins

    def record(self, sample: Sample) -> None:
        """Log a sample."""
        phase = self._phase(sample.t + self._step / 2)
        row = {"t": sample.t, "stamp": sample.t, "late": 0.0, "phase": phase, "state": State.RUNNING, "flags": 0}
        self.log.append(
            {**row, "q": sample.q, "v": sample.v, "tau": sample.tau, "q_d": sample.q_d, "current": sample.current}
        )
        try:
            self._on_cycle(self._count, phase)
        except SafetyError as error:
            self.error = self.error or error
        self._count += 1

    def _phase(self, t: float) -> Phase:
        if t >= self._begins:
            return Phase.STRIKE
        return Phase.SETTLE if t >= self._rests else Phase.APPROACH

    def stop(self) -> str | None:
        """Return why the robot has to stop; None: it goes on."""
        if self.error is not None:
            return str(self.error)
        return f"{self._signals.received} came" if self._signals.received else None


def whip_on(model: Model, cycles: Cycles, joints: Sequence[str]) -> Trajectory:
    """Return the motion of a simulated whip on the measured motion of an arm, with time 0 at the strike's start.

    The whip hangs at rest 0.2 s before, in the rest of the run. MuJoCo's position servos follow the measured positions,
    which a polynomial of fourth order over 28 ms smooths.

    Args:
        model: True model of arm and whip.
        cycles: Cycles of the run.
        joints: Names of the arm's joints.
    """
    begins = cycles.about["strike_begins"]
    seen = np.isfinite(cycles.q).all(axis=1) & (cycles.stamp >= begins - _HANGING)
    stamps = cycles.stamp[seen]
    t = np.arange(int((stamps[-1] - stamps[0]) * _RATE) + 1) / _RATE
    q = np.stack([np.interp(t + stamps[0], stamps, x) for x in cycles.q[seen].T], axis=1)
    q, v, a = (np.asarray(savgol_filter(q, _WINDOW, 4, deriv=k, delta=1 / _RATE, axis=0)) for k in range(3))
    moved = JointTrajectory(tuple(joints), t, q, v, a)
    return replay_trajectory(model, moved).since(begins - stamps[0])
