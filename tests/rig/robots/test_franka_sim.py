"""Strikes with the driver of Franka's robots on a simulated FR3 that was not written here: `franka-sim`, which speaks
the robot's protocol and aborts motions beyond the robot's limits and after lost packets, as the robot does.
"""

from __future__ import annotations

import threading
from collections.abc import Iterator
from functools import cache

import numpy as np
import pytest
from franka_server import FrankaServer, franka_server

from whiptool.goals.target import Target
from whiptool.models import preset
from whiptool.models.joint_trajectory import JointTrajectory
from whiptool.models.smooth_path import path_between
from whiptool.models.strike import Strike
from whiptool.objective import Objective
from whiptool.optimizers import search
from whiptool.rig.robots.franka import Franka
from whiptool.rig.robots.robot import Payload, Sample
from whiptool.rig.stops import SafetyError, StrikeRefused
from whiptool.rollout import CompiledRollout

FR3 = preset("fr3")
ARM = FR3.arm
LIMITS = ARM.joint_limits
SAMPLES: list[Sample] = []  # of the last motion
TRACKING = 0.02  # [rad] at most between command and measurement: PD control with feedforward of the velocity


@pytest.fixture(scope="module")
def server(tmp_path_factory) -> Iterator[FrankaServer]:
    with franka_server(tmp_path_factory.mktemp("franka") / "server.log") as running:
        yield running


@pytest.fixture
def robot(server) -> Iterator[Franka]:
    with Franka(server.host, LIMITS) as connected:
        yield connected


def never() -> None:
    return None


def trajectory(robot: Franka, strike: Strike) -> JointTrajectory:
    """The way to a strike's start, quicker than strikes of the command take it, and the strike."""
    way = path_between(robot.posture(), strike.q_i, LIMITS, robot.rate, share=1.0)
    rest = JointTrajectory.of_strike(strike, ARM.names, rate=robot.rate, rest=0.05, t_stay=0.05)
    q, v, a = (np.vstack([x[:-1], y]) for x, y in zip(way, (rest.q, rest.v, rest.a), strict=True))
    return JointTrajectory(ARM.names, np.arange(len(q)) / robot.rate, q, v, a)


def follow(robot: Franka, path: JointTrajectory, stop=never) -> list[Sample]:
    """Follow a trajectory; its samples are also in SAMPLES, however it ends."""
    SAMPLES.clear()
    robot.follow(path, SAMPLES.append, stop)
    return list(SAMPLES)


def swing(robot: Franka, by: float = 0.3) -> JointTrajectory:
    """A quick movement of all joints, towards the middle of their ranges."""
    q, middle = robot.posture(), np.mean([joint.position for joint in LIMITS], axis=1)
    end = q + by * np.where(q > middle, -1, 1)
    return JointTrajectory.of_strike(Strike(tuple(q), tuple(end), 0.6), ARM.names, rate=1000.0, rest=0.02, t_stay=0.02)


def test_a_short_movement_is_carried_out_and_recorded(robot):
    """1 ms a sample by the robot's clock; the load is accepted."""
    robot.set_payload(Payload(0.18, (0.0, 0.0, 0.5), (0.02, 0.02, 0.001, 0.0, 0.0, 0.0)))
    q = robot.posture()
    strike = Strike(tuple(q), tuple(q + 0.02), 0.15)
    path = JointTrajectory.of_strike(strike, ARM.names, rate=1000.0, rest=0.01, t_stay=0.01)
    samples = follow(robot, path)
    np.testing.assert_allclose(np.diff([x.t for x in samples]), 1e-3, atol=1e-9)
    np.testing.assert_allclose([x.q_d for x in samples[1 : len(path.t)]], path.q[:-1], atol=1e-6)  # of single precision
    assert np.abs(robot.posture() - strike.q_f).max() < TRACKING


SOME = [pytest.param(3, marks=pytest.mark.slow), pytest.param(20, marks=pytest.mark.hours)]  # strikes


