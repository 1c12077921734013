"""The client ur_rtde, as it is installed, on the emulated robot."""

import socket
import struct
import time

import numpy as np
import pytest
from ur_robot import emulated

from whiptool.errors import InputError
from whiptool.rig.ur_emulator import UrEmulator, UrOptions
from whiptool.rig.ur_emulator.ur_controller import HOME

rtde_control = pytest.importorskip("rtde_control", reason="ur-rtde is not installed, or has no wheel here")
rtde_receive = pytest.importorskip("rtde_receive")
dashboard_client = pytest.importorskip("dashboard_client")


@pytest.fixture(scope="module")
def robot():
    with emulated(lockstep=False) as robot:
        yield robot


@pytest.fixture(scope="module")
def clients(robot):
    control = rtde_control.RTDEControlInterface(robot.host)
    receive = rtde_receive.RTDEReceiveInterface(robot.host, 500.0, ["actual_q", "actual_TCP_pose", "actual_current"])
    yield control, receive
    control.stopScript()
    control.disconnect()
    receive.disconnect()


def settled(ask):
    """The answer of a command of real time, which the client returns before the controller has given it."""
    ask()
    time.sleep(0.3)
    return ask()


def test_the_client_moves_the_arm_and_reads_where_it_is(clients):
    control, receive = clients
    goal = np.add(HOME, 0.1)
    assert control.moveJ(goal.tolist(), 1.05, 1.4)
    assert receive.getActualQ() == pytest.approx(goal, abs=1e-3)  # it may be a packet behind
    assert np.array(receive.getActualTCPPose())[:3] == pytest.approx(settled(control.getActualToolFlangePose)[:3])
    assert control.isSteady()


def test_the_client_sets_payload_and_tool(clients, robot):
    control, receive = clients
    assert control.setTargetPayload(0.4, [0, 0, 0.2], [1e-3, 1e-3, 1e-4, 0, 0, 0])
    mass, center, inertia = robot.state()["payload"]
    assert (mass, center, inertia) == (0.4, (0, 0, 0.2), (1e-3, 1e-3, 1e-4, 0, 0, 0))
    assert control.setTcp([0, 0, 0.65, 0, 0, 0])
    flange, tool = settled(control.getActualToolFlangePose), control.getForwardKinematics()
    assert np.linalg.norm(np.subtract(tool, flange)[:3]) == pytest.approx(0.65)
    torques = settled(control.getJointTorques)
    assert np.array(receive.getActualCurrent()) * 10 == pytest.approx(torques, abs=1e-6)
    assert control.setTcp([0, 0, 0, 0, 0, 0])


def test_servoj_and_servo_stop(clients, robot):
    control, receive = clients
    q = np.array(receive.getActualQ())
    for _ in range(30):
        period = control.initPeriod()
        assert control.servoJ((q := q + 0.001).tolist(), 0, 0, 0.002, 0.1, 300)
        control.waitPeriod(period)
    assert control.servoStop(10.0)
    state = robot.state()
    assert not state["v"].any()
    assert np.abs(state["q"] - q).max() < 0.05


@pytest.mark.parametrize(("look_ahead", "gain"), [(0.02, 300), (0.1, 50)])
def test_the_client_refuses_parameters_out_of_range(clients, look_ahead, gain):
    with pytest.raises(ValueError, match="not within"):
        clients[0].servoJ(list(HOME), 0, 0, 0.002, look_ahead, gain)


def test_a_protective_stop_is_seen_and_unlocked(clients, robot):
    control, _ = clients
    control.triggerProtectiveStop()
    state = robot.state()
    assert state["safety"] == "protective"
    dashboard = dashboard_client.DashboardClient(robot.host)
    dashboard.connect()
    assert dashboard.safetystatus().endswith("PROTECTIVE_STOP")
    with pytest.raises(RuntimeError, match=r"until 0.5s after"):
        dashboard.unlockProtectiveStop()
    time.sleep(0.6)
    dashboard.unlockProtectiveStop()
    dashboard.disconnect()
    assert robot.state()["safety"] == "normal"
    assert control.reuploadScript()


