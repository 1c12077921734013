"""The driver of Universal Robots, through the client ur_rtde, on the emulated robot in lock-step."""

import os
import signal
import subprocess
import sys
import time
from types import SimpleNamespace

import numpy as np
import pytest
from processes import HANG
from ur_robot import ARM, columns, driver, emulated, swing

from whiptool.errors import InputError
from whiptool.identification.servo_lag import ServoLag, fit_servo_lag
from whiptool.models.joint_trajectory import JointTrajectory
from whiptool.rig.robots import ur_client
from whiptool.rig.robots.robot import Payload
from whiptool.rig.robots.ur import UniversalRobot
from whiptool.rig.stops import SafetyError
from whiptool.rig.ur_emulator import UrFault

pytest.importorskip("rtde_control", reason="ur-rtde is not installed, or has no wheel here")
PERIOD = 0.002


def never():
    return None


def back(trajectory):
    """The same way back."""
    q, v, a = trajectory.q[::-1].copy(), -trajectory.v[::-1], trajectory.a[::-1].copy()
    return JointTrajectory(trajectory.joints, trajectory.t, q, v, a)


def speeds(robot):
    """Largest speed of a joint in every period [rad/s], (T,)."""
    return np.abs(robot.history()[:, 7:13]).max(axis=1)


def test_a_trajectory_is_followed_and_the_lag_is_found_and_led():
    samples, trajectory = [], swing()
    with emulated(latency=3) as emulator, driver(emulator) as robot:
        robot.set_payload(Payload(0.4, (0, 0, 0.2), (1e-3, 1e-3, 1e-4, 0, 0, 0)))
        assert emulator.state()["payload"] == (0.4, (0, 0, 0.2), (1e-3, 1e-3, 1e-4, 0, 0, 0))
        robot.follow(trajectory, samples.append, never)
        assert not emulator.state()["program"]
        t, u, q = columns(samples)
        assert np.array_equal(np.rint(np.diff(t[40:]) / PERIOD), np.ones(len(t) - 41))  # each period once
        assert np.abs(q[-1] - trajectory.q[-1]).max() < 0.01
        assert all(x.current.shape == x.target.shape == (6,) for x in samples)
        robot.lag = found = fit_servo_lag(t, u, q)
        assert found.lag == pytest.approx(0.1, abs=1e-4)  # the emulator's look-ahead time
        assert found.stiffness == pytest.approx(300, rel=1e-2)  # its gain
        assert found.delay == pytest.approx(2 * PERIOD, abs=2e-4)  # a command is held for the third period
        robot.follow(back(trajectory), samples.append, never)
    t, _, q = columns(samples[len(t) :])
    late = found.delay + PERIOD / 2
    plan = np.stack([np.interp(t - late, trajectory.t, x) for x in trajectory.q[::-1].T], axis=1)
    assert np.abs(q - plan).max() < 1e-3
    assert np.abs(u - columns(samples[: len(u)])[2]).max() > 0.1  # without the lead


@pytest.mark.slow
def test_the_motion_of_each_sample_is_the_true_one():
    samples = []
    with emulated() as emulator, driver(emulator) as robot:
        robot.follow(swing(D=0.4, scale=0.5), samples.append, never)
        true = emulator.history()
    begin = np.flatnonzero(np.all(true[:, 1:7] == samples[-1].q, axis=1))[0] - round(samples[-1].t / PERIOD)
    at = begin + np.array([round(x.t / PERIOD) for x in samples])
    assert np.array_equal(true[at, 1:7], [x.q for x in samples])
    assert np.array_equal(true[at, 7:13], [x.v for x in samples])


@pytest.mark.parametrize("lag", [ServoLag(0.1, 300.0, 0.002), pytest.param(None, marks=pytest.mark.slow)])
def test_a_reason_to_stop_brings_the_arm_to_rest_within_its_limits(lag):
    samples = []
    with emulated() as emulator, driver(emulator, lag=lag) as robot:
        with pytest.raises(SafetyError, match="signal: SIGINT came") as error:
            robot.follow(swing(), samples.append, lambda: "SIGINT came" if len(samples) > 200 else None)
        assert error.value.kind == "signal"
        seen = len(emulator.history())
        time.sleep(0.2)
        v = speeds(emulator)
        assert not v[seen:].any()
        a = np.diff(emulator.history()[:, 7:13], axis=0) / PERIOD
        assert np.abs(a).max() < 30
        q = robot.posture()
        robot.follow(swing(0.2, start=q), samples.append, never)  # a signal does not end the robot's use


