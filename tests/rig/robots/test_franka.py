"""The driver of Franka's robots: its commands, stops and faults, with a stand-in for the maker's client."""

from __future__ import annotations

import dataclasses
import re
import sys

import numpy as np
import pytest
from fake_franka import FakeFranka

from whiptool.errors import InputError
from whiptool.models import preset
from whiptool.models.joint_trajectory import JointTrajectory
from whiptool.models.presets import FR3_ARM
from whiptool.models.smooth_path import path_to_rest
from whiptool.models.spatial_arm import JointLimits
from whiptool.models.strike import Strike
from whiptool.rig.robots.addresses import robot_at
from whiptool.rig.robots.franka import Franka
from whiptool.rig.robots.robot import Payload, Sample
from whiptool.rig.stops import SafetyError, StrikeRefused

LIMITS = FR3_ARM.joint_limits
START = np.array([0.0, -0.5, 0.0, -2.2, 0.0, 1.6, 0.7])
STRIKE = Strike(tuple(START), tuple(START + np.array([0.6, 0.5, -0.4, 0.7, 0.8, 0.6, -0.5])), 0.8)


def trajectory(strike: Strike = STRIKE, **options) -> JointTrajectory:
    return JointTrajectory.of_strike(strike, FR3_ARM.names, **{"rate": 1000.0, "rest": 0.02, "t_stay": 0.02} | options)


@pytest.fixture
def fake(monkeypatch) -> FakeFranka:
    library = FakeFranka(START)
    monkeypatch.setitem(sys.modules, "pylibfranka", library)
    return library


@pytest.fixture
def robot(fake):
    with Franka("fr3.local", LIMITS) as robot:
        yield robot


def never() -> None:
    return None


def follow(robot: Franka, path: JointTrajectory, stop=never) -> list[Sample]:
    samples: list[Sample] = []
    robot.follow(path, samples.append, stop)
    return samples


def received(fake: FakeFranka) -> JointTrajectory:
    """What the robot received, as it sees it."""
    q = np.array([START, *(q for q, _ in fake.commands)])
    zero = np.zeros_like(q)
    return JointTrajectory(FR3_ARM.names, np.arange(len(q)) * 1e-3, q, zero, zero)


def test_every_cycle_gets_its_sample_and_the_last_one_ends_the_motion(fake, robot):
    path = trajectory()
    samples = follow(robot, path)
    np.testing.assert_array_equal([q for q, _ in fake.commands[: len(path.t)]], path.q)
    assert [over for _, over in fake.commands] == [False] * len(path.t) + [True]
    np.testing.assert_allclose([x.t for x in samples], np.arange(len(samples)) * 1e-3, atol=1e-9)
    np.testing.assert_array_equal([x.q_d for x in samples[1 : len(path.t)]], path.q[:-1])
    assert (samples[3].tau == 1).all()


def test_lost_cycles_are_passed_over(fake, robot):
    """The robot's clock says which sample is due."""
    fake.lost = {100: 3, 300: 1}
    path = trajectory()
    samples = follow(robot, path)
    due = np.round(np.array([x.t for x in samples]) / 1e-3).astype(int)
    assert len(set(np.diff(due))) == 3
    np.testing.assert_array_equal([q for q, _ in fake.commands], path.q[np.minimum(due, len(path.t) - 1)])


def test_a_motion_begins_at_the_robot_s_last_command(fake, robot):
    """2 mrad off, without a step: within the limits, and at the trajectory's end in the end."""
    fake.q = START + 2e-3
    path = trajectory(rest=1.2)
    follow(robot, path)
    np.testing.assert_allclose(fake.commands[0][0], START + 2e-3, atol=1e-9)
    np.testing.assert_allclose(fake.commands[-1][0], path.q[-1], atol=1e-12)
    assert np.abs(np.diff([q for q, _ in fake.commands[:1200]], n=2, axis=0)).max() < 0.1e-6


def test_a_stop_at_any_instant_brakes_within_the_limits(fake, robot):
    """As the robot judges them, by differences of what it received; then it receives nothing more."""
    rng, path = np.random.default_rng(0), trajectory()
    for cycle in [1, *rng.integers(20, 830, 40)]:
        fake.q, fake.commands, fake.cycle = START, [], 0
        with pytest.raises(SafetyError, match="signal: SIGINT came") as caught:
            follow(robot, path, lambda cycle=cycle: "SIGINT came" if fake.cycle >= cycle else None)
        assert caught.value.kind == "signal"
        motion = received(fake)
        assert motion.beyond(LIMITS) is None
        v, _, _ = motion.differences()
        assert np.abs(v[-1]).max() < 1e-9
        assert fake.commands[-1][1]
        assert sum(over for _, over in fake.commands) == 1
        speed = np.abs(path.v[min(cycle, len(path.t) - 1)]).max()
        assert len(fake.commands) - cycle < 1e3 * (speed / 9.5 + 2 * 10 / 4750) + 20


def test_a_stop_that_would_leave_a_range_comes_a_little_later(fake):
    """A joint that brakes to 0.1 mrad before its end, with more of its acceleration than is used for stops."""
    plain = [JointLimits(x.position, x.velocity, x.acceleration, x.jerk) for x in LIMITS]
    q, v, a = path_to_rest(START, 1.5 * np.eye(7)[5], np.zeros(7), plain, 1000.0, share=0.999)
    q, v, a = (np.vstack([x[:0:-1] * sign, x]) for x, sign in ((q - q[0], -1), (v, 1), (a, -1)))
    path = JointTrajectory(FR3_ARM.names, np.arange(len(q)) * 1e-3, START + q - q[0], v, a)
    plain[5] = dataclasses.replace(plain[5], position=(0.5, float(path.q[-1, 5]) + 1e-4))
    later = []
    for cycle in range(10, len(q) - 10, 10):
        fake.q, fake.commands, fake.cycle = START, [], 0
        with Franka("fr3.local", plain) as robot, pytest.raises(SafetyError):
            follow(robot, path, lambda cycle=cycle: "stop" if fake.cycle >= cycle else None)
        sent = np.array([q for q, _ in fake.commands])
        assert sent[:, 5].max() <= plain[5].position[1]
        later.append((sent[: cycle + 5] == path.q[: cycle + 5]).all())
    assert 0 < sum(later) < len(later)


