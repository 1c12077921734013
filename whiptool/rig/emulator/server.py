"""The emulated bus behind a pseudo-terminal: bytes in, bytes out, and time going by."""

from __future__ import annotations

import fcntl
import os
import pty
import select
import sys
import termios
import time
import tty
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

from whiptool.errors import InputError
from whiptool.models.parameters import Model, number
from whiptool.models.presets import preset
from whiptool.rig.dynamixel.control_table import BAUD_RATES, Units
from whiptool.rig.emulator.faults import Fault, Faults, mangle
from whiptool.rig.emulator.instructions import Chain, beats
from whiptool.rig.emulator.motor import Motor
from whiptool.rig.emulator.packets import Packet, Parser
from whiptool.rig.emulator.physics import Physics
from whiptool.rig.emulator.servo import Protection, Servo

# With the wall clock [s]:
SILENCE = 0.02  # a packet that stops for longer is given up (the servo's 1.5 ms, with room for a busy host)
AT_ONCE = 0.002  # of simulated time that is caught up with before the next answer
LAG = 0.1  # simulated time that falls further behind is lost
_TCGETS2 = 0x802C542A  # of Linux; tells any rate, where termios.tcgetattr knows the classical ones only


@dataclass(frozen=True)
class TwinOptions:
    """What is emulated, and how its time runs.

    Args:
        model: Whip, arm, gravity; default: the preset `lemon2024`.
        motor: Of every joint; default: the XM430-W350 without friction. `HARDWARE` has friction and inertia.
        start: Arm posture at time 0 [rad], the whip hanging; default: straight down.
        lockstep: Time advances by `period` with every write of Goal Current, and not otherwise: runs repeat exactly.
            False: it runs with the wall clock.
        period: Control period in lock-step [s].
        command_delay: A goal acts this long after it was written [s].
        sample_delay: The servos show the state of this long ago [s].
        fineness: Counts of the registers are this many times finer than the real ones (1); a power of 2, to see what
            quantisation costs.
        ids: Of the servos, shoulder first; default: 1, 2, ..
        baud: Bits per second that the servos are set to.
        return_delay: Value of Return Delay Time(9), in 2 us; the factory's is 250.
        timestep, integrator: MuJoCo's step [s], and how it steps; default: the reference rollout's.
        protection: When a servo shuts itself down.
    """

    model: Model = field(default_factory=lambda: preset("lemon2024"))
    motor: Motor = field(default_factory=Motor)
    start: tuple[float, ...] | None = None
    lockstep: bool = True
    period: float = 0.002
    command_delay: float = 0.0
    sample_delay: float = 0.0
    fineness: int = 1
    ids: tuple[int, ...] = ()
    baud: int = 1_000_000
    return_delay: int = 0
    timestep: float | None = None
    integrator: str | None = None
    protection: Protection = field(default_factory=Protection)

    def __post_init__(self) -> None:
        number("period", self.period, low=1e-5, high=1.0)
        for name in ("command_delay", "sample_delay"):
            number(name, getattr(self, name), low=0, high=0.5)
        if self.baud not in BAUD_RATES.values():
            raise InputError("baud", self.baud, ", ".join(map(str, BAUD_RATES.values())))
        ids = self.ids or tuple(range(1, self.model.arm.n + 1))
        if len(set(ids)) != self.model.arm.n or not all(0 <= id <= 252 for id in ids):
            raise InputError("ids", ids, f"{self.model.arm.n} different numbers from 0 to 252")
        object.__setattr__(self, "ids", ids)

    def make_servos(self) -> list[Servo]:
        """The servos, as they are after power on."""
        rate = next(value for value, bps in BAUD_RATES.items() if bps == self.baud)
        return [
            Servo(
                id,
                self.motor,
                units=Units(self.fineness),
                baud=rate,
                return_delay=self.return_delay,
                protection=self.protection,
            )
            for id in self.ids
        ]

    def make_physics(self, servos: Sequence[Servo]) -> Physics:
        """What they move."""
        return Physics(
            self.model,
            servos,
            start=self.start,
            timestep=self.timestep,
            integrator=self.integrator,
            period=self.period,
            command_delay=self.command_delay,
            sample_delay=self.sample_delay,
        )


def _speed(fd: int) -> int:
    """Bits per second that the client has set on its end."""
    termios2 = fcntl.ioctl(fd, _TCGETS2, bytes(44))
    return int.from_bytes(termios2[40:44], "little")


