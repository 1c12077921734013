"""The command that lists the servos on a bus."""

from __future__ import annotations

import fcntl
import sys
import termios
import threading
import time
from typing import get_args

import pytest
from ports import sdk
from processes import HANG

from whiptool.commands import servos as command
from whiptool.rig.dynamixel.control_table import BAUD_RATES
from whiptool.rig.emulator import Emulator, TwinOptions
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


@pytest.fixture(scope="module")
def twin():
    """Servos whose time does not pass: what is asked of them is answered at once."""
    with Emulator(TwinOptions(timestep=5e-4, integrator="implicitfast")) as emulator:
        yield emulator


def test_it_lists_where_the_servos_stand(twin, capsys):
    twin.reset((0.5, -0.25))
    assert command.main(["--port", twin.port]) == 0
    first, second = capsys.readouterr().out.splitlines()
    assert first.startswith(
        "servo 1: model 1020, firmware 45, 12.0 V, 30 deg C, position 2374 (+28.7 deg from 2048), no error"
    )
    assert "position 1885 (-14.3 deg" in second  # 0.25 rad are 163 counts


def test_an_id_that_another_servo_has_is_not_given_again(twin, monkeypatch, capsys):
    twin.reset()
    monkeypatch.setattr(command, "PATIENCE", 0.2)
    assert command.main(["--port", twin.port, "--ids", "1", "--set-id", "2"]) == 2
    assert "--set-id: got 2; allowed: an id that no other servo on the line has" in capsys.readouterr().err
    assert command.main(["--port", twin.port, "--ids", "1", "2"]) == 0  # both are there as before
    assert command.main(["--port", twin.port, "--ids", "1", "--set-id", "7", "--set-baud", "57600"]) == 0
    assert command.main(["--port", twin.port, "--baud", "57600", "--ids", "7"]) == 0
    assert "servo 7: model 1020" in capsys.readouterr().out


def test_a_servo_that_does_not_answer_is_named(twin, monkeypatch, capsys):
    twin.reset()
    monkeypatch.setattr(command, "PATIENCE", 0.05)
    assert command.main(["--port", twin.port, "--reboot", "9"]) == 1
    said = capsys.readouterr().err
    assert "servo 9 does not answer when asked to carry out instruction 8: check its power, cable and id" in said
    assert "status packet" not in said


def test_baud_rates_are_those_of_the_control_table():
    assert sorted(get_args(command.Baud)) == sorted(BAUD_RATES.values())
