"""Driver of Franka's robots on the maker's `pylibfranka`: joint positions at 1 kHz.

`pylibfranka` speaks the protocol of the Franka Research 3, not the older one of the Panda. The robot judges every
received position by differences to those before, and stops by a reflex beyond its limits, so that a trajectory is
judged the same way before the robot receives any of it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from whiptool.errors import InputError
from whiptool.extras import optional
from whiptool.models.joint_trajectory import JointTrajectory
from whiptool.models.smooth_path import path_to_rest
from whiptool.models.spatial_arm import JointLimits
from whiptool.models.strike import eased
from whiptool.progress import note
from whiptool.rig.robots.robot import RECOVER, Payload, Record, Robot, Sample, Stop
from whiptool.rig.stops import SafetyError, StrikeRefused

STEP = 1e-3  # [s] of the robot's controller
TORQUES, FORCES = (40.0, 40.0, 36.0, 36.0, 32.0, 28.0, 24.0), (60.0,) * 3 + (30.0,) * 3  # [N m], [N, N m] of collisions
ACCELERATION, JERK, MARGIN = 10.0, 5000.0, 1e-3  # [rad/s^2, rad/s^3, rad/s] of all joints: libfranka's rate_limiting.h
_BLENDED = 1.0  # [s] in which the difference of the robot's last command from the first sample vanishes
_BRAKING = 0.95  # share of acceleration and jerk with which it brakes; the rest is for rounding
_RESTING, _LONGEST = 0.02, 0.5  # [rad/s] and less is rest, [s] that the arm is waited for at the end
_REALTIME = Path("/sys/kernel/realtime")  # of Linux: 1 in a kernel with PREEMPT_RT


class Franka(Robot):
    """A Franka robot with the Franka Control Interface (FCI), whose 7 joints follow positions at 1 kHz.

    Args:
        host: Address of the robot's controller.
        limits: Limits of the joints, (7,), such as `preset("fr3").arm.joint_limits`; those of the robot's interface
            hold in any case: 10 rad/s^2, 5000 rad/s^3, and a reserve of 0.001 rad/s.
        torques: Torques of the joints that count as a collision [N m], (7,).
        forces: Forces and moments at the flange that count as a collision [N, N m], (6,).

    Raises:
        InputError: The numbers of limits or thresholds are wrong.
        MissingPackage: `pylibfranka` is not installed.
    """

    n, rate = 7, 1 / STEP

    def __init__(
        self,
        host: str,
        limits: Sequence[JointLimits],
        *,
        torques: Sequence[float] = TORQUES,
        forces: Sequence[float] = FORCES,
    ) -> None:
        for name, values, count in (("limits", limits, 7), ("torques", torques, 7), ("forces", forces, 6)):
            if len(values) != count:
                raise InputError(name, f"{len(values)} values", f"{count} values")
        self.address = f"franka://{host}"
        self.host, self.limits = host, tuple(map(_interface, limits))
        self._torques, self._forces = list(torques), list(forces)
        self._library: Any = optional("pylibfranka", "for robots of Franka")
        self._robot: Any = None

    def connect(self) -> None:
        self._open()
        mode = self._robot.read_once().robot_mode
        if mode != self._library.RobotMode.Idle:
            given = f"{self.address} in the mode {mode.name}"
            raise InputError("robot", given, "a robot that is idle", self._cure(mode.name))

    def _open(self) -> None:
        """Connect, and set what counts as a collision."""
        realtime = _REALTIME.exists() and _REALTIME.read_text().strip() == "1"
        config = self._library.RealtimeConfig
        if not realtime:
            note("this computer has no realtime kernel: late commands may end a motion of the robot by a reflex")
        try:
            self._robot = self._library.Robot(self.host, config.kEnforce if realtime else config.kIgnore)
            self._robot.set_collision_behavior(self._torques, self._torques, self._forces, self._forces)
        except (RuntimeError, self._library.FrankaException) as error:
            fix = f"activate FCI and unlock the joints in Desk, and check the network ({_words(error)})"
            raise InputError(
                "robot", self.address, "the address of a Franka robot whose FCI is reachable", fix
            ) from None

    def disconnect(self) -> None:
        robot, self._robot = self._robot, None
        if robot is not None:
            with suppress(RuntimeError, self._library.FrankaException):  # of a lost connection
                robot.stop()

    def posture(self) -> np.ndarray:
        return np.array(self._state().q)

    def _state(self) -> Any:
        if self._robot is None:
            raise SafetyError("connection", "the robot is not connected")
        try:
            return self._robot.read_once()
        except (RuntimeError, self._library.FrankaException) as error:
            raise SafetyError("connection", _words(error)) from None

    def set_payload(self, payload: Payload) -> None:
        xx, yy, zz, xy, xz, yz = payload.inertia
        try:
            self._robot.set_load(payload.mass, list(payload.center), [xx, xy, xz, xy, yy, yz, xz, yz, zz])
        except (RuntimeError, self._library.FrankaException) as error:
            raise InputError("payload", payload, "a load that the robot accepts", _words(error)) from None

    def follow(self, trajectory: JointTrajectory, record: Record, stop: Stop) -> None:
        self._check(trajectory)
        self.check_start(trajectory)
        state = self._state()
        path = _from_command(trajectory, np.array(state.q_d))
        self._check(path)
        motion = _Motion(path, self.limits, record, stop)
        fault = self._moved(motion)
        if motion.error is not None:
            raise motion.error
        if fault is not None:
            raise fault
        if motion.reason is not None:
            raise SafetyError("signal", motion.reason)

    def _moved(self, motion: _Motion) -> SafetyError | None:
        """Carry out a motion; return the fault that ended it. No reference to its control is left, which would keep a
        lost connection open, so that the robot would take no other.
        """
        mode, position = self._library.ControllerMode.JointImpedance, self._library.JointPositions
        try:
            motion.run(self._robot.start_joint_position_control(mode), position)
            return None
        except self._library.NetworkException as error:
            fault = SafetyError("connection", _words(error))
        except (RuntimeError, self._library.FrankaException) as error:
            fault = SafetyError("reflex", f"{_words(error)}; {self._cure('Reflex')}")
        if fault.kind == "connection":
            self._robot = None  # `recover` makes another
            return fault
        with suppress(SafetyError):
            motion.keep(self._state())  # after the fault
        return fault

    def _check(self, trajectory: JointTrajectory) -> None:
        """Refuse a trajectory that the robot would end by a reflex, before it receives any of it."""
        beyond = trajectory.beyond(self.limits)
        said = None if beyond is None else str(beyond)
        if trajectory.q.shape[1] != self.n:
            said = f"it has {trajectory.q.shape[1]} joints, the robot has {self.n}"
        elif np.abs(np.diff(trajectory.t) - STEP).max() > 1e-6 * STEP:
            said = f"its samples are {np.diff(trajectory.t).max():g} s apart, those of the robot {STEP:g} s"
        elif trajectory.v[[0, -1]].any():
            said = "it does not begin and end at rest"
        if said is not None:
            raise StrikeRefused("trajectory", repr(trajectory), "samples at 1 kHz within the robot's limits", said)

    def recover(self) -> None:
        if self._robot is None:
            self._open()
        robot: Any = self._robot
        try:
            robot.automatic_error_recovery()
        except (RuntimeError, self._library.FrankaException) as error:
            raise SafetyError("recovery", f"{_words(error)}; {self._cure('Reflex')}") from None
        state = self._state()
        mode = state.robot_mode
        if mode != self._library.RobotMode.Idle or state.current_errors:
            raise SafetyError("recovery", f"the robot is in the mode {mode.name}: {self._cure(mode.name)}")

    def _cure(self, mode: str) -> str:
        """What a person does about a mode of the robot."""
        cures = {
            "UserStopped": "release the robot's stop button (external activation device)",
            "Guiding": "let go of the robot's guiding buttons",
            "Reflex": f"remove the cause, and acknowledge the fault in Desk or by {RECOVER} {self.address}",
            "Other": "unlock the joints and activate FCI in Desk",
        }
        return cures.get(mode, "wait until the robot is idle")


def _interface(own: JointLimits) -> JointLimits:
    """The limits of a joint together with those of the robot's interface."""
    acceleration, jerk = min(own.acceleration, ACCELERATION), min(own.jerk, JERK)
    return replace(own, acceleration=acceleration, jerk=jerk, velocity_margin=max(own.velocity_margin, MARGIN))


