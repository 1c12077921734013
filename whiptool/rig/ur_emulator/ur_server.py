"""Ports of the emulated UR: dashboard (29999), programs (30001 to 30003) and RTDE (30004), and its clock."""

from __future__ import annotations

import os
import selectors
import socket
import struct
import time
from collections.abc import Callable
from contextlib import suppress
from multiprocessing.connection import Connection
from typing import Any

import numpy as np

from whiptool.errors import InputError
from whiptool.rig import child_process
from whiptool.rig.ur_emulator import rtde_packets as rtde
from whiptool.rig.ur_emulator.control_script import SERVOJ
from whiptool.rig.ur_emulator.dashboard import GREETING, answer
from whiptool.rig.ur_emulator.ur_controller import OF_THE_NETWORK, UrController, UrFault, UrOptions
from whiptool.rig.ur_emulator.ur_joints import PERIOD

DASHBOARD, PROGRAMS, RTDE = 29999, (30001, 30002, 30003), 30004
VERSION = (5, 16, 0, 1)  # of the controller's software
BEHIND = 0.1  # [s] by which the robot's time may lag behind real time; more is dropped
QUIET = 0.1  # [s] without a further command after which lock-step takes the client to have answered every state
PATIENCE = 10.0  # [s] of real time that lock-step waits for a command; then time goes on, as on a real robot


class _Client:
    """A connection, what it sent and did not end yet, and, of RTDE, its recipes."""

    def __init__(self, connection: socket.socket, port: int) -> None:
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.connection, self.port, self.buffer = connection, port, bytearray()
        self.inputs: list[rtde.Recipe] = []
        self.output: rtde.Recipe | None = None
        self.every, self.started = 1, False

    def send(self, data: bytes) -> None:
        """Send without waiting; a client that does not read loses packets."""
        with suppress(BlockingIOError, OSError):
            self.connection.send(data)


