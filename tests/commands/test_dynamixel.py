"""The command that lists the servos on a bus."""

from __future__ import annotations

import fcntl
import sys
import termios
import threading
import time

from ports import sdk
from processes import HANG

from whiptool.commands import dynamixel as command
from whiptool.rig.emulator import TwinOptions
from whiptool.rig.emulator.packets import Packet, encode
from whiptool.rig.emulator.server import Server

WALL = TwinOptions(lockstep=False, timestep=5e-4, integrator="implicitfast")
PING = encode(Packet(1, 1))


def waiting(server: Server) -> int:
    """Bytes that a client has sent and the server has not read."""
    return int.from_bytes(fcntl.ioctl(server._master, termios.FIONREAD, bytes(4)), sys.byteorder)


def test_the_command_finds_servos_that_answer_late(monkeypatch, capsys):
    """A ping of the SDK's is given up after 34 ms; the command's waits for `PATIENCE`."""
    port = sdk.PortHandler("")
    port.tx_time_per_byte = 0.01
    port.setPacketTimeout(14)
    assert 20 * port.packet_timeout < command.PATIENCE * 1e3
    monkeypatch.setattr(command, "PATIENCE", HANG)
    server, done = Server(WALL), threading.Event()

    def serve_late() -> None:
        while waiting(server) < len(PING):
            time.sleep(1e-3)
        time.sleep(0.1)
        while not done.is_set():
            server._round()

    thread = threading.Thread(target=serve_late)
    thread.start()
    try:
        assert command.main(["--port", server.port]) == 0
    finally:
        done.set()
        thread.join()
    assert capsys.readouterr().out.count("model 1020") == 2
