"""The emulated servos with the wall clock, on a machine that has other things to do."""

from __future__ import annotations

import dataclasses
import fcntl
import os
import sys
import termios
import time
import tty

import numpy as np
import pytest
from ports import PatientPort, RawLine, sdk
from servos import GOLDEN, h, put

from whiptool.rig.dynamixel.control_table import register
from whiptool.rig.emulator import Emulator, Fault, TwinOptions
from whiptool.rig.emulator.packets import Packet, encode, status
from whiptool.rig.emulator.server import AT_ONCE, LAG, SILENCE, Server

WALL = TwinOptions(lockstep=False, timestep=5e-4, integrator="implicitfast")
SWINGING = dataclasses.replace(WALL, start=(0.5, 0.0))
PING = encode(Packet(1, 1))
ANSWER = status(1, 0, (1020).to_bytes(2, "little") + bytes([45]))


class Clock:
    """Time that passes when it is told to [s]."""

    def __init__(self) -> None:
        self.now = 5.0

    def __call__(self) -> float:
        return self.now


def waiting(server: Server) -> int:
    """Bytes that a client has sent and the server has not read."""
    return int.from_bytes(fcntl.ioctl(server._master, termios.FIONREAD, bytes(4)), sys.byteorder)


class Client:
    """The other end of a server's line, in the same thread; it waits until bytes are through, and for no others."""

    def __init__(self, server: Server) -> None:
        self.server, self.received = server, 0
        self.fd = os.open(server.port, os.O_RDWR | os.O_NOCTTY)
        tty.setraw(self.fd)
        attributes = termios.tcgetattr(self.fd)
        attributes[4] = attributes[5] = termios.B1000000
        termios.tcsetattr(self.fd, termios.TCSANOW, attributes)

    def write(self, data: bytes) -> None:
        assert os.write(self.fd, data) == len(data)
        while waiting(self.server) < len(data):
            time.sleep(1e-4)

    def read(self) -> bytes:
        """All that the server has sent."""
        data = b""
        while self.received < self.server._given:
            piece = os.read(self.fd, 4096)
            self.received += len(piece)
            data += piece
        return data


@pytest.fixture
def clock():
    return Clock()


@pytest.fixture
def server(clock):
    return Server(WALL, clock=clock)


@pytest.fixture
def client(server):
    client = Client(server)
    yield client
    os.close(client.fd)


def write_register(server: Server, name: str, value: int) -> None:
    r = register(name)
    for servo in server.servos:
        assert servo.write(r.address, value.to_bytes(r.size, "little")) == 0


# -- time ------------------------------------------------------------------------------------------------------------


def test_it_keeps_time_in_small_steps(clock):
    server = Server(SWINGING, clock=clock)
    clock.now += 0.05
    times = [server.t]
    for _ in range(60):
        server._keep_up()
        times.append(server.t)
    assert times[0] == 0
    assert times[-1] == pytest.approx(0.05)
    assert np.diff(times).max() <= AT_ONCE + 1e-9  # what comes meanwhile is answered first


def test_a_round_with_many_instructions_goes_on_in_time_once(server, client, clock):
    write_register(server, "torque_enable", 1)
    clock.now += 0.05
    client.write(PING * 50)
    server._round()
    assert client.read() == ANSWER * 50
    assert server.t == pytest.approx(AT_ONCE)


def test_time_that_the_machine_is_too_slow_for_is_lost_and_said_once(clock, capsys):
    server = Server(SWINGING, clock=clock)
    for _ in range(3):
        clock.now += 10.0
        for _ in range(200):
            server._keep_up()
    assert server.t == pytest.approx(3 * LAG)
    assert capsys.readouterr().err.count("too slow") == 1


def test_it_goes_on_by_itself():
    with Emulator(WALL) as emulator:
        before = emulator.state()["t"]
        while emulator.state()["t"] < before + 0.05:
            time.sleep(0.005)


# -- at rest ---------------------------------------------------------------------------------------------------------


def test_time_passes_at_rest_without_integration(server, client, clock, capsys):
    server.physics._step_until = None  # whoever integrates, fails
    clock.now += 100.0
    client.write(encode(Packet(1, 2, bytes([120, 0, 2, 0]))))  # Realtime Tick
    server._round()
    assert client.read() == status(1, 0, (100_000 % 32_768).to_bytes(2, "little"))
    assert server.t == pytest.approx(100.0)
    assert "too slow" not in capsys.readouterr().err
    assert server._pause() > 0.01


def test_an_arm_that_its_motors_hold_falls_when_they_let_go(clock):
    physics = Server(SWINGING, clock=clock).physics
    for servo in physics.servos:
        servo.set("torque_enable", 1)
    put(physics.servos[0], "goal_position", 3000)
    physics.advance_to(0.01)
    assert physics.currents[0] != 0
    physics.data.qvel[:] = physics.data.qacc[:] = 0  # as if it had been held for long
    for servo in physics.servos:
        servo.set("torque_enable", 0)
    assert not physics.at_rest
    physics.advance_to(0.3)
    assert physics.data.qpos[0] < 0.4


def test_an_arm_is_at_rest_only_without_speed_and_acceleration(server):
    physics = server.physics
    assert physics.at_rest
    physics.data.qvel[-1] = 1e-3
    assert not physics.at_rest
    physics.data.qvel[-1] = 0
    physics.data.qacc[0] = 1e-2
    assert not physics.at_rest


