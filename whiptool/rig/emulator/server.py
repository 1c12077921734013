"""Server of the emulated bus on a pseudo-terminal: it answers bytes and advances time."""

from __future__ import annotations

import fcntl
import os
import pty
import select
import sys
import termios
import time
import tty
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Any

from whiptool.rig.dynamixel.control_table import BAUD_RATES
from whiptool.rig.emulator.faults import Fault, Faults, mangle
from whiptool.rig.emulator.instructions import ServoChain, beats
from whiptool.rig.emulator.packets import Packet, Parser
from whiptool.rig.emulator.physics import Physics, TwinOptions

# Timing with the wall clock [s]
SILENCE = 0.02  # pause within a packet after which it is discarded (1.5 ms for the servo, more for a busy host)
AT_ONCE = 0.001  # largest simulated time that is integrated before the next answer
LAG = 0.1  # largest delay of simulated time behind real time; more is dropped
PAUSE = 0.001  # time to wait for bytes before the simulation continues
PAUSE_AT_REST = 0.05  # the same while nothing moves; registers are updated when bytes come
_TCGETS2 = 0x802C542A  # of Linux; tells any rate, where termios.tcgetattr knows the classical ones only


def _speed(fd: int) -> int:
    """Bits per second that the client has set on its end."""
    termios2 = fcntl.ioctl(fd, _TCGETS2, bytes(44))
    return int.from_bytes(termios2[40:44], "little")


