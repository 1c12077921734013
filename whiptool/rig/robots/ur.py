"""Driver of robots by Universal Robots (e-Series): `servoJ` at 500 Hz through the client `ur_rtde`.

The way to a strike's start is commanded as the strike is, and not by `moveJ`: it is planned clear of the floor, and can
be stopped in every cycle. Joint positions are those of URDF and preset. Poses are not used; the controller's frame
`base` differs from ROS's `base_link`, which is the preset's, by half a turn about z.
"""

from __future__ import annotations

import subprocess
from collections.abc import Sequence
from contextlib import suppress
from multiprocessing.connection import Connection
from typing import Any

import numpy as np

from whiptool.errors import InputError
from whiptool.extras import require
from whiptool.identification.servo_lag import ServoLag
from whiptool.models.joint_trajectory import JointTrajectory
from whiptool.models.numbers import number
from whiptool.models.spatial_arm import JointLimits
from whiptool.rig.child_process import end_child, start_child
from whiptool.rig.robots.robot import Payload, Record, Robot, Stop
from whiptool.rig.robots.ur_client import RATE, Servoing
from whiptool.rig.stops import SafetyError
from whiptool.stop_signals import signals_held

LOOKAHEAD, GAIN = 0.1, 300.0  # defaults of URScript's servoj
PATIENCE = 0.05  # [s] without a state after which the connection is taken to be lost


class UniversalRobot(Robot):
    """A robot arm by Universal Robots.

    Args:
        host: Address of its controller.
        limits: Limits of its joints, (6,).
        lookahead: Look-ahead time of servoJ [s], 0.03 to 0.2.
        gain: Gain of servoJ, 100 to 2000.
        lag: Lag of the joints, see `fit_servo_lag`; commands lead by it, so that the arm follows the trajectory. None:
            the trajectory is commanded as it is.
        patience: Time without a state after which the connection is taken to be lost [s].

    Raises:
        InputError: A value is out of range.
    """

    n = 6
    rate = RATE
    leads = True

    def __init__(
        self,
        host: str,
        limits: Sequence[JointLimits],
        *,
        lookahead: float = LOOKAHEAD,
        gain: float = GAIN,
        lag: ServoLag | None = None,
        patience: float = PATIENCE,
    ) -> None:
        if len(limits) != self.n:
            raise InputError("limits", len(limits), f"limits of {self.n} joints")
        self.limits, self.lag = tuple(limits), lag
        lookahead = number("lookahead", lookahead, low=0.03, high=0.2)
        gain = number("gain", gain, low=100, high=2000)
        self._servoing = Servoing(host, self.limits, lookahead, gain, number("patience", patience, low=0, strict=True))
        self._process: subprocess.Popen[bytes] | None = None
        self._pipe: Connection | None = None

    def connect(self) -> None:
        require("the driver of a Universal Robot", ["rtde_control", "rtde_receive", "dashboard_client"])
        self._start()
        try:
            self._ask("connect")
        except BaseException:
            self._end()
            raise

    def disconnect(self) -> None:
        self._end()

    def posture(self) -> np.ndarray:
        return self._ask("posture")

    def set_payload(self, payload: Payload) -> None:
        self._ask("set_payload", payload)

    def follow(self, trajectory: JointTrajectory, record: Record, stop: Stop) -> None:
        if len(trajectory.joints) != self.n:
            raise InputError("trajectory", f"{len(trajectory.joints)} joints", f"{self.n} joints")
        self.check_start(trajectory)
        self._tell("follow", trajectory, self.lag)
        told = False
        try:
            while (answer := self._answer())[0] == "sample":
                record(answer[1])
                if not told and (reason := stop()):
                    self._tell("stop", reason)
                    told = True
        except SafetyError:
            raise
        except BaseException as error:
            self._tell("stop", f"{type(error).__name__} in the program")
            with suppress(SafetyError):
                while self._answer()[0] == "sample":
                    pass
            raise
        self._take(answer)

    def recover(self) -> None:
        """Acknowledge a protective stop.

        The controller refuses this within 5 s of the stop, for which the method waits.
        """
        require("the driver of a Universal Robot", ["dashboard_client"])
        connected = self._pipe is not None
        if not connected:
            self._start()
        try:
            self._ask("recover")
        finally:
            if not connected:
                self._end()

    def _start(self) -> None:
        self._end()
        self._process, self._pipe = start_child("whiptool.rig.robots.ur_client")
        self._tell(self._servoing)

    def _end(self) -> None:
        """Let the client's process stop the arm, and end it."""
        process, pipe = self._process, self._pipe
        self._process = self._pipe = None
        if pipe is not None:
            pipe.close()  # which the process takes as the order to end
        if process is not None:
            end_child(process)

    def _tell(self, *question: Any) -> None:
        if self._pipe is None:
            raise SafetyError("lost", "the robot is not connected")
        with suppress(OSError), signals_held():  # whoever waits for the answer sees that the process has ended
            self._pipe.send(question)

    def _answer(self) -> tuple[str, Any]:
        """Return the client's next message: its kind and its value.

        Raises:
            SafetyError: The client's process has ended.
        """
        if self._pipe is None:
            raise SafetyError("lost", "the robot is not connected")
        try:
            while not self._pipe.poll(0.1):
                pass
            with signals_held():
                return self._pipe.recv()
        except (EOFError, OSError):
            self._end()
            raise SafetyError(
                "lost", "the client's process has ended; the controller's watchdog ends the program on the robot"
            ) from None

    def _take(self, answer: tuple[str, Any]) -> Any:
        """Return the value of an answer, or raise the error that it tells."""
        kind, value = answer
        if kind == "refused":
            raise InputError(*value)
        if kind == "stopped":
            if value[0] == "lost":
                self._end()
            raise SafetyError(*value)
        return value

    def _ask(self, *question: Any) -> Any:
        self._tell(*question)
        return self._take(self._answer())
