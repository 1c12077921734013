"""The program that the client ur_rtde uploads, executed by its meaning: commands in registers.

The program reads a command's number from integer register 0 and its numbers from further registers, and answers in the
output registers: 1 is ready, 2 is done. Commands of real time (servoJ, speedJ) are read in every period, others once,
until the client clears the register. The text of the program is not interpreted; it has to be ur_rtde's.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Protocol

import numpy as np

from whiptool.rig.ur_emulator.dh_arm import speeds, tool_pose
from whiptool.rig.ur_emulator.ur_joints import ServoJ, UrJoints

READY, DONE = 1, 2
STOP_SCRIPT, SERVOJ = 255, 11
_IN_REAL_TIME = (SERVOJ, 9, 38, 58)
_SHIFTED = re.compile(r"reg_offset_int = # int register offset\s*(\d+)")


class Unknown(Exception):
    """The program does something that is not emulated."""


class Host(Protocol):
    """What the program acts on.

    Attributes:
        joints: The arm's joints.
        payload: Mass [kg], centre of mass [m] (3), moments of inertia [kg m^2] (6), as far as they were set.
        tool: Pose of the tool in the flange's frame, (6,).
    """

    joints: UrJoints
    payload: tuple[float, Sequence[float], Sequence[float]]
    tool: np.ndarray

    @property
    def torques(self) -> np.ndarray:
        """Torques of the joints [N m], (6,)."""
        ...

    def protect(self) -> None:
        """Make a protective stop."""
        ...

    def watch(self, frequency: float) -> None:
        """Stop the program when inputs come less often than a frequency [1/s]."""
        ...


class ControlScript:
    """A running program of ur_rtde.

    Args:
        text: The program's text.
        host: What it acts on.

    Raises:
        Unknown: The text is not a control program of ur_rtde.
    """

    def __init__(self, text: str, host: Host) -> None:
        shift = _SHIFTED.search(text)
        if "def rtde_control" not in text or shift is None:
            raise Unknown("a program other than ur_rtde's control program")
        self.shift, self._host = int(shift[1]), host
        self.servoing = False
        self.outputs: dict[str, Any] = {self._output("int", 0): READY, self._output("int", 2): 0}
        self._executing = False
        self._blocked = False  # by a motion that the program waits for
        self._inputs: Mapping[str, Any] = {}
        self._commands: dict[int, Callable[[], bool]] = {
            1: self._movej, 9: self._speedj, 11: self._servoj, 15: self._stop_by_rate, 16: self._servo_stop,
            17: self._set_payload, 29: self._set_tcp, 31: self._protective_stop, 33: self._stopl,
            34: self._stop_by_rate, 35: self._set_watchdog, 38: self._joint_torques, 43: self._forward_kinematics,
            47: self._is_steady, 58: self._flange_pose, 65: self._set_target_payload,
        }  # fmt: skip

    def step(self, inputs: Mapping[str, Any], *, moved: bool) -> bool:
        """Do what the main loop does in a period; return whether the program goes on.

        Args:
            inputs: Values of the input registers.
            moved: Whether the motion that was begun has ended.

        Raises:
            Unknown: A command is not emulated.
        """
        self._inputs = inputs
        if self._blocked:
            self._blocked = not moved
            if not self._blocked:
                self._answer(DONE)
            return True
        command = int(inputs.get(self._input("int", 0), 0))
        if command == STOP_SCRIPT:
            return False
        if command == 0 or command in _IN_REAL_TIME:
            self._executing = False
            if command:
                self._execute(command)
            self._answer(READY)
        elif not self._executing:
            self._executing, self._blocked = True, self._execute(command)
            if not self._blocked:
                self._answer(DONE)
        return True

    def _execute(self, command: int) -> bool:
        """Begin a command; return whether the program waits for a motion."""
        if command not in self._commands:
            raise Unknown(f"command {command} of ur_rtde's control program")
        return self._commands[command]()

    def _input(self, kind: str, i: int) -> str:
        return f"input_{kind}_register_{i + self.shift}"

    def _output(self, kind: str, i: int) -> str:
        return f"output_{kind}_register_{i + self.shift}"

    def _numbers(self, first: int, count: int) -> np.ndarray:
        return np.array([self._inputs.get(self._input("double", first + i), 0.0) for i in range(count)])

    def _number(self, i: int) -> float:
        return float(self._numbers(i, 1)[0])

    def _answer(self, state: int) -> None:
        self.outputs[self._output("int", 0)] = state

    def _give(self, values: np.ndarray) -> bool:
        self.outputs |= {self._output("double", i): float(value) for i, value in enumerate(values)}
        return False

    def _movej(self) -> bool:
        self._host.joints.move(self._numbers(0, 6), self._number(6), self._number(7))
        return not self._inputs.get(self._input("int", 1), 0)

    def _speedj(self) -> bool:
        self._host.joints.accelerate(self._numbers(0, 6), self._number(6))
        return False

    def _servoj(self) -> bool:
        self.servoing = True
        self._host.joints.servo(ServoJ(self._numbers(0, 6), self._number(9), self._number(10)))
        return False

    def _stop_by_rate(self) -> bool:
        self._host.joints.brake(self._number(0))
        return True

    def _servo_stop(self) -> bool:
        self.servoing = False
        return self._stopl()

    def _stopl(self) -> bool:
        """Slow down in the time that the tool needs with the given deceleration [m/s^2]; at least in one period."""
        joints = self._host.joints
        joints.brake_within(speeds(joints.q, joints.v, self._host.tool)[2] / self._number(0))
        return True

    def _set_payload(self) -> bool:
        self._host.payload = self._number(0), tuple(self._numbers(1, 3)), self._host.payload[2]
        return False

    def _set_target_payload(self) -> bool:
        self._host.payload = self._number(0), tuple(self._numbers(1, 3)), tuple(self._numbers(4, 6))
        return False

    def _set_tcp(self) -> bool:
        self._host.tool = self._numbers(0, 6)
        return False

    def _protective_stop(self) -> bool:
        self._host.protect()
        return False

    def _set_watchdog(self) -> bool:
        self._host.watch(self._number(0))
        return False

    def _joint_torques(self) -> bool:
        return self._give(self._host.torques)

    def _forward_kinematics(self) -> bool:
        return self._give(tool_pose(self._host.joints.q, self._host.tool))

    def _flange_pose(self) -> bool:
        return self._give(tool_pose(self._host.joints.q, np.zeros(6)))

    def _is_steady(self) -> bool:
        self.outputs[self._output("int", 1)] = int(not self._host.joints.moving)
        return False