FAULTS = {
    "protective": "protective",
    "emergency": "emergency",
    "halt": "program",
    "cut": "lost",
    "silence": "lost",
    "unheard": "program",
    "unseen": "lost",
}


def strike_into(fault, at):
    """Let a fault happen in a movement; return the error, the motion of every period, and the period of the return."""
    samples, options = [], {"patience": 0.5} if FAULTS[fault] == "lost" else {}
    with emulated() as emulator:
        robot = driver(emulator, **options)
        robot.connect()
        emulator.inject(UrFault(fault, at))
        with pytest.raises(SafetyError) as error:
            robot.follow(swing(), samples.append, never)
        seen = len(emulator.history())
        robot.disconnect()
        if fault in ("halt", "cut"):  # the robot can be reached again
            robot.connect()
            robot.disconnect()
        until = emulator.state()["t"] + 0.7  # longer than the watchdog's time
        while emulator.state()["t"] < until:
            time.sleep(0.01)
        return error.value, speeds(emulator), seen, samples


@pytest.mark.parametrize("fault", [x if x == "cut" else pytest.param(x, marks=pytest.mark.slow) for x in FAULTS])
def test_a_fault_in_the_middle_ends_the_motion_for_good(fault):
    error, v, seen, samples = strike_into(fault, 0.35)
    assert error.kind == FAULTS[fault]
    assert v.max() > 0.5  # it came while the arm moved
    assert len(samples) > 100
    ended = np.flatnonzero(v)[-1]
    if error.kind == "lost":  # nothing can be known of the arm then; its controller ends the motion
        assert ended < len(v) - 50
    else:
        assert ended < seen


def test_a_protective_stop_is_recovered_by_a_person_and_not_before():
    samples, trajectory = [], swing()
    with emulated(unlock_after=1.0) as emulator:
        robot = driver(emulator)
        robot.connect()
        emulator.inject(UrFault("protective", 0.35))
        with pytest.raises(SafetyError, match=r"protective.*recover --robot ur://127\."):
            robot.follow(trajectory, samples.append, never)
        with pytest.raises(SafetyError, match="nothing moved"):
            robot.follow(swing(0.2, start=robot.posture()), samples.append, never)
        robot.disconnect()
        with pytest.raises(InputError, match="PROTECTIVE_STOP"):
            robot.connect()
        before = emulator.state()["q"]
        robot.recover()
        assert emulator.state()["safety"] == "normal"
        assert np.array_equal(emulator.state()["q"], before)
        with robot:
            robot.follow(swing(0.2, start=robot.posture()), samples.append, never)


@pytest.mark.slow
def test_an_emergency_stop_needs_a_person_at_the_robot():
    with emulated() as emulator:
        robot = driver(emulator)
        robot.connect()
        emulator.inject(UrFault("emergency"))
        with pytest.raises(SafetyError, match="emergency"):
            robot.follow(swing(), lambda sample: None, never)
        with pytest.raises(SafetyError, match="only a person at the robot"):
            robot.recover()
        robot.disconnect()


@pytest.mark.slow
def test_an_exception_of_the_caller_stops_the_arm_and_goes_on():
    samples = []

    def record(sample):
        samples.append(sample)
        if len(samples) == 200:
            raise ZeroDivisionError

    with emulated() as emulator:
        with driver(emulator) as robot, pytest.raises(ZeroDivisionError):
            robot.follow(swing(), record, never)
        seen = len(emulator.history())
        time.sleep(0.2)
        assert not speeds(emulator)[seen:].any()


KILLED = """
import sys
from ur_robot import ARM, UniversalRobot, swing
robot = UniversalRobot(sys.argv[1], ARM.joint_limits, patience=60)
robot.connect()
robot.follow(swing(), lambda sample: print(sample.t, flush=True), lambda: None)
"""


