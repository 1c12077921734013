"""The emulated servos driven by clients that were not written here, each by its own interface."""

from __future__ import annotations

import importlib

import pytest
from foreign_clients import DYNAMIXEL_CONTROLLER, LEROBOT, fetched, importable
from ports import PatientPort
from processes import HANG

from whiptool.rig.emulator import Emulator, TwinOptions

QUARTER = 512  # counts


@pytest.fixture(scope="module")
def twin():
    with Emulator(TwinOptions(timestep=5e-4, integrator="implicitfast")) as emulator:
        yield emulator


@pytest.fixture
def fresh(twin):
    twin.reset()
    return twin


def test_the_makers_easy_sdk(fresh):
    easy = pytest.importorskip("dynamixel_easy_sdk")
    connector = easy.Connector(fresh.port, 1_000_000)
    connector._port_handler.closePort()
    connector._port_handler = PatientPort(fresh)
    motor, other = connector.createAllMotors()
    assert (motor.model_name, motor.getVelocityLimit(), motor.getPWMLimit()) == ("xm430_w350.model", 200, 885)
    motor.setMaxPositionLimit(3000)
    motor.setProfileConfiguration(easy.ProfileConfiguration.TIME_BASED)
    motor.enableTorque()
    with pytest.raises(easy.DxlRuntimeError, match="LIMIT"):
        motor.setGoalPosition(3500)
    motor.setGoalPosition(2048 + 100)
    fresh.advance(1.0)
    assert motor.getPresentPosition() == pytest.approx(2148, abs=25)  # it sags under the arm
    assert motor.getPresentPWM() > 0
    other.setOperatingMode(easy.OperatingMode.VELOCITY)
    other.enableTorque()
    with pytest.raises(easy.DxlRuntimeError, match="LIMIT"):
        other.setGoalVelocity(201)
    other.setGoalVelocity(-20)
    fresh.advance(0.5)
    assert other.getPresentVelocity() < -5
    other.reboot()
    assert other.isTorqueOn() == 0
    assert other.getOperatingMode() == easy.OperatingMode.VELOCITY
    connector._port_handler.closePort()


def test_rustypot(fresh):
    rustypot = pytest.importorskip("rustypot")
    client = rustypot.Xl430PyController(fresh.port, 1_000_000, HANG)
    try:
        assert client.scan([1, 2, 3]) == {1: 1020, 2: 1020}
        client.write_register(1, "max_position_limit", 3000)
        for id in (1, 2):
            client.write_register(id, "profile_velocity", 100)
            client.write_register(id, "profile_acceleration", 20)
            client.write_register(id, "torque_enable", 1)
        assert client.write_register_with_error(1, "goal_position", 3500) == 6
        client.sync_write_register([1, 2], "goal_position", [2148, 1948])
        assert client.read_register(1, "goal_position") == 2148
        assert client.sync_read_register([1, 2], "moving_status") == [0b100010] * 2  # a triangle, in progress
        fresh.advance(1.0)
        assert client.sync_read_register([1, 2], "moving") == [0, 0]
        assert client.sync_read_register([1, 2], "position_trajectory") == [2148, 1948]
        assert client.sync_read_register([1, 2], "present_position") == pytest.approx([2148, 1948], abs=25)
        assert client.reboot(1)
        assert client.read_register(1, "torque_enable") == 0
    finally:
        client.close()


def test_lerobots_bus(fresh):
    # of its utilities, which import torch, accelerate and datasets, the bus takes two for the console alone
    console = {"enter_pressed": None, "move_cursor_up": None}
    with importable(fetched(LEROBOT), lerobot__utils__utils=console):
        motors = importlib.import_module("lerobot.motors")
        bus = importlib.import_module("lerobot.motors.dynamixel").DynamixelMotorsBus(
            fresh.port,
            {
                "shoulder": motors.Motor(1, "xm430-w350", motors.MotorNormMode.DEGREES),
                "elbow": motors.Motor(2, "xm430-w350", motors.MotorNormMode.DEGREES),
            },
        )
    bus.port_handler = bus.sync_reader.port = bus.sync_writer.port = PatientPort(fresh)
    bus._connect()
    bus.configure_motors()
    assert bus.sync_read("Present_Position", normalize=False) == {"shoulder": 2048, "elbow": 2048}
    bus.reset_calibration()
    assert bus.set_half_turn_homings() == {"shoulder": -1, "elbow": -1}
    found = bus.read_calibration()
    assert (found["shoulder"].homing_offset, found["shoulder"].range_max) == (-1, 4095)
    for calibration in found.values():
        calibration.range_min, calibration.range_max = 1000, 3000
    bus.write_calibration(found)
    assert bus.is_calibrated
    bus.enable_torque()
    bus.write("Profile_Velocity", "shoulder", 60)
    bus.sync_write("Goal_Position", {"shoulder": 10.0, "elbow": -10.0})  # [deg] from the middle of the range
    fresh.advance(1.0)
    goal = bus.sync_read("Goal_Position", normalize=False)
    assert goal == {"shoulder": pytest.approx(2000 + 114, abs=1), "elbow": pytest.approx(2000 - 114, abs=1)}
    assert bus.read("Present_Position", "elbow") == pytest.approx(-10, abs=2.5)
    with pytest.raises(RuntimeError, match="limit"):
        bus.write("Goal_Position", "shoulder", 3500, normalize=False)
    with bus.torque_disabled():
        assert bus.sync_read("Torque_Enable") == {"shoulder": 0, "elbow": 0}
    bus.disconnect()
    assert fresh.state()["torque_on"] == [False, False]


@pytest.mark.slow
def test_dynamixel_controller(fresh, capsys):
    resources = {"resource_filename": lambda module, name: f"{folder}/dynio/{name}"}
    folder = fetched(DYNAMIXEL_CONTROLLER, without="dynamixel_sdk")
    with importable(folder, pkg_resources=resources):
        dynio = importlib.import_module("dynio.dynamixel_controller")
        io = dynio.DynamixelIO(fresh.port, 1_000_000)
        io.port_handler.closePort()
        io.port_handler = PatientPort(fresh)
        motor = io.new_mx64(1, protocol=2)  # Protocol 2.0 has the same control table in both series
    motor.set_position_mode(min_limit=1000, max_limit=3000)
    motor.set_velocity(80)
    motor.torque_enable()
    assert motor.read_control_table("Profile_Velocity") == 80
    motor.set_angle(200)
    fresh.advance(1.0)
    assert motor.get_angle() == pytest.approx(200, abs=3)
    assert capsys.readouterr().out == ""
    motor.set_position(3500)
    assert "limit" in capsys.readouterr().out
    motor.torque_disable()
    motor.set_velocity_mode()
    motor.torque_enable()
    motor.set_velocity(30)
    fresh.advance(0.5)
    assert motor.read_control_table("Present_Velocity") > 5
    motor.torque_disable()
    io.port_handler.closePort()


def test_protocol_1_gets_no_answer(fresh):
    sdk = pytest.importorskip("dynamixel_sdk")
    port = PatientPort(fresh)
    assert sdk.Protocol1PacketHandler().ping(port, 1)[1] == sdk.COMM_RX_TIMEOUT
    assert sdk.Protocol2PacketHandler().ping(port, 1)[1] == 0
    port.closePort()
