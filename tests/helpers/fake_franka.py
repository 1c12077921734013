"""A stand-in for `pylibfranka`: a robot that follows every command at once, and fails when it is told to."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np


class FakeFranka:
    """The module, its only robot, and its control of a motion in one.

    Attributes:
        q: Where the robot is, (7,).
        mode: Name of its mode.
        commands: Positions that it received, with whether each ends the motion.
        fails: Errors by the cycle of a motion in which they come.
        lost: Cycles that are lost before a cycle, by cycle.
        calls: Names of the other calls, with their arguments.
    """

    def __init__(self, q: np.ndarray) -> None:
        self.q, self.mode, self.time, self.cycle = np.array(q), "Idle", 5.0, 0
        self.commands: list[tuple[np.ndarray, bool]] = []
        self.fails: dict[int, Exception] = {}
        self.lost: dict[int, int] = {}
        self.calls: list[tuple[Any, ...]] = []
        self.offset = np.zeros(7)  # of the measured from the commanded position
        modes = ("Other", "Idle", "Move", "Guiding", "Reflex", "UserStopped")
        self.RobotMode = SimpleNamespace(**{name: SimpleNamespace(name=name) for name in modes})
        self.RealtimeConfig = SimpleNamespace(kIgnore="ignored", kEnforce="enforced")
        self.ControllerMode = SimpleNamespace(JointImpedance="joints")

    class FrankaException(Exception):
        """libfranka's."""

    class ControlException(RuntimeError):
        """libfranka's."""

    class CommandException(RuntimeError):
        """libfranka's."""

    class NetworkException(RuntimeError):
        """libfranka's."""

    def Robot(self, host: str, realtime: str) -> FakeFranka:
        self.calls.append(("Robot", host, realtime))
        return self

    def JointPositions(self, q: list[float]) -> SimpleNamespace:
        return SimpleNamespace(q=q, motion_finished=False)

    def read_once(self) -> SimpleNamespace:
        mode, zeros = getattr(self.RobotMode, self.mode), np.zeros(7)
        time = SimpleNamespace(to_sec=lambda now=self.time: now)
        q = (self.q + self.offset).tolist()
        return SimpleNamespace(robot_mode=mode, q=q, q_d=self.q.tolist(), dq=zeros, tau_J=zeros + 1, time=time,
                               current_errors="" if self.mode != "Reflex" else "joint_reflex")  # fmt: skip

    def __getattr__(self, name: str) -> Any:
        if name.startswith(("set_", "stop", "automatic")):
            return lambda *given: self._called(name, *given)
        raise AttributeError(name)

    def _called(self, name: str, *given: Any) -> None:
        self.calls.append((name, *given))
        if name == "automatic_error_recovery":
            if self.mode == "UserStopped":
                raise self.CommandException("libfranka: command rejected")
            self.mode = "Idle"

    def start_joint_position_control(self, mode: str) -> FakeFranka:
        self.calls.append(("start", mode))
        self.cycle = 0
        return self

    def readOnce(self) -> tuple[SimpleNamespace, None]:
        if self.cycle in self.fails:
            self.mode = "Reflex"
            raise self.fails[self.cycle]
        self.time += 1e-3 * (1 + self.lost.get(self.cycle, 0))
        self.cycle += 1
        return self.read_once(), None

    def writeOnce(self, command: SimpleNamespace) -> None:
        assert self.mode == "Idle", "a command after a fault"
        assert not (self.commands and self.commands[-1][1] and self.cycle > 1), "a command after the end"
        self.q = np.array(command.q)
        self.commands.append((self.q, command.motion_finished))
