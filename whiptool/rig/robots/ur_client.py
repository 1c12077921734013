"""The client of a robot by Universal Robots, `ur_rtde`, in a separate process.

After a lost connection the client (1.6.5) connects again by itself, repeats the last command where it uploads its
program itself, and crashes in some cases. So it runs in a process that ends with the connection, and uploads nothing
by itself. That process also commands the robot in time while the other one reads cameras or writes files, and stops it
when the other one has ended.

Time is the controller's. Each state that it reports is answered by one command, for the time of that state, so that
neither a late cycle nor a drifting clock of this computer stretches a strike.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection
from queue import SimpleQueue
from typing import Any

import numpy as np
from scipy.interpolate import CubicHermiteSpline, interp1d

from whiptool.errors import InputError
from whiptool.extras import optional
from whiptool.identification.servo_lag import ServoLag
from whiptool.models.joint_trajectory import JointTrajectory
from whiptool.models.smooth_path import path_to_rest
from whiptool.models.spatial_arm import JointLimits
from whiptool.rig.robots.robot import IN_LOCKSTEP, RECOVER, Payload, Record, Sample, Stop
from whiptool.rig.stops import SafetyError

RATE = 500.0  # [1/s] of an e-Series controller
DECELERATION = 10.0  # [m/s^2] of the tool with which servoStop brakes; ur_rtde's default
WATCHDOG = 2.0  # [1/s] commands at least; else the controller stops the program. Braking sends none for 0.4 s
SETTLING = 3.0  # [s] in which the arm comes to rest behind the last command
RESTING = 1e-3  # [rad/s] of a joint at rest
_STATE = (
    "timestamp", "actual_q", "actual_qd", "target_q", "actual_current", "robot_mode", "runtime_state",
    "safety_status_bits", "target_speed_fraction",
)  # fmt: skip
_RUNNING, _PLAYING = 7, 2  # values of robot_mode and runtime_state
_STOPS = {2: "protective", 4: "safeguard", 5: "emergency", 6: "emergency", 7: "emergency", 8: "violation", 9: "fault"}
_TOO_EARLY = "5s"  # in the dashboard's answer
_HANGING, _STUCK = 15.0, 1.0  # [s] after which a call of the client that does not return ends the process; in a cycle
_WAITED = 10.0  # [s] without a state of a controller whose time waits meanwhile
_REACH = 2.0  # [s] to connect, and for the controller to do what was asked


@dataclass(frozen=True, eq=False)
class _State:
    """What the controller reported at a time t [s] of its clock."""

    t: float
    q: np.ndarray
    v: np.ndarray
    target: np.ndarray
    current: np.ndarray
    mode: int
    program: int
    safety: int
    speed: float

    @property
    def stopped(self) -> str | None:
        """Kind of the safety stop that is in effect; None: none is."""
        return next((kind for bit, kind in _STOPS.items() if self.safety >> bit & 1), None)


@dataclass(frozen=True)
class Servoing:
    """How a robot is commanded.

    Args:
        host: Address of its controller.
        limits: Limits of its joints, (6,).
        lookahead, gain: Look-ahead time [s] and gain of servoJ.
        patience: Time without a state after which the connection is taken to be lost [s].
    """

    host: str
    limits: tuple[JointLimits, ...]
    lookahead: float
    gain: float
    patience: float


class UrClient:
    """The connections to a controller; methods as those of a `Robot`.

    Args:
        servoing: Address and parameters.

    Attributes:
        lost: Whether the connection was lost.
    """

    def __init__(self, servoing: Servoing) -> None:
        self.o, self.lost, self._patience = servoing, False, servoing.patience
        self._payload: Payload | None = None
        self._control: Any = None
        self._receive: Any = None
        self._dashboard: Any = None

    def connect(self) -> None:
        """Connect; see `Robot.connect`."""
        purpose = "the driver of a Universal Robot"
        control, receive = optional("rtde_control", purpose), optional("rtde_receive", purpose)
        self._dashboard = optional("dashboard_client", purpose).DashboardClient(self.o.host)
        try:
            self._dashboard.connect(int(1e3 * _REACH))
            self._check_ready()
            with suppress(RuntimeError, ValueError):  # of controllers that do not tell it
                waits = self._dashboard.getSerialNumber() == IN_LOCKSTEP
                self._patience = max(self._patience, _WAITED) if waits else self._patience
            self._receive = receive.RTDEReceiveInterface(self.o.host, RATE, list(_STATE))
            kind = control.RTDEControlInterface
            # the client itself uploads nothing: after a lost connection it would start the program again, and repeat
            # the last command
            self._control = kind(self.o.host, RATE, int(kind.FLAG_NO_WAIT))
            self._next()
        except InputError:
            raise
        except (RuntimeError, ValueError, SafetyError) as error:
            fix = "switch the robot on, and see that this computer reaches its address"
            if "in use" in str(error).lower():
                fix = "end the other program that commands it, or switch off its EtherNet/IP, PROFINET and MODBUS"
            raise InputError("robot", f"ur://{self.o.host}", f"a UR's controller that answers ({error})", fix) from None

    def _check_ready(self) -> None:
        """Refuse a robot that cannot move."""
        mode, safety = self._dashboard.robotmode(), self._dashboard.safetystatus()
        if "RUNNING" not in mode:
            fix = "switch the arm on and release its brakes at the pendant"
            raise InputError("robot", mode, "Robotmode: RUNNING", fix)
        if not safety.endswith(("NORMAL", "REDUCED")):
            fix = f"remove the cause; then, for a protective stop, {RECOVER} ur://{self.o.host}"
            raise InputError("robot", safety, "Safetystatus: NORMAL or REDUCED", fix)
        if not self._dashboard.isInRemoteControl():
            fix = "choose Remote Control at the upper right of the pendant, after enabling it in Settings, System"
            raise InputError("robot", "local control", "remote control", fix)

    def finish(self) -> None:
        """Stop every motion, and end the program; the process that ends then closes the connections."""
        if self._control is not None and not self.lost:
            self._end_program(moving=True)

    def posture(self) -> np.ndarray:
        """Return the measured joint positions [rad], (6,)."""
        return self._next().q

    def set_payload(self, payload: Payload) -> None:
        """Tell the robot's controller what its flange carries."""
        self._payload = payload
        self._start_program()  # tells it the payload
        self._end_program()

    def follow(self, trajectory: JointTrajectory, lag: ServoLag | None, record: Record, stop: Stop) -> None:
        """Carry out a trajectory, leading by a lag; see `Robot.follow`."""
        self._check_standing()
        self._start_program()
        try:
            self._track(_Motion(trajectory, self.o.limits, lag), record, stop)
        except BaseException:
            if not self.lost:
                self._end_program(moving=True)
                self._await_rest()
            raise
        self._end_program()

    def _await_rest(self) -> None:
        """Wait until the controller has brought the arm to rest."""
        state = self._next()
        until = state.t + SETTLING
        while np.abs(state.v).max() >= RESTING and state.t < until:
            state = self._next(state.t)

    def recover(self) -> None:
        """Unlock a protective stop; see `Robot.recover`."""
        dashboard = optional("dashboard_client", "the driver of a Universal Robot").DashboardClient(self.o.host)
        try:
            dashboard.connect(int(1e3 * _REACH))
            if "PROTECTIVE_STOP" in dashboard.safetystatus():
                dashboard.closeSafetyPopup()
                self._unlock(dashboard)
            safety = dashboard.safetystatus()
            dashboard.stop()  # a paused program must not go on
        except (RuntimeError, ValueError) as error:
            raise SafetyError("robot", f"the controller at {self.o.host} does not recover: {error}") from None
        finally:
            dashboard.disconnect()
        if not safety.endswith(("NORMAL", "REDUCED")):
            raise SafetyError("robot", f"{safety}: only a person at the robot can acknowledge it")

    @staticmethod
    def _unlock(dashboard: Any) -> None:
        """Unlock a protective stop, which the controller refuses within 5 s."""
        until = time.monotonic() + 6.0
        while True:
            try:
                dashboard.unlockProtectiveStop()
                return
            except RuntimeError as error:
                if "until" not in str(error) or time.monotonic() > until:
                    raise
            time.sleep(0.25)

    def _next(self, last: float | None = None) -> _State:
        """Return a state that is newer than the time `last`, by default than the present one.

        Raises:
            SafetyError: None comes in time.
        """
        if self._receive is None:
            raise SafetyError("lost", "the robot is not connected")
        r, until = self._receive, time.monotonic() + self._patience
        try:
            last = r.getTimestamp() if last is None else last
            while True:
                t = r.getTimestamp()
                if t != last:
                    state = _State(
                        t, np.array(r.getActualQ()), np.array(r.getActualQd()), np.array(r.getTargetQ()),
                        np.array(r.getActualCurrent()), r.getRobotMode(), r.getRuntimeState(), r.getSafetyStatusBits(),
                        r.getTargetSpeedFraction(),
                    )  # fmt: skip
                    if r.getTimestamp() == t:  # else a newer one came meanwhile
                        return state
                elif time.monotonic() > until:
                    break
                time.sleep(1e-4)
        except (RuntimeError, ValueError) as error:
            self.lost = True
            raise SafetyError("lost", f"the robot's states cannot be read: {error}") from None
        self.lost = True
        raise SafetyError(
            "lost",
            f"no state came for {self._patience:g} s; the arm goes to the last command, and after {1 / WATCHDOG:g} s "
            "the controller's watchdog ends the program",
        )

    def _check_standing(self) -> None:
        """Refuse to move a robot that is stopped or slowed down."""
        state = self._next()
        if state.stopped or state.mode != _RUNNING:
            raise SafetyError(state.stopped or "robot", f"the robot is stopped; nothing moved{self._cure(state)}")
        if state.speed < 1:
            said = f"the pendant's speed slider is at {state.speed:.0%}, which slows strikes down; set it to 100 %"
            raise SafetyError("start", f"{said}; nothing moved")

    def _start_program(self) -> None:
        """Start the client's program on the controller, and tell it the payload and the watchdog's frequency."""
        control = self._control
        if control is None:
            raise SafetyError("lost", "the robot is not connected")
        until = time.monotonic() + _REACH
        with suppress(RuntimeError):
            control.reuploadScript()
            while not control.isProgramRunning() and time.monotonic() < until:
                time.sleep(0.01)
        if not control.isProgramRunning():
            raise SafetyError("program", "the controller did not start the client's program; nothing moved")
        load = self._payload
        if load is not None and not control.setTargetPayload(load.mass, list(load.center), list(load.inertia)):
            raise InputError("payload", load, "a payload that the controller accepts")
        if not control.setWatchdog(WATCHDOG):
            raise SafetyError("program", "the controller did not accept the watchdog; nothing moved")

    def _end_program(self, *, moving: bool = False) -> None:
        """End the program, so that nothing moves the arm any more; brake before, if it may move."""
        _end_after(_HANGING)
        with suppress(RuntimeError, ValueError):
            if moving and self._control.isProgramRunning():
                self._control.servoStop(DECELERATION)
            if self._control.isProgramRunning():
                self._control.stopScript()
            else:  # it may be paused
                self._dashboard.stop()

    def _track(self, motion: _Motion, record: Record, stop: Stop) -> None:
        """Answer each state with a command until the arm rests at the end, or was brought to rest."""
        state, reason = self._next(), None
        began, last = state.t, None
        while True:
            _end_after(_STUCK + self._patience)
            t = state.t - began
            u = motion.command(t)
            record(Sample(t, state.q, state.v, u, None, state.target, state.current))
            self._check_going(state, first=last is None)
            if reason is None and (reason := stop()):
                motion.stop(t)
            rests = bool(np.abs(state.v).max() < RESTING)
            if t >= motion.end and rests and np.abs(state.q - motion.command(motion.end)).max() < 10 * RESTING:
                break
            if t > motion.end + SETTLING:
                raise SafetyError("tracking", f"the arm does not rest {SETTLING:g} s after the last command")
            self._send(u)
            last, state = state.t, self._next(state.t)
        if reason is not None:
            raise SafetyError("signal", reason)

    def _cure(self, state: _State) -> str:
        """What a person does about a stop; empty where the pendant says it."""
        protective = state.stopped == "protective"
        return f"; remove its cause, then {RECOVER} ur://{self.o.host}" if protective else ""

    def _check_going(self, state: _State, *, first: bool) -> None:
        """Raise if the robot was stopped."""
        if state.stopped:
            raise SafetyError(state.stopped, f"the robot made a {state.stopped} stop{self._cure(state)}")
        if state.mode != _RUNNING:
            raise SafetyError("robot", f"the robot is in mode {state.mode}, not running")
        if state.program != _PLAYING and not first:
            raise SafetyError("program", "the program ended, at the pendant or by the controller")

    def _send(self, u: np.ndarray) -> None:
        try:
            done = self._control.servoJ(u.tolist(), 0.0, 0.0, 1 / RATE, self.o.lookahead, self.o.gain)
        except (RuntimeError, ValueError) as error:
            self.lost = True
            raise SafetyError("lost", f"a command could not be sent: {error}") from None
        if not done:
            self._check_going(self._next(), first=False)
            raise SafetyError("program", "the controller took no command")