class _Motion:
    """One motion of the robot: which sample it is given in each cycle, and when it brakes.

    Attributes:
        reason: Reason of a stop; None: none.
        error: Exception that `record` or `stop` raised, after which the arm was brought to rest; None: none.
    """

    def __init__(self, path: JointTrajectory, limits: Sequence[JointLimits], record: Record, stop: Stop) -> None:
        self._path, self._limits, self._record, self._stop = path, limits, record, stop
        self._began: float | None = None
        self._first = 0  # cycle of the path's first sample
        self.reason: str | None = None
        self.error: BaseException | None = None

    def run(self, control: Any, positions: Callable[[list[float]], Any]) -> None:
        """Answer every state of the robot with a position, until the arm rests at the end of the path."""
        ended = False
        try:
            while not ended:
                state, _ = control.readOnce()
                cycle = self.keep(state)
                self._ask()
                if (self.reason is not None or self.error is not None) and not self._first:
                    self._brake(cycle)
                i = min(cycle - self._first, len(self._path.t) - 1)
                over = cycle - self._first - i
                ended = over > 0 and bool(np.abs(state.dq).max() < _RESTING or over * STEP > _LONGEST)
                command = positions(self._path.q[i].tolist())
                command.motion_finished = ended
                control.writeOnce(command)
        finally:
            del control  # the traceback of an error would keep it

    def keep(self, state: Any) -> int:
        """Record a state; return its cycle, by the robot's clock."""
        time = state.time.to_sec()
        self._began = time if self._began is None else self._began
        t, tau = time - self._began, np.array(state.tau_J)
        try:
            self._record(Sample(t, np.array(state.q), np.array(state.dq), np.array(state.q_d), tau))
        except BaseException as error:
            self.error = self.error or error
        return round(t / STEP)

    def _ask(self) -> None:
        if self.reason is None and self.error is None:
            try:
                self.reason = self._stop()
            except BaseException as error:
                self.error = error

    def _brake(self, cycle: int) -> None:
        """Go over to the fastest stop, unless it leads beyond a range: then the path goes on for one more cycle."""
        i = min(cycle, len(self._path.t) - 1)
        p = self._path
        q, v, a = path_to_rest(p.q[i], p.v[i], p.a[i], self._limits, 1 / STEP, share=_BRAKING)
        low, high = np.array([joint.position for joint in self._limits]).T
        if (q > high).any() or (q < low).any():
            return
        if len(q) > 1:
            self._path, self._first = JointTrajectory(p.joints, np.arange(len(q)) * STEP, q, v, a), cycle


def _from_command(trajectory: JointTrajectory, q_d: np.ndarray) -> JointTrajectory:
    """A trajectory that begins at the robot's last command (7,); the difference vanishes within a second."""
    D = min(_BLENDED, float(trajectory.t[-1]))
    left, v, a = (x[:, None] * (q_d - trajectory.q[0]) for x in eased(trajectory.t, D))
    q = trajectory.q + (q_d - trajectory.q[0]) - left
    return JointTrajectory(trajectory.joints, trajectory.t, q, trajectory.v - v, trajectory.a - a)


def _words(error: BaseException) -> str:
    return str(error).removeprefix("libfranka: ").replace("\n", " ")