@pytest.mark.parametrize("cycle", [0, 1, 57, 412, 838])
@pytest.mark.parametrize(("error", "kind"), [("ControlException", "reflex"), ("NetworkException", "connection")])
def test_after_a_fault_nothing_is_sent(fake, robot, cycle, error, kind):
    fake.fails = {cycle: getattr(fake, error)('libfranka: Move command aborted: ["joint_reflex"]')}
    samples: list[Sample] = []
    with pytest.raises(SafetyError, match=rf'^{kind}: Move command aborted: \["joint_reflex"\](; .*|)$') as stopped:
        robot.follow(trajectory(), samples.append, never)
    assert len(fake.commands) == cycle
    assert ("robot recover --robot franka://fr3.local" in str(stopped.value)) == (kind == "reflex")
    assert len(samples) == cycle + (kind == "reflex")  # the last is the state after the fault
    assert [name for name, *_ in fake.calls].count("start") == 1
    with pytest.raises(InputError, match="idle"):
        Franka("fr3.local", LIMITS).connect()
    fake.fails = {}
    robot.recover()
    follow(robot, trajectory(Strike(tuple(fake.q), tuple(fake.q), 0.1), rest=0.01))


def test_errors_of_what_is_called_in_a_cycle_stop_the_arm_and_are_not_changed(fake, robot):
    def full(sample: Sample) -> None:
        if sample.t > 0.4:
            raise OSError("disk full")

    with pytest.raises(OSError, match="disk full"):
        robot.follow(trajectory(), full, never)
    assert received(fake).beyond(LIMITS) is None
    assert np.abs(received(fake).differences()[0][-1]).max() < 1e-9


REFUSED = {
    "too fast": (dataclasses.replace(STRIKE, D=0.3), {}, "acceleration of fr3_joint"),
    "of another rate": (STRIKE, {"rate": 500.0}, "samples are 0.002 s apart"),
}


@pytest.mark.parametrize("which", REFUSED)
def test_what_would_be_a_reflex_is_refused_before_anything_is_sent(fake, robot, which):
    strike, options, said = REFUSED[which]
    with pytest.raises(StrikeRefused, match=said):
        follow(robot, trajectory(strike, **options))
    assert not fake.commands
    assert "start" not in [name for name, *_ in fake.calls]


def test_limits_of_the_interface_hold_where_a_file_states_none(fake):
    """URDF files state no accelerations; a robot of a model from one has them."""
    stated = [JointLimits(x.position, x.velocity, jerk=900.0) for x in LIMITS]
    found = Franka("fr3.local", stated).limits
    assert {(x.acceleration, x.jerk, x.velocity_margin) for x in found} == {(10.0, 900.0, 1e-3)}
    assert Franka("fr3.local", LIMITS).limits == LIMITS
    made = robot_at("franka://10.0.0.2", preset("fr3"))
    assert isinstance(made, Franka)
    assert (made.host, made.limits) == ("10.0.0.2", LIMITS)


def test_a_trajectory_that_ends_in_motion_is_refused(fake, robot):
    path = trajectory()
    cut = JointTrajectory(path.joints, path.t[:400], path.q[:400], path.v[:400], path.a[:400])
    with pytest.raises(StrikeRefused, match="begin and end at rest"):
        follow(robot, cut)
    with pytest.raises(SafetyError, match=r"start: fr3_joint1 is 0\.020 rad from"):
        follow(robot, trajectory(Strike(tuple(START + 0.02 * np.eye(7)[0]), STRIKE.q_f, 0.9)))
    assert not fake.commands


def test_load_and_collisions_are_set(fake, robot):
    robot.set_payload(Payload(0.18, (0.0, 0.0, 0.5), (1.0, 2.0, 3.0, 0.4, 0.5, 0.6)))
    assert fake.calls[-1] == ("set_load", 0.18, [0.0, 0.0, 0.5], [1.0, 0.4, 0.5, 0.4, 2.0, 0.6, 0.5, 0.6, 3.0])
    name, low, high, *_ = fake.calls[1]
    assert (name, low, high) == ("set_collision_behavior", [40, 40, 36, 36, 32, 28, 24], [40, 40, 36, 36, 32, 28, 24])
    robot.disconnect()
    assert fake.calls[-1] == ("stop",)
    robot.disconnect()
    with pytest.raises(SafetyError, match="connection"):
        robot.posture()


@pytest.mark.parametrize(
    ("mode", "said"),
    [("UserStopped", "stop button"), ("Reflex", "robot recover --robot franka://fr3.local"), ("Other", "unlock")],
)
def test_a_robot_that_is_not_ready_is_refused_with_what_to_do(fake, mode, said):
    fake.mode = mode
    with pytest.raises(InputError, match=f"robot: got 'franka://fr3.local in the mode {mode}'.*{said}"):
        Franka("fr3.local", LIMITS).connect()


def test_only_a_person_releases_the_stop_button(fake, robot):
    fake.mode = "UserStopped"
    with pytest.raises(SafetyError, match="recovery: command rejected"):
        robot.recover()


def test_a_missing_client_names_what_installs_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "pylibfranka", None)
    with pytest.raises(InputError, match=re.escape("pylibfranka")):
        Franka("fr3.local", LIMITS)
