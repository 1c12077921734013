import numpy as np
import pytest

from whiptool.errors import InputError
from whiptool.rig.robots.robot import IN_LOCKSTEP
from whiptool.rig.ur_emulator.dashboard import answer
from whiptool.rig.ur_emulator.ur_controller import HOME, PAUSED, PLAYING, STOPPED, UrController, UrFault, UrOptions
from whiptool.rig.ur_emulator.ur_joints import PERIOD

PROGRAM = "def rtde_control():\n global reg_offset_int = # int register offset\n0"


def registers(command, *numbers):
    """Input registers with a command of the client's program and its numbers."""
    return {"input_int_register_0": command} | {f"input_double_register_{i}": x for i, x in enumerate(numbers)}


def servoj(q, lookahead=0.1, gain=300.0):
    return registers(11, *q, 0, 0, PERIOD, lookahead, gain)


def run(robot, seconds):
    for _ in range(round(seconds / PERIOD)):
        robot.cycle()


@pytest.fixture
def robot():
    robot = UrController(UrOptions())
    robot.play(PROGRAM)
    robot.cycle()
    return robot


def test_only_a_controller_whose_time_waits_says_so():
    """By its serial number, which the client has to read as a number; the driver is patient with it."""
    serials = [answer("get serial number", UrController(UrOptions(lockstep=x))) for x in (True, False)]
    assert [serial.strip().decode() == IN_LOCKSTEP for serial in serials] == [True, False]
    assert all(serial.strip().isdigit() for serial in serials)


def test_a_program_that_is_not_the_clients_is_refused():
    robot = UrController(UrOptions())
    robot.play("def other():\n movej([0, 0, 0, 0, 0, 0])")
    assert robot.outputs()["runtime_state"] == STOPPED
    assert "not emulated" in robot.log[-1]


@pytest.mark.parametrize("latency", [1, 2, 5])
def test_a_command_moves_the_arm_after_the_latency(latency):
    robot = UrController(UrOptions(latency=latency))
    robot.play(PROGRAM)
    robot.cycle()
    robot.receive(servoj(np.add(HOME, 0.1)))
    for k in range(latency):
        assert np.array_equal(robot.joints.q, HOME), k
        robot.cycle()
    assert robot.joints.moving


@pytest.mark.parametrize("latency", [1, 6, 50])
def test_a_program_comes_after_what_was_sent_before_it(latency):
    """From six periods on a program was ended by the stop that the client had sent to the one before, and cleared."""
    robot = UrController(UrOptions(latency=latency))
    for sent in (PROGRAM, registers(255), PROGRAM, registers(0), PROGRAM):
        robot.receive(sent)
    run(robot, latency * PERIOD + 0.01)
    assert robot.program is not None


def test_what_is_said_is_short_and_printable(robot):
    robot.say("\x1b[2J" + 100_000 * "a")
    assert robot.log[-1].startswith("?[2Jaaa")
    assert len(robot.log[-1]) < 500


def test_the_program_says_ready_and_done(robot):
    assert robot.outputs()["output_int_register_0"] == 1
    robot.receive(registers(17, 0.5, 0, 0, 0.1))  # setPayload
    run(robot, 0.01)
    assert robot.outputs()["output_int_register_0"] == 2
    assert robot.payload[:2] == (0.5, (0, 0, 0.1))
    robot.receive(registers(0))
    run(robot, 0.01)
    assert robot.outputs()["output_int_register_0"] == 1


def test_movej_is_done_when_it_has_arrived(robot):
    robot.receive(registers(1, *np.add(HOME, 0.2), 1.05, 1.4))
    run(robot, 0.1)
    assert robot.outputs()["output_int_register_0"] == 1
    run(robot, 1.0)
    assert robot.outputs()["output_int_register_0"] == 2
    assert robot.joints.q == pytest.approx(np.add(HOME, 0.2))


def test_a_command_that_is_not_emulated_ends_the_program(robot):
    robot.receive(registers(45))
    run(robot, 0.01)
    assert robot.outputs()["runtime_state"] == STOPPED
    assert "command 45" in robot.log[-1]


def test_the_watchdog_stops_the_arm_when_no_input_comes(robot):
    robot.receive(registers(35, 10.0))  # setWatchdog
    run(robot, 0.01)
    robot.receive(servoj(np.add(HOME, 0.4)))
    run(robot, 0.09)
    assert robot.outputs()["runtime_state"] == PLAYING
    assert robot.joints.moving
    run(robot, 0.02)
    assert robot.outputs()["runtime_state"] == STOPPED
    run(robot, 0.3)
    assert not robot.joints.moving
    assert np.abs(robot.joints.q - HOME).max() < 0.38  # not where it was told to go


@pytest.mark.parametrize(
    ("options", "target", "said"),
    [
        ({"joint_speed": 0.5}, 0.5, "joint speed"),
        ({"tool_speed": 0.3}, 0.5, "flange speed"),
        ({"elbow_speed": 0.1}, 0.5, "elbow speed"),
        ({}, 0.6, "joint acceleration"),
    ],
)
def test_limits_make_a_protective_stop(options, target, said):
    robot = UrController(UrOptions(**options))
    robot.play(PROGRAM)
    robot.receive(servoj(np.add(HOME, target)))
    run(robot, 0.5)
    assert robot.safety == "protective"
    assert said in robot.log[-1]
    assert robot.outputs()["safety_status_bits"] & 1 << 2
    assert robot.outputs()["runtime_state"] == PAUSED
    assert not robot.joints.moving


def test_a_protective_stop_is_unlocked_after_five_seconds_and_nothing_moves_then(robot):
    robot.receive(servoj(np.add(HOME, 0.3)))
    run(robot, 0.1)
    robot.protect()
    run(robot, 4.9)
    assert not robot.unlock()
    run(robot, 0.2)
    assert robot.unlock()
    where = robot.joints.q
    run(robot, 0.5)
    assert np.array_equal(robot.joints.q, where)


def test_an_emergency_stop_is_not_unlocked(robot):
    robot.press()
    run(robot, 6.0)
    assert not robot.unlock()
    assert robot.outputs()["robot_mode"] == 3
    assert robot.program is None


def test_faults_are_due_by_the_time_since_the_arm_began_to_follow(robot):
    robot.add(UrFault("protective", 0.1))
    run(robot, 1.0)
    assert robot.due() == []
    robot.receive(servoj(HOME))
    run(robot, 0.05)
    assert robot.due() == []
    run(robot, 0.1)
    assert robot.due() == [UrFault("protective", 0.1)]
    assert robot.due() == []
    with pytest.raises(InputError, match="protective, emergency"):
        UrFault("flood")  # pyrefly: ignore


def test_torques_hold_the_arm_and_its_payload_against_gravity(robot):
    robot.joints.q = np.array([0, 0, 0, 0, 0, 0.0])  # stretched out
    empty = robot.torques[1]
    robot.payload = (2.0, (0, 0, 0), (0,) * 6)
    reach = 0.425 + 0.3922
    assert abs(robot.torques[1] - empty) == pytest.approx(2.0 * 9.81 * reach, rel=1e-3)