class Server:
    """Serves one emulated rig on a pseudo-terminal until it is stopped; `port` is the device to open.

    Args:
        options: Emulated arm.
        control: A `multiprocessing.connection.Connection` for commands. None: there are no commands, and no trajectory
            is stored.
        clock: Source of the wall-clock time [s].
    """

    def __init__(
        self, options: TwinOptions, control: Any = None, *, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self.options, self.control, self._clock = options, control, clock
        self._lost = 0.0  # [s] of wall-clock time that this machine was too slow for
        self.physics = Physics(options, record=control is not None)
        self.servos = self.physics.servos
        self.chain = ServoChain(self.servos, self._beat)
        self._master = self._slave = -1
        self.port = self._open()
        self._fresh()

    def _fresh(self) -> None:
        self.parser, self.faults = Parser(), Faults()
        self._late: list[bytes] = []
        self._taken = self._given = 0  # bytes from the client and to it
        self._heard = self._zero = self._clock()
        kept = None if self.control is not None else 0
        self.goal_writes: deque[tuple[float, int]] = deque(maxlen=kept)  # simulated time, largest Goal Current after it
        self.torque_changes: deque[tuple[float, int, bool]] = deque(maxlen=kept)  # simulated time, servo, on
        self._was_on = [False] * len(self.servos)

    def _open(self) -> str:
        self._master, self._slave = pty.openpty()
        os.set_blocking(self._master, False)  # a client that does not read must not stop the servos
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
        """Time of the simulation [s]."""
        return self.physics.t

    def advance(self, dt: float) -> None:
        """Advance simulated time by dt [s]."""
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
        behind = self._behind
        if not self.physics.at_rest:
            self._lose(behind - LAG)
            behind = min(behind, AT_ONCE)
        self.physics.advance_to(self.t + behind)
        self._happen()

    def _lose(self, seconds: float) -> None:
        if seconds <= 0:
            return
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
        elif fault.kind in ("stuck", "flicker"):
            servo.stuck, servo.flickers = True, fault.kind == "flicker"
        elif fault.kind == "sag":
            self._sag(fault)
        elif fault.kind == "jump":
            servo.jump = fault.angle
            servo.show()
            if fault.lasting is not None:
                self.faults.add(replace(fault, at=fault.at + fault.lasting, angle=0.0, lasting=None))
        elif fault.kind == "reboot":
            servo.boot()
        elif fault.kind == "same_id":
            servo.set("id", self.servos[fault.servo - 1].get("id"))
        elif fault.kind == "alert":
            servo.set("shutdown", 0)
            servo.set("hardware_error_status", 1 << 3)

    def _sag(self, fault: Fault) -> None:
        """The supply sags, for as long as the fault lasts."""
        for servo in self.servos:
            servo.volts = fault.volts
            servo.show()
        if fault.lasting is not None:
            usual = self.options.motor.voltage
            self.faults.add(replace(fault, at=fault.at + fault.lasting, volts=usual, lasting=None))

    # -- bytes ---------------------------------------------------------------------------------------------------

    def serve(self) -> None:
        """Answer instructions until the control connection sends `quit` or is closed."""
        while self._round():
            pass

    def _round(self) -> bool:
        """Wait for bytes or a command, answer, go on in time; False: stop."""
        wanted = [fd for fd in (self._master, self.control) if fd is not None and fd != -1]
        begun = self._clock()
        ready = select.select(wanted, [], [], self._pause())[0]
        if self._master in ready:
            self._take()
        else:
            if begun - self._heard > SILENCE and not self.options.lockstep:
                self.parser.reset()  # silence is what was seen: a busy machine may keep us from bytes that came in time
            self._keep_up()
        if self.control is None or self.control not in ready:
            return True
        try:
            sent, name, *args = self.control.recv()
            self._hear(sent)
            return self._command(name, *args)
        except (EOFError, OSError):
            return False

    def _pause(self) -> float | None:
        """How long to wait for bytes [s]; None: until they come."""
        if self.options.lockstep:
            return None
        if self.physics.at_rest and not self.parser.pending:
            return PAUSE_AT_REST
        return 0.0 if self._behind > AT_ONCE else PAUSE

    def _hear(self, sent: int) -> None:
        """Handle every byte that a client has sent so far, before what it wants on the control connection."""
        while self._taken < sent and self._master >= 0:
            select.select([self._master], [], [])
            self._take()

    def _take(self) -> None:
        data = os.read(self._master, 4096)
        self._taken += len(data)
        self._bytes(data)

    def _bytes(self, data: bytes) -> None:
        self._heard = self._clock()
        speed = _speed(self._master)
        deaf = [BAUD_RATES[servo.get("baud_rate")] != speed for servo in self.servos]
        if all(deaf):
            data = bytes((byte * 167 + 59) & 0xFF for byte in data)  # what another baud rate makes of it
        for servo, is_deaf in zip(self.servos, deaf, strict=True):
            servo.deaf = is_deaf
        self._keep_up()  # what is read is of now
        for packet in self.parser.feed(data):
            self._packet(packet)

    def _packet(self, packet: Packet) -> None:
        self._happen()
        if self._master < 0:
            return
        lost = self.faults.strike(instruction=True)
        if lost is not None:
            if beats(packet) and any(servo.torque_on for servo in self.servos):  # time passes anyway
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
            with suppress(BlockingIOError):  # full, because no client reads: the rest is lost, as on any line
                self._given += os.write(self._master, data)

    # -- control -------------------------------------------------------------------------------------------------

    def _command(self, name: str, *args: Any) -> bool:
        """Carry out a command of the control connection and answer it; False: stop."""
        commands: dict[str, Callable[..., Any]] = {
            "quit": lambda: None,
            "add": self._add,
            "advance": self.advance,
            "state": self.state,
            "given": lambda: self._given,
            "count": self._count,
            "trajectory": self.physics.trajectory,
            "reset": self._reset,
        }
        self.control.send(commands[name](*args))
        return name != "quit"

    def _add(self, fault: Fault) -> None:
        self.faults.add(fault)
        self._happen()

    def _count(self) -> None:
        self._taken = self._given = 0

    def _reset(self, start: Sequence[float] | None) -> str:
        """Everything as new, at time 0; an unplugged adapter is plugged in again. Return the port."""
        self.servos[:] = self.options.make_servos()  # the chain has the same list
        self.physics.reset(self.options.start if start is None else start)
        if self._master < 0:
            self.port = self._open()
        termios.tcflush(self._slave, termios.TCIOFLUSH)
        self._fresh()
        return self.port

    def state(self) -> dict[str, Any]:
        """Return time, motors, registers, and the history of commands.

        The history is the time at which a motor was last commanded a current [s], and, after every write of Goal
        Current, the largest magnitude among the servos with torque on: (time [s], counts).
        """
        physics = self.physics
        return {
            "t": self.t,
            "q": physics.data.qpos.copy(),
            "v": physics.data.qvel.copy(),
            "current": list(physics.currents),
            "torque": list(physics.torques),
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