def test_strangers_are_answered_as_the_protocol_says(robot):
    with socket.create_connection((robot.host, 30004), timeout=60) as client:
        client.sendall(bytes.fromhex("0005560002") + bytes.fromhex("000376"))
        assert client.recv(4) == bytes.fromhex("00045601")  # version 2 is accepted
        assert struct.unpack(">HB4I", client.recv(19))[:3] == (19, ord("v"), 5)
        client.sendall(struct.pack(">HBd", 3 + 8 + 7, ord("O"), 125.0) + b"nothing")
        assert client.recv(100) == struct.pack(">HBB", 13, ord("O"), 0) + b"NOT_FOUND"
        client.sendall(struct.pack(">HBB", 4, ord("U"), 9))  # data of a recipe that was not set up
        assert client.recv(100) == b""
    assert "recipe 9" in robot.state()["log"][-1]
    with socket.create_connection((robot.host, 29999), timeout=60) as client:
        client.recv(100)
        for line in ("dance", "power on", "brake release"):
            client.sendall(line.encode() + b"\n")
            assert client.recv(100).decode() == f"could not understand: '{line}'\n"
        client.sendall(b"quit\n")
        assert client.recv(100) == b"Disconnected\n"
        assert client.recv(100) == b""
    assert robot.state()["log"][-1] == "a dashboard command is not emulated: brake release"


@pytest.mark.parametrize(
    ("frequency", "accepted"), [(500.0, 1), (1.0, 1), (500.1, 0), (0.0, 0), (-125.0, 0), (float("nan"), 0)]
)
def test_a_frequency_of_outputs_is_kept_or_refused(robot, frequency, accepted):
    """1,000 Hz were confirmed and sent as 500; 0 Hz ended the emulator."""
    with socket.create_connection((robot.host, 30004), timeout=60) as client:
        client.sendall(struct.pack(">HBd", 3 + 8 + 9, ord("O"), frequency) + b"timestamp")
        assert client.recv(100) == struct.pack(">HBB", 10, ord("O"), accepted) + b"DOUBLE"
        client.sendall(struct.pack(">HB", 3, ord("S")))
        assert client.recv(4) == struct.pack(">HBB", 4, ord("S"), accepted)
    assert accepted or "from 1 to 500" in robot.state()["log"][-1]


def test_outputs_come_at_the_floor_of_periods(robot):
    with socket.create_connection((robot.host, 30004), timeout=60) as client:
        client.sendall(struct.pack(">HBd", 3 + 8 + 9, ord("O"), 300.0) + b"timestamp" + struct.pack(">HB", 3, ord("S")))
        got = b""
        while len(got) < 10 + 4 + 3 * 12:
            got += client.recv(1000)
        times = [struct.unpack_from(">d", got, 14 + 12 * k + 4)[0] for k in range(3)]
    assert np.diff(times) == pytest.approx([0.002, 0.002])  # 500 // 300 periods


def test_a_set_up_without_a_frequency_drops_its_client_alone(robot):
    with socket.create_connection((robot.host, 30004), timeout=60) as client:
        client.sendall(struct.pack(">HB", 3, ord("O")))
        assert client.recv(100) == b""
    assert "without a frequency" in robot.state()["log"][-1]


def test_the_client_is_told_what_is_not_emulated(robot):
    with pytest.raises(RuntimeError, match=r"was not found by the controller: .*actual_robot_current"):
        rtde_receive.RTDEReceiveInterface(robot.host, 500.0, ["actual_q", "actual_robot_current"])
    assert robot.state()["log"][-1] == "refused output variables: actual_robot_current (NOT_FOUND)"


def claimed(client: socket.socket, names: bytes) -> bytes:
    """The answer to the set-up of inputs."""
    client.sendall(struct.pack(">HB", 3 + len(names), ord("I")) + names)
    return client.recv(100)[3:]


def test_an_input_has_one_client(robot):
    """A second client confirmed the same inputs, and both commanded the arm."""
    names = b"input_int_register_40,input_double_register_40"
    with socket.create_connection((robot.host, 30004), timeout=60) as one:
        assert claimed(one, names) == b"\x01INT32,DOUBLE"
        assert claimed(one, names) == b"\x02INT32,DOUBLE"  # the client itself may have it in several recipes
        with socket.create_connection((robot.host, 30004), timeout=60) as two:
            assert claimed(two, b"input_int_register_41," + names) == b"\x00INT32,IN_USE,IN_USE"
            assert claimed(two, b"input_int_register_41") == b"\x01INT32"  # what was refused claims nothing
            assert claimed(two, b"speed_slider_fraction") == b"\x00NOT_FOUND"
        assert "input_int_register_40 (IN_USE), input_double_register_40 (IN_USE)" in "".join(robot.state()["log"])
    with socket.create_connection((robot.host, 30004), timeout=60) as three:
        answer, tries = b"", 0
        while not answer.startswith(b"\x01") and (tries := tries + 1) < 100:  # until the first one's end is seen
            answer = claimed(three, names)
        assert answer == b"\x01INT32,DOUBLE"


def test_an_address_that_is_taken_is_refused(robot):
    with pytest.raises(InputError, match="port 29999 is free"):
        UrEmulator(UrOptions(robot.host))