class Server:
    """Serves one emulated rig on a pseudo-terminal until told to stop; `port` is the device to open.

    Args:
        options: What is emulated.
        control: A `multiprocessing.connection.Connection` on which commands come; None: none come.
        clock: Where wall-clock time comes from [s].
    """

    def __init__(
        self, options: TwinOptions, control: Any = None, *, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self.options, self.control, self._clock = options, control, clock
        self._lost = 0.0  # [s] of wall-clock time that this machine was too slow for
        self.servos = options.make_servos()
        self.physics = options.make_physics(self.servos)
        self.chain = Chain(self.servos, self._beat)
        self._master = self._slave = -1
        self.port = self._open()
        self._fresh()

    def _fresh(self) -> None:
        self.parser, self.faults = Parser(), Faults()
        self._late: list[bytes] = []
        self._taken = self._given = 0  # bytes from the client and to it
        self._heard = self._zero = self._clock()
        self.goal_writes: list[tuple[float, int]] = []  # simulated time, largest Goal Current after it
        self.torque_changes: list[tuple[float, int, bool]] = []  # simulated time, servo, on
        self._was_on = [False] * len(self.servos)

    def _open(self) -> str:
        self._master, self._slave = pty.openpty()
        tty.setraw(self._slave)  # bytes are bytes; and held open, so that a client may come and go
        return os.ttyname(self._slave)

    def _unplug(self) -> None:
        if self._master >= 0:
            os.close(self._master)
            os.close(self._slave)
            self._master = self._slave = -1

    # -- time ----------------------------------------------------------------------------------------------------

    @property
    def t(self) -> float:
        """Simulated time [s]."""
        return self.physics.t

    def advance(self, dt: float) -> None:
        """Let simulated time pass."""
        self.physics.advance_to(self.t + dt)
        self._happen()

    def _beat(self) -> None:
        goals = [abs(servo.get("goal_current")) if servo.torque_on else 0 for servo in self.servos]
        self.goal_writes.append((self.t, max(goals)))
        self._pass_period()

    def _pass_period(self) -> None:
        if self.options.lockstep:
            self.advance(self.options.period)

    @property
    def _behind(self) -> float:
        """How far simulated time is behind the wall clock [s]."""
        return 0.0 if self.options.lockstep else self._clock() - self._zero - self.t

    def _keep_up(self) -> None:
        """Go on towards the wall clock's time, no further at once than an answer may wait for."""
        if self.options.lockstep:
            return
        if self._behind > LAG:
            self._lose(self._behind - LAG)
        self.physics.advance_to(self.t + min(self._behind, AT_ONCE))
        self._happen()

    def _lose(self, seconds: float) -> None:
        self._zero += seconds
        if not self._lost:
            print("whiptool: this machine is too slow: the servos' time falls behind the clock", file=sys.stderr)
        self._lost += seconds

    def _happen(self) -> None:
        """Faults that are due, and changes of torque."""
        for fault in self.faults.due(self.t):
            self._inflict(fault)
        for i, servo in enumerate(self.servos):
            if servo.torque_on != self._was_on[i]:
                self._was_on[i] = servo.torque_on
                self.torque_changes.append((self.t, i, servo.torque_on))

    def _inflict(self, fault: Fault) -> None:
        servo = self.servos[fault.servo]
        if fault.kind == "unplug":
            self._unplug()
        elif fault.kind == "dead":
            servo.dead = True
        elif fault.kind == "hot":
            servo.heat = 70.0
        elif fault.kind == "stuck":
            servo.stuck = True
        elif fault.kind == "alert":
            servo.set("shutdown", 0)
            servo.set("hardware_error_status", 1 << 3)

    # -- bytes ---------------------------------------------------------------------------------------------------

    def serve(self) -> None:
        """Answer until the control connection says `quit` or goes away."""
        while True:
            wanted = [fd for fd in (self._master, self.control) if fd is not None and fd != -1]
            wait = 0.05 if self.options.lockstep else 0.0 if self._behind > AT_ONCE else 0.001
            ready = select.select(wanted, [], [], wait)[0]
            if self._master in ready:
                self._take()
            self._keep_up()
            if self.control is not None and self.control in ready:
                try:
                    sent, name, *args = self.control.recv()
                    self._hear(sent)
                    if not self._command(name, *args):
                        return
                except (EOFError, OSError):
                    return

    def _hear(self, sent: int) -> None:
        """Handle every byte that a client has sent so far, before what it wants on the control connection."""
        while self._taken < sent and self._master >= 0:
            self._take()

    def _take(self) -> None:
        data = os.read(self._master, 4096)
        self._taken += len(data)
        self._bytes(data)

    def _bytes(self, data: bytes) -> None:
        now = self._clock()
        if self.parser.pending and now - self._heard > SILENCE and not self.options.lockstep:
            self.parser.reset()
        self._heard = now
        speed = _speed(self._master)
        deaf = [BAUD_RATES[servo.get("baud_rate")] != speed for servo in self.servos]
        if all(deaf):
            data = bytes((byte * 167 + 59) & 0xFF for byte in data)  # what another baud rate makes of it
        for servo, is_deaf in zip(self.servos, deaf, strict=True):
            servo.deaf = is_deaf
        for packet in self.parser.feed(data):
            self._keep_up()
            self._packet(packet)

    def _packet(self, packet: Packet) -> None:
        self._happen()
        if self._master < 0:
            return
        lost = self.faults.strike(instruction=True)
        if lost is not None:
            if beats(packet) and any(servo.torque_on for servo in self.servos):  # time goes on, although nobody heard
                self._pass_period()
            return
        replies = self.chain.handle(packet)
        self._happen()  # a write may have turned torque on or off
        delayed = not self.options.lockstep and any(servo.get("return_delay_time") for servo in self.servos)
        if not (delayed or self.faults.line or self._late):
            if replies:  # one after the other on the line
                self._send(b"".join(replies))
            return
        for reply in replies:
            if delayed:
                time.sleep(max(servo.get("return_delay_time") for servo in self.servos) * 2e-6)
            self._reply(reply)

    def _reply(self, data: bytes) -> None:
        kind, rng = self.faults.strike(instruction=False) or ("", None)
        if kind == "late":
            self._late.append(data)
            return
        overdue, self._late = self._late, []
        for held in overdue:
            self._send(held)
        if kind == "drop":
            return
        if kind == "corrupt":
            assert rng is not None
            data = mangle(data, rng)
        if kind == "split":
            assert rng is not None
            cut = int(rng.integers(1, len(data)))
            self._send(data[:cut])
            time.sleep(0.001)
            data = data[cut:]
        self._send(data)
        if kind == "duplicate":
            self._send(data)

    def _send(self, data: bytes) -> None:
        if self._master >= 0:
            self._given += os.write(self._master, data)

    # -- control -------------------------------------------------------------------------------------------------

    def _command(self, name: str, *args: Any) -> bool:
        """Carry out a command of the control connection and answer it; False: stop."""
        answer: Any = None
        if name == "quit":
            self.control.send(None)
            return False
        if name == "add":
            self.faults.add(args[0])
            self._happen()
        elif name == "advance":
            self.advance(args[0])
        elif name == "state":
            answer = self.state()
        elif name == "given":
            answer = self._given
        elif name == "count":
            self._taken = self._given = 0
        elif name == "trajectory":
            answer = self.physics.trajectory()
        elif name == "reset":
            self._reset(args[0])
            answer = self.port
        self.control.send(answer)
        return True

    def _reset(self, start: Sequence[float] | None) -> None:
        """Everything as new, at time 0; an unplugged adapter is plugged in again."""
        self.servos[:] = self.chain.servos[:] = self.physics.servos[:] = self.options.make_servos()
        self.physics.reset(self.options.start if start is None else start)
        if self._master < 0:
            self.port = self._open()
        termios.tcflush(self._slave, termios.TCIOFLUSH)
        self._fresh()

    def state(self) -> dict[str, Any]:
        """What an outside observer knows: time, motors, registers, when a motor was last asked for current [s], and,
        after every write of Goal Current, the largest of a servo with torque on: (time [s], counts)."""
        physics = self.physics
        return {
            "t": self.t,
            "q": physics.data.qpos.copy(),
            "v": physics.data.qvel.copy(),
            "current": list(physics._currents),
            "torque": list(physics._torques),
            "torque_on": [servo.torque_on for servo in self.servos],
            "watchdog": [servo.get("bus_watchdog") for servo in self.servos],
            "goal_current": [servo.get("goal_current") for servo in self.servos],
            "hardware_error": [servo.get("hardware_error_status") for servo in self.servos],
            "operating_mode": [servo.get("operating_mode") for servo in self.servos],
            "last_driven": physics.last_driven,
            "goal_writes": list(self.goal_writes),
            "torque_changes": list(self.torque_changes),
            "skipped": self.parser.skipped,
            "broken": self.parser.broken,
        }