@cache
def planned(count: int) -> list[Strike]:
    """Strikes at points, and at points from given directions, each the best of at most 150 trials."""
    rollout, rng, found = CompiledRollout(FR3), np.random.default_rng(0), []
    for k in range(count):
        azimuth, height, r = rng.uniform((-1.0, 0.1, 0.8), (1.0, 0.9, 1.3))
        point = np.array([r * np.cos(azimuth), r * np.sin(azimuth), height])
        goal = {"direction": tuple(point / np.linalg.norm(point)), "cone": 0.5} if k % 2 else {}
        objective = Objective(rollout, Target(tuple(point), hit_radius=0.05, **goal), max_trials=150, stop_at_hit=True)
        found.append(search(objective, "gradient", seed=k))
    assert sum(result.outcome.hit for result in found) >= count / 2
    return [result.strike for result in found]


@pytest.mark.parametrize("count", SOME)
def test_planned_strikes_are_carried_out_without_a_reflex(robot, count):
    fastest = 0.0
    for strike in planned(count):
        path = trajectory(robot, strike)
        assert path.beyond(LIMITS) is None
        samples = follow(robot, path)
        q, q_d, v = (np.array([getattr(x, name) for x in samples]) for name in ("q", "q_d", "v"))
        np.testing.assert_allclose(q_d[1001 : len(path.t)], path.q[1000:-1], atol=1e-5)  # from its last command on
        assert np.abs(q - q_d).max() < TRACKING
        fastest = max(fastest, np.abs(v).max())
    assert fastest > 1.5  # these are strikes


@pytest.mark.parametrize("count", SOME)
def test_strikes_made_too_fast_are_refused_before_the_robot_sees_them(robot, count):
    """Then the robot still takes the strike as it was planned: no fault came of it."""
    for strike in planned(count)[:10]:
        path = trajectory(robot, strike)
        begins = np.searchsorted(path.t, path.strike_begins)
        quick = np.vstack([path.q[:begins], path.q[begins::2]])  # twice as fast, as one makes it by hand
        zero, t = np.zeros_like(quick), np.arange(len(quick)) * 1e-3
        with pytest.raises(StrikeRefused, match="between samples"):
            follow(robot, JointTrajectory(path.joints, t, quick, zero, zero))
        with pytest.raises(StrikeRefused, match="fr3_joint"):
            follow(robot, trajectory(robot, Strike(strike.q_i, strike.q_f, strike.D / 2)))
        assert not SAMPLES
    follow(robot, swing(robot))


@pytest.mark.slow
def test_stops_at_random_instants_end_in_rest_without_a_reflex(robot):
    """The robot accepts every braking, and has not moved any more a while after."""
    rng = np.random.default_rng(0)
    for instant in rng.uniform(0.03, 0.62, 8):
        with pytest.raises(SafetyError, match="signal: SIGTERM came"):
            follow(robot, swing(robot), lambda at=instant: "SIGTERM came" if SAMPLES[-1].t >= at else None)
        rests = robot.posture()
        assert np.abs(SAMPLES[-1].q - rests).max() < 5e-3
        for _ in range(100):
            assert np.abs(robot.posture() - rests).max() < 5e-3
        assert SAMPLES[-1].t < instant + 0.8


@pytest.mark.slow
def test_a_cable_pulled_in_the_middle_stops_the_strike_and_it_goes_on_after_recovery(server, robot):
    """At random instants: the recording ends there; after it is plugged in and acknowledged, the robot moves again."""
    for instant in np.random.default_rng(1).uniform(0.1, 0.5, 3):
        pulled = threading.Event()

        def pull(at=instant, pulled=pulled) -> None:
            if SAMPLES[-1].t >= at and not pulled.is_set():
                pulled.set()
                server.cable("pull")

        with pytest.raises(SafetyError, match="connection") as caught:
            follow(robot, swing(robot), pull)
        assert caught.value.kind == "connection"
        assert SAMPLES[-1].t == pytest.approx(instant, abs=5e-3)
        server.cable("plug")
        robot.recover()
        before = robot.posture()
        assert np.abs(robot.posture() - before).max() < 5e-3
        follow(robot, swing(robot))
