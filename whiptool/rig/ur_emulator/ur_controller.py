"""The emulated controller of a UR: its clock, registers, program, safety and what it reports."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np

from whiptool.errors import InputError, cut
from whiptool.impedance.arm import Arm
from whiptool.models.presets import preset
from whiptool.rig.ur_emulator.control_script import ControlScript, Unknown
from whiptool.rig.ur_emulator.dh_arm import speeds, tool_pose
from whiptool.rig.ur_emulator.ur_joints import BRAKE, PERIOD, SANITY, UrJoints

HOME = (0.0, -np.pi / 2, 0.0, -np.pi / 2, 0.0, 0.0)  # [rad] upright, as a UR stands when it is unpacked
STOPPED, PLAYING, PAUSED = 1, 2, 4  # values of `runtime_state`
TORQUE_PER_AMPERE = 10.0  # [N m/A] at the output; not published, assumed
_BITS = {"normal": 1 << 0, "protective": 1 << 2 | 1 << 10, "emergency": 1 << 6 | 1 << 7 | 1 << 10}
_MODES = {"normal": 1, "protective": 3, "emergency": 7}

FaultKind = Literal[
    "protective",  # a protective stop
    "emergency",  # the emergency stop is pressed
    "halt",  # a person stops the program at the pendant
    "cut",  # the connections are closed
    "silence",  # nothing passes the network
    "unheard",  # what the client sends is lost
    "unseen",  # what the robot sends is lost
]
OF_THE_NETWORK = ("silence", "unheard", "unseen")


@dataclass(frozen=True)
class UrFault:
    """A fault of the emulated robot or its network.

    Args:
        kind: `protective`, `emergency` or `halt` (the program is stopped at the pendant) stop the robot; `cut` closes
            the connections; with `silence` nothing passes the network, with `unheard` what the client sends is lost,
            with `unseen` what the robot sends.
        at: Time from which it occurs [s], since the arm began to follow commands of servoj.
        lasting: Duration of a fault of the network [s].

    Raises:
        InputError: The kind is unknown.
    """

    kind: FaultKind
    at: float = 0.0
    lasting: float = 1e9

    def __post_init__(self) -> None:
        if self.kind not in get_args(FaultKind):
            raise InputError("fault", self.kind, ", ".join(get_args(FaultKind)))


@dataclass(frozen=True)
class UrOptions:
    """Options of the emulated robot.

    Args:
        host: Address on which it serves; any of 127.0.0.0/8.
        posture: Joint positions at the start [rad], (6,).
        latency: Periods of 2 ms from sending a command until a state shows its effect, which begins a period before;
            4 to 6 ms were measured on a UR10e, see `ur_joints`. Programs take as long.
        joint_speed: Largest speed of a joint [rad/s]; beyond it the controller makes a protective stop.
        elbow_speed, tool_speed: Largest speeds of the elbow, and of flange and tool [m/s], likewise.
        unlock_after: Time before which a protective stop cannot be unlocked [s].
        remote_control: Whether the pendant is set to remote control.
        speed_slider: Position of the pendant's speed slider, 0 to 1; it is reported, and slows nothing down here.
        lockstep: Whether time waits for the client's next command of servoj while the arm follows them. A real
            controller does not wait; tests are then independent of how fast the machine is.
    """

    host: str = "127.0.0.2"
    posture: Sequence[float] = HOME
    latency: int = 2
    joint_speed: float = 3.35
    elbow_speed: float = 5.0
    tool_speed: float = 5.0
    unlock_after: float = 5.0
    remote_control: bool = True
    speed_slider: float = 1.0
    lockstep: bool = False


class UrController:
    """State of the robot, which advances by one period at a time.

    Args:
        options: Options of the robot.

    Attributes:
        t: Time since the start [s].
        payload, tool: See `Host` of the control program.
        history: Time [s], positions [rad], speeds [rad/s] and whether servoj was commanded, of every period: rows of
            14 numbers.
        log: Sentences on what happened; `on_log` is called with each.
    """

    def __init__(self, options: UrOptions) -> None:
        self.options, self.t = options, 0.0
        self.joints = UrJoints(np.array(options.posture, float))
        self.payload: tuple[float, Sequence[float], Sequence[float]] = (0.0, (0.0,) * 3, (0.0,) * 6)
        self.tool = np.zeros(6)
        model = preset("ur5e")
        self._arm, self._masses = Arm(model), tuple(model.arm.per_link("mass"))
        self.program: ControlScript | None = None
        self.paused, self.safety = False, "normal"
        self.history: list[np.ndarray] = []
        self.log: list[str] = []
        self.on_log: Callable[[str], None] = lambda sentence: None
        self.began: float | None = None  # when servoj was first commanded
        self._inputs: dict[str, Any] = {}
        self._arriving: deque[tuple[float, Mapping[str, Any] | str]] = deque()
        self._watched: float | None = None  # [s] within which an input has to come
        self._heard = self._stopped_at = 0.0
        self._moved = True
        self._faults: list[UrFault] = []

    @property
    def torques(self) -> np.ndarray:
        """Torques that the present motion and the payload's weight at the flange need [N m], (6,)."""
        joints = self.joints
        weight = self._arm.gravity_compensation(joints.q, (*self._masses, self.payload[0]))
        return self._arm.feedforward(joints.q, joints.v, joints.a) + weight

    @property
    def servoing(self) -> bool:
        """Whether the arm follows commands of servoj."""
        return self.program is not None and self.program.servoing and not self.paused

    def say(self, sentence: str) -> None:
        """Log what happened, in printable characters and shortened."""
        sentence = "".join(x if x.isprintable() else "?" for x in cut(sentence))
        self.log.append(sentence)
        self.on_log(sentence)

    def add(self, fault: UrFault) -> None:
        """Schedule a fault."""
        self._faults.append(fault)

    def due(self) -> list[UrFault]:
        """Return, once each, the faults that occur now."""
        since = -1.0 if self.began is None else self.t - self.began
        now = [fault for fault in self._faults if fault.at <= since + 1e-9]
        self._faults = [fault for fault in self._faults if fault not in now]
        return now

    def receive(self, sent: Mapping[str, Any] | str) -> None:
        """Take values of input registers, or a program, which have their effect after the latency, in order."""
        self._arriving.append((self.t + (self.options.latency - 0.5) * PERIOD, sent))

    def play(self, text: str) -> None:
        """Start a program, in place of one that runs."""
        self.end_program("another program came")
        if self.safety != "normal":
            self.say(f"a program was refused in the safety mode {self.safety}")
            return
        try:
            self.program, self.paused = ControlScript(text, self), False
        except Unknown as unknown:
            self.say(f"{unknown} is not emulated")

    def end_program(self, reason: str) -> None:
        """End the program; the controller brings the joints to rest."""
        if self.program is None:
            return
        self.say(f"{self.t:.3f} s: the program ended: {reason}")
        self.program, self.paused, self._watched = None, False, None
        if self.joints.moving:
            self.joints.brake(BRAKE)
        else:
            self.joints.rest()

    def protect(self, reason: str = "asked by the program") -> None:
        """Make a protective stop: the joints are brought to rest, and the program pauses."""
        if self.safety == "normal":
            self._halt("protective", reason)

    def press(self) -> None:
        """Press the emergency stop: the joints are brought to rest, and the program ends."""
        self._halt("emergency", "pressed")
        self.end_program("emergency stop")

    def _halt(self, safety: str, reason: str) -> None:
        self.safety, self._stopped_at = safety, self.t
        self.paused = self.program is not None
        self.say(f"{self.t:.3f} s: {safety} stop: {reason}")
        self.joints.brake(BRAKE)

    def unlock(self) -> bool:
        """Release a protective stop, if it is old enough; the paused program stays paused."""
        if self.safety == "protective" and self.t - self._stopped_at >= self.options.unlock_after:
            self.safety = "normal"
            return True
        return False

    def watch(self, frequency: float) -> None:
        """Stop the program when inputs come less often than a frequency [1/s]."""
        self._watched, self._heard = 1 / frequency, self.t

    def cycle(self) -> None:
        """Advance by one period."""
        self.t += PERIOD
        while self._arriving and self._arriving[0][0] <= self.t:
            arrived, self._heard = self._arriving.popleft()[1], self.t
            if isinstance(arrived, str):
                self.play(arrived)
            else:
                self._inputs |= arrived
        if self._watched is not None and self.t - self._heard > self._watched:
            self.end_program("no input came within the watchdog's time")
        if self.program is not None and not self.paused:
            self._run(self.program)
        if self.servoing and self.began is None:
            self.began = self.t
        self._moved = self.joints.step()
        self._check()
        row = [self.t, *self.joints.q, *self.joints.v, float(self.servoing)]
        self.history.append(np.array(row))

    def _run(self, program: ControlScript) -> None:
        try:
            if not program.step(self._inputs, moved=self._moved):
                self.end_program("it was asked to stop")
        except Unknown as unknown:
            self.end_program(f"{unknown} is not emulated")

    def _check(self) -> None:
        """Make a protective stop if a limit is exceeded."""
        o, joints = self.options, self.joints
        if self.safety != "normal" or not joints.moving:
            return
        elbow, flange, tool = speeds(joints.q, joints.v, self.tool)
        for what, value, most in (
            ("joint speed [rad/s]", float(np.abs(joints.v).max()), o.joint_speed),
            ("joint position [rad]", float(np.abs(joints.q).max()), 2 * np.pi),
            ("elbow speed [m/s]", elbow, o.elbow_speed),
            ("flange speed [m/s]", flange, o.tool_speed),
            ("tool speed [m/s]", tool, o.tool_speed),
            ("joint acceleration [rad/s^2]", float(np.abs(joints.a).max()), SANITY),
        ):
            if value > most:
                self.protect(f"{what} {value:.3f} is beyond {most:g}")
                return

    def outputs(self) -> dict[str, Any]:
        """Return what is reported now, by the names of RTDE."""
        q, v, a, torques = self.joints.q, self.joints.v, self.joints.a, self.torques
        state = STOPPED if self.program is None else PAUSED if self.paused else PLAYING
        pose = tool_pose(q, self.tool)
        mass, center, inertia = self.payload
        registers = {} if self.program is None else self.program.outputs
        return registers | {
            "timestamp": self.t, "target_q": q, "target_qd": v, "target_qdd": a, "actual_q": q, "actual_qd": v,
            "target_moment": torques, "actual_current": torques / TORQUE_PER_AMPERE,
            "target_current": torques / TORQUE_PER_AMPERE, "actual_TCP_pose": pose, "target_TCP_pose": pose,
            "robot_mode": 3 if self.safety == "emergency" else 7, "joint_mode": [253] * 6,
            "safety_mode": _MODES[self.safety], "safety_status": _MODES[self.safety],
            "safety_status_bits": _BITS[self.safety], "robot_status_bits": 1 | (state == PLAYING) << 1,
            "runtime_state": state, "speed_scaling": 1.0, "target_speed_fraction": self.options.speed_slider,
            "payload": mass, "payload_cog": center, "payload_inertia": inertia, "joint_temperatures": [30.0] * 6,
        }  # fmt: skip