class _Motion:
    """What is commanded over time: a trajectory, and a stop from it."""

    def __init__(self, trajectory: JointTrajectory, limits: Sequence[JointLimits], lag: ServoLag | None) -> None:
        self._limits, self._lag = limits, lag
        t, a = trajectory.t, interp1d(trajectory.t, trajectory.a, axis=0)
        path = CubicHermiteSpline(t, trajectory.q, trajectory.v)
        grid = np.minimum(np.arange(int(np.ceil(t[-1] * RATE - 1e-9)) + 1) / RATE, t[-1])
        self._path = path(grid), path(grid, 1), a(grid)
        self._from = 0.0
        self._commands = self._leading()

    @property
    def end(self) -> float:
        """Time of the last command [s]."""
        return self._from + (len(self._commands) - 1) / RATE

    def command(self, t: float) -> np.ndarray:
        """Return the command at a time [s], (n,)."""
        return self._commands[self._at(t)]

    def stop(self, t: float) -> None:
        """Stop from the motion at a time [s] on, within the joints' limits."""
        now = self._at(t)
        q, v, a = (x[now] for x in self._path)
        self._path, self._from = path_to_rest(q, v, a, self._limits, RATE), t
        self._commands = self._leading()

    def _at(self, t: float) -> int:
        return min(max(round((t - self._from) * RATE), 0), len(self._commands) - 1)

    def _leading(self) -> np.ndarray:
        return self._path[0] if self._lag is None else self._lag.leading(*self._path)