class UrServer:
    """The emulated robot and its connections.

    Args:
        options: Options of the robot.
        control: Connection of the process that started it; None: none did.

    Raises:
        InputError: The ports are taken on this address, or it is not one of this machine.
    """

    def __init__(self, options: UrOptions, control: Connection | None = None) -> None:
        self.robot, self._control = UrController(options), control
        self._select = selectors.DefaultSelector()
        self._clients: list[_Client] = []
        self._listening: list[socket.socket] = []
        self._network: dict[str, float] = {}  # until when a fault of it lasts
        self._cycles = 0
        self._told = self._late = False  # servoj was commanded since the last period; a command is overdue
        self._told_at = 0.0  # [s] of real time
        self._following = False  # the client commands servoj, from its first command on
        self._paired = False  # in lock-step each state is answered by one command
        for port in (DASHBOARD, *PROGRAMS, RTDE):
            self._listen(options.host, port)
        if control is not None:
            self._select.register(control, selectors.EVENT_READ, self._asked)

    def _listen(self, host: str, port: int) -> None:
        try:
            server = socket.create_server((host, port), reuse_port=False)
        except OSError as error:
            self.close()
            fix = "another emulated robot may serve there: take another address, such as --host 127.0.0.3"
            raise InputError(
                "host", host, f"an address on which port {port} is free ({os.strerror(error.errno or 0)})", fix
            ) from None
        server.setblocking(False)
        self._listening.append(server)
        self._select.register(server, selectors.EVENT_READ, lambda: self._accept(server, port))

    def _accept(self, server: socket.socket, port: int) -> None:
        with suppress(OSError):
            connection, _ = server.accept()
            connection.setblocking(False)
            client = _Client(connection, port)
            self._clients.append(client)
            self._select.register(connection, selectors.EVENT_READ, lambda: self._read(client))
            if port == DASHBOARD:
                client.send(GREETING)

    def _drop(self, client: _Client, *, hard: bool = False) -> None:
        if client not in self._clients:  # dropped by an earlier event
            return
        self._select.unregister(client.connection)
        self._clients.remove(client)
        if hard:  # the peer sees a reset
            client.connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        client.connection.close()

    def _read(self, client: _Client) -> None:
        try:
            data = client.connection.recv(1 << 16)
        except BlockingIOError:
            return
        except OSError:  # also of one that was dropped by an earlier event
            data = b""
        if not data:
            self._drop(client)
            return
        if self._lost("unheard"):
            return
        client.buffer += data
        try:
            take = {DASHBOARD: self._take_lines, RTDE: self._take_packets}.get(client.port, self._take_program)
            take(client)
        except ValueError as error:
            self.robot.say(f"a client was dropped: {error}")
            self._drop(client)

    def _take_lines(self, client: _Client) -> None:
        while b"\n" in client.buffer:
            asked, _, rest = client.buffer.partition(b"\n")
            client.buffer, line = bytearray(rest), asked.decode("utf-8", "replace").strip()
            client.send(answer(line, self.robot))
            if line.lower() == "quit":
                self._drop(client)
                return

    def _take_program(self, client: _Client) -> None:
        """A program ends with `end` at the beginning of a line."""
        while b"\nend\n" in client.buffer:
            text, _, rest = client.buffer.partition(b"\nend\n")
            client.buffer = bytearray(rest)
            self.robot.receive(text.decode("utf-8", "replace"))

    def _take_packets(self, client: _Client) -> None:
        for kind, payload in rtde.packets(client.buffer):
            if kind == rtde.DATA:
                self._take_data(client, payload)
            else:
                client.send(rtde.packet(kind, self._answer_to(client, kind, payload)))

    def _answer_to(self, client: _Client, kind: int, payload: bytes) -> bytes:
        if kind == rtde.VERSION:
            return bytes([payload == b"\x00\x02"])
        if kind == rtde.CONTROLLER:
            return struct.pack(">4I", *VERSION)
        if kind == rtde.INPUTS:
            others = {name for other in self._clients if other is not client for r in other.inputs for name in r.names}
            recipe = self._heard(rtde.Recipe.of(payload, rtde.INPUT_KINDS, others), "input")
            client.inputs += [] if recipe.refused else [recipe]
            return bytes([0 if recipe.refused else len(client.inputs)]) + ",".join(recipe.kinds).encode()
        if kind == rtde.OUTPUTS:
            return self._set_up_outputs(client, payload)
        if kind in (rtde.START, rtde.PAUSE):
            client.started = kind == rtde.START and client.output is not None and not client.output.refused
            return bytes([client.started or kind == rtde.PAUSE])
        raise ValueError(f"an RTDE packet of kind {kind}")

    def _set_up_outputs(self, client: _Client, payload: bytes) -> bytes:
        """Send every period of which the frequency divides 500 Hz, rounded down; refuse it below 1 and above 500 Hz."""
        if len(payload) < 8:
            raise ValueError("an RTDE set-up of outputs without a frequency")
        (rate,), recipe = struct.unpack(">d", payload[:8]), rtde.Recipe.of(payload[8:], rtde.OUTPUT_KINDS)
        possible = 1 <= rate <= 1 / PERIOD
        if not possible:
            self.robot.say(f"refused an output frequency of {rate:g} Hz: it is from 1 to {1 / PERIOD:g}")
        client.output = self._heard(recipe, "output") if possible else None
        client.every = int(1 / PERIOD // rate) if possible else 1
        return bytes([possible and not recipe.refused]) + ",".join(recipe.kinds).encode()

    def _heard(self, recipe: rtde.Recipe, direction: str) -> rtde.Recipe:
        """Say which variables of a recipe are refused."""
        if recipe.refused:
            self.robot.say(f"refused {direction} variables: " + ", ".join(recipe.refused))
        return recipe

    def _take_data(self, client: _Client, payload: bytes) -> None:
        number = payload[0] if payload else 0
        if not 1 <= number <= len(client.inputs):
            raise ValueError(f"data of recipe {number}, which was not set up")
        values = client.inputs[number - 1].unpack(payload[1:])
        self.robot.receive(values)
        told = SERVOJ in (values.get("input_int_register_0"), values.get("input_int_register_24"))
        self._following = told
        if told:
            self._told, self._told_at = True, time.perf_counter()
        self._late = not told  # other commands are not given every period

    def _lost(self, kind: str) -> bool:
        """Whether what passes the network in a direction is lost now."""
        return any(self.robot.t < self._network.get(name, 0.0) for name in (kind, "silence"))

    def cycle(self) -> None:
        """Advance by one period, and report it."""
        for fault in self.robot.due():
            self._begin(fault)
        self.robot.cycle()
        self._told, self._cycles = False, self._cycles + 1
        if self._lost("unseen"):
            return
        values = self.robot.outputs()
        for client in self._clients:
            if client.started and client.output is not None and self._cycles % client.every == 0:
                client.send(rtde.packet(rtde.DATA, b"\x01" + client.output.pack(values)))

    def _begin(self, fault: UrFault) -> None:
        self.robot.say(f"{self.robot.t:.3f} s: fault {fault.kind}")
        if fault.kind in OF_THE_NETWORK:
            self._network[fault.kind] = self.robot.t + fault.lasting
        elif fault.kind == "cut":
            self._late = True
            for client in list(self._clients):
                self._drop(client, hard=True)
        else:
            act: dict[str, Callable[[], None]] = {
                "protective": lambda: self.robot.protect("injected"),
                "emergency": self.robot.press,
                "halt": lambda: self.robot.end_program("stopped at the pendant"),
            }
            act[fault.kind]()

    def serve(self) -> None:
        """Serve until the process that started the robot ends it."""
        due, self._serving = time.perf_counter() + PERIOD, True
        while self._serving:
            self._paired &= self._in_step
            waits = self._waits
            # states that were sent before time waited may still be on their way: they are answered before it goes on
            until = self._told_at + QUIET if self._answered else due + PATIENCE * waits
            for key, _ in self._select.select(max(0.0, until - time.perf_counter())):
                key.data()
            now = time.perf_counter()
            if self._answered:
                if self._paired or now >= self._told_at + QUIET:
                    self._paired, self._late, due = True, False, now + PERIOD
                    self.cycle()
            elif now >= until:
                self._late, due = self._late or waits, max(due + PERIOD, now - BEHIND)
                self.cycle()
        self.close()

    @property
    def _answered(self) -> bool:
        """Whether, in lock-step, the present state was answered by a command."""
        return self._told and self._in_step

    @property
    def _waits(self) -> bool:
        """Whether time waits for a command: in lock-step, unless the client cannot answer or is long overdue."""
        answers = not (self._late or self._lost("unheard") or self._lost("unseen"))
        return self._in_step and answers

    @property
    def _in_step(self) -> bool:
        """Whether lock-step applies: the client commands servoj, and the robot's program runs undisturbed."""
        robot = self.robot
        undisturbed = robot.program is not None and robot.safety == "normal"
        return robot.options.lockstep and self._following and undisturbed

    def _asked(self) -> None:
        assert self._control is not None
        try:
            name, *given = self._control.recv()
        except (EOFError, OSError):
            name, given = "quit", []
        reply: Any = None
        if name == "quit":
            self._serving = False
        elif name == "add":
            self.robot.add(given[0])
        elif name == "history":
            reply = np.array(self.robot.history).reshape(-1, 14)
        elif name == "state":
            robot = self.robot
            reply = {"t": robot.t, "safety": robot.safety, "program": robot.program is not None, "log": robot.log,
                     "payload": robot.payload, "q": robot.joints.q, "v": robot.joints.v}  # fmt: skip
        with suppress(OSError):
            self._control.send(reply)

    def close(self) -> None:
        """Close all connections."""
        for client in list(self._clients):
            self._drop(client)
        for server in self._listening:
            with suppress(KeyError):
                self._select.unregister(server)
            server.close()
        self._listening = []


def serve_child(fd: int) -> None:
    """Main function of the emulator's process; see `whiptool.rig.child_process.serve_child`."""

    def make(options: UrOptions, control: Connection) -> tuple[None, Callable[[], None]]:
        return None, UrServer(options, control).serve

    child_process.serve_child(fd, make)