@pytest.mark.slow
def test_the_arm_comes_to_rest_when_the_program_that_commands_it_is_killed():
    with emulated() as emulator:
        helpers = os.pathsep.join(["tests/helpers", *sys.path])
        with subprocess.Popen(
            [sys.executable, "-c", KILLED, emulator.host],
            stdout=subprocess.PIPE,
            env=os.environ | {"PYTHONPATH": helpers},
        ) as program:
            assert program.stdout is not None
            while float(program.stdout.readline()) < 0.35:
                pass
            program.send_signal(signal.SIGKILL)
        until = time.monotonic() + HANG
        while emulator.state()["program"] and time.monotonic() < until:
            time.sleep(0.05)
        state = emulator.state()
        assert "it was asked to stop" in state["log"][-1]
        assert not state["v"].any()
        assert speeds(emulator).max() > 0.5


@pytest.mark.parametrize(
    ("options", "said"),
    [({"remote_control": False}, "choose Remote Control"), ({"speed_slider": 0.5}, "speed slider is at 50%")],
)
def test_a_robot_that_is_not_ready_is_told_what_to_do(options, said):
    with (
        emulated(**options) as emulator,
        pytest.raises((InputError, SafetyError), match=said),
        driver(emulator) as robot,
    ):
        robot.follow(swing(), lambda sample: None, never)


def test_a_trajectory_from_elsewhere_does_not_move_the_arm():
    with emulated() as emulator, driver(emulator) as robot:
        with pytest.raises(SafetyError, match=r"start: \w+ is 0.100 rad .* nothing moved"):
            robot.follow(swing(start=robot.posture() + 0.1), lambda sample: None, never)
        assert not speeds(emulator).any()


def test_an_address_without_a_robot_is_refused():
    with pytest.raises(InputError, match="see that this computer reaches its address"):
        UniversalRobot("127.1.2.3", ARM.joint_limits).connect()


@pytest.mark.parametrize(
    "given", [{"lookahead": 0.02}, {"lookahead": 0.3}, {"gain": 99}, {"gain": 2001}, {"patience": 0}]
)
def test_parameters_out_of_range_are_refused(given):
    with pytest.raises(InputError, match=next(iter(given))):
        UniversalRobot("127.0.0.1", ARM.joint_limits, **given)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(12))
def test_no_motion_follows_a_fault_at_any_instant(seed):
    rng = np.random.default_rng(seed)
    fault = str(rng.choice(list(FAULTS)))
    error, v, seen, _ = strike_into(fault, float(rng.uniform(0, 0.55)))  # before the arm has arrived
    moving = np.flatnonzero(v)
    if len(moving) and error.kind != "lost":
        assert moving[-1] < seen
    assert not v[-50:].any()


@pytest.mark.parametrize(
    ("said", "fix"),
    [
        ("One of the RTDE input registers are already in use!", "end the other program that commands it"),
        ("Timeout connecting to UR dashboard server.", "switch the robot on"),
    ],
)
def test_a_robot_that_another_program_commands_is_not_to_be_switched_on(said, fix, monkeypatch):
    def refused(*_):
        raise RuntimeError(said)

    ready = SimpleNamespace(
        connect=lambda patience: None,
        robotmode=lambda: "Robotmode: RUNNING",
        safetystatus=lambda: "Safetystatus: NORMAL",
        isInRemoteControl=lambda: True,
        getSerialNumber=lambda: "20195500001",
    )
    kinds = {"DashboardClient": lambda host: ready, "RTDEReceiveInterface": refused}
    monkeypatch.setattr(ur_client, "optional", lambda *_: SimpleNamespace(**kinds))
    with pytest.raises(InputError, match=fix):
        ur_client.UrClient(SimpleNamespace(host="127.0.0.2", patience=0.05)).connect()


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(8))
def test_no_motion_follows_a_reason_to_stop_at_any_instant(seed):
    samples, at = [], np.random.default_rng(seed).uniform(0, 0.7)  # [s] of the robot's clock
    with emulated() as emulator, driver(emulator) as robot:
        with pytest.raises(SafetyError, match="signal"):
            robot.follow(swing(), samples.append, lambda: "SIGTERM came" if samples and samples[-1].t >= at else None)
        seen = len(emulator.history())
        time.sleep(0.3)
        assert not speeds(emulator)[seen:].any()