class _Talk:
    """The process's side of the connection to the one that started it."""

    def __init__(self, pipe: Connection) -> None:
        self._pipe, self._waiting = pipe, SimpleQueue[Any]()
        self._sender = threading.Thread(target=self._send, daemon=True)
        self._sender.start()

    def tell(self, kind: str, value: Any = None) -> None:
        """Send without waiting: a reader that is late must not hold up the robot."""
        self._waiting.put((kind, value))

    def finish(self) -> None:
        """Wait until all is sent, or no process reads it any more."""
        self._waiting.put(None)
        self._sender.join(_REACH)

    def asked(self) -> tuple[Any, ...]:
        """Wait for the next question; the other process's end is the question `quit`."""
        try:
            return self._pipe.recv()
        except (EOFError, OSError):
            return ("quit",)

    def stop(self) -> str | None:
        """Return why the motion has to stop."""
        if not self._pipe.poll():
            return None
        name, *given = self.asked()
        return str(given[0]) if name == "stop" else "the program that commanded the robot has ended"

    def _send(self) -> None:
        with suppress(OSError):
            while (message := self._waiting.get()) is not None:
                self._pipe.send(message)


def _end_after(seconds: float) -> None:
    """Let the kernel end this process after a time; 0: never. A call of the client may not return, and hold the lock of
    the interpreter, after its connection was lost.
    """
    signal.setitimer(signal.ITIMER_REAL, seconds)


def serve(fd: int) -> None:
    """Main function of the client's process: receive the parameters, then do what is asked until the end."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGALRM, signal.SIG_DFL)
    talk = _Talk(Connection(fd))
    client = UrClient(talk.asked()[0])
    while not client.lost:
        name, *given = talk.asked()
        if name == "stop":  # it came after the motion's end
            continue
        if name == "quit":
            client.finish()
            break
        _end_after(_HANGING)
        try:
            if name == "follow":
                client.follow(given[0], given[1], lambda sample: talk.tell("sample", sample), talk.stop)
                talk.tell("done")
            else:
                talk.tell("done", getattr(client, name)(*given))
        except SafetyError as error:
            talk.tell("stopped", (error.kind, str(error).removeprefix(f"{error.kind}: ")))
        except InputError as error:
            talk.tell("refused", (error.name, error.given, error.allowed, error.fix))
        _end_after(0)
    talk.finish()
    os._exit(0)  # not the client's own end, which takes two seconds, and crashes after a lost connection


if __name__ == "__main__":
    serve(int(sys.argv[1]))