def test_faults_and_temperature_go_on_at_rest(server, clock):
    server.faults.add(Fault("hot", at=7.0))
    server.servos[1].temperature = 50.0
    clock.now += 6.9
    server._keep_up()
    assert server.servos[1].temperature < 50.0
    assert server.servos[0].get("hardware_error_status") == 0
    clock.now += 0.2
    server._keep_up()
    server._keep_up()
    clock.now += 0.1
    server._keep_up()
    assert server.servos[0].get("hardware_error_status") == 1 << 2
    clock.now += 3600.0  # the machine slept
    server._keep_up()
    assert server.servos[1].temperature == 30.0


# -- bytes -----------------------------------------------------------------------------------------------------------


def test_a_packet_that_came_in_time_is_answered_however_late_it_is_seen(server, client, clock):
    client.write(PING[:4])
    server._round()
    clock.now += 5 * SILENCE  # the machine did something else
    client.write(PING[4:])
    server._round()
    assert client.read() == ANSWER


def test_a_packet_that_stops_is_given_up(server, client, clock):
    client.write(PING[:4])
    server._round()
    clock.now += 5 * SILENCE
    server._round()  # nothing there
    assert server.parser.pending == 0
    client.write(PING[4:])
    server._round()
    assert client.read() == b""


def test_a_client_that_does_not_read_stops_nothing(server, client):
    for _ in range(150):
        client.write(PING * 40)
        server._round()
    assert 0 < len(client.read()) < 150 * 40 * len(ANSWER)  # a line holds only so much
    client.write(PING)
    server._round()
    assert client.read() == ANSWER


def test_noise_that_nobody_reads_the_replies_to_leaves_it_answering(server, client):
    rng = np.random.default_rng(0)
    for _ in range(500):
        data = rng.integers(0, 256, int(rng.integers(1, 200)), dtype=np.uint8).tobytes()
        if rng.integers(2):
            instruction = int(rng.integers(256))  # not one that changes how a servo talks
            data = PING if instruction in (3, 4, 6, 8, 0x83, 0x93) else encode(Packet(254, instruction, data[:40]))
        client.write(data)
        server._round()
    client.read()
    client.write(PING)
    server._round()
    assert client.read() == ANSWER


def test_alone_it_keeps_no_record(server, clock):
    write_register(server, "torque_enable", 1)
    for _ in range(50):
        clock.now += AT_ONCE
        server._keep_up()
        server._beat()
    state = server.state()
    assert [len(x) for x in (state["goal_writes"], state["torque_changes"], server.physics._rows)] == [0, 0, 0]


def test_fuzzed_line_neither_hangs_nor_dies(twin):
    twin.reset()
    rng = np.random.default_rng(0)
    with RawLine(twin) as line:
        for _ in range(150):
            kind = rng.integers(3)
            noise = rng.integers(0, 256, int(rng.integers(1, 200)), dtype=np.uint8).tobytes()
            if kind == 1:  # good packets with any instruction and parameters; not those that change how it talks
                packet = Packet(int(rng.choice([1, 2, 254, 9])), int(rng.integers(256)), noise[:40])
                noise = encode(packet) if packet.instruction not in (3, 4, 6, 0x83, 0x93) else b"\xff\xff\xfd"
            elif kind == 2:
                good = bytearray(h(list(GOLDEN.values())[int(rng.integers(len(GOLDEN)))]))
                good[int(rng.integers(len(good)))] ^= 1 << int(rng.integers(8))
                noise = bytes(good)
            line.write(noise)
        line.answer()
        line.write(h(GOLDEN["ping"]))
        assert h("FF FF FD 00 01 07 00 55") in line.answer()


def test_in_lockstep_a_packet_may_come_in_pieces_at_any_pace(twin):
    twin.reset()
    ping = h(GOLDEN["ping"])
    with RawLine(twin) as line:
        for cut in (1, 5, len(ping) - 1):
            line.write(ping[:cut])
            assert line.answer() == b""
            time.sleep(0.05)  # longer than a servo would wait
            for _ in range(2):
                twin.state()  # it looks, and nothing has come
            line.write(ping[cut:])
            assert len(line.answer()) == 14


def test_lockstep_repeats_exactly(twin):
    def play() -> np.ndarray:
        twin.reset((0.2, 0.3))
        port, handler = PatientPort(twin), sdk.Protocol2PacketHandler()
        for i in (1, 2):
            handler.write1ByteTxRx(port, i, 11, 0)
            handler.write2ByteTxRx(port, i, 102, 0)
            handler.write1ByteTxRx(port, i, 64, 1)
        write = sdk.GroupSyncWrite(port, handler, 102, 2)
        for i in (1, 2):
            write.addParam(i, [0, 0])
        for k in range(60):
            for i in (1, 2):
                write.changeParam(i, list((200 - 5 * k * i).to_bytes(2, "little", signed=True)))
            write.txPacket()
        path = twin.trajectory()
        port.closePort()
        return path["q"]

    first, second = play(), play()
    # a sample every millisecond of 61 periods of 2 ms: the second servo's first goal came with the first one on
    assert len(first) == 61 * 2 + 1
    np.testing.assert_array_equal(first, second)
    assert np.abs(first[-1] - first[0]).max() > 0.01


def test_time_stands_still_without_writes_in_lockstep(twin):
    twin.reset()
    time.sleep(0.05)
    assert twin.state()["t"] == 0
    twin.advance(0.25)
    assert twin.state()["t"] == pytest.approx(0.25)
