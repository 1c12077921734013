"""Strikes with a robot arm of its own controller: its motion is recorded, and no stop is passed over."""

from __future__ import annotations

import dataclasses
import json
import os
import re
import signal
import sys
from pathlib import Path

import numpy as np
import pytest
from repository import ROOT

import whiptool as wt
from whiptool.commands.rig import _lines, _summary
from whiptool.errors import InputError
from whiptool.identification.servo_lag import ServoLag
from whiptool.limits.all_limits import default_limits, named_limits, unchecked_by
from whiptool.models.kinematics import arm_poses
from whiptool.models.mount import mounted
from whiptool.models.presets import rope
from whiptool.models.spatial_arm import RigidBody, welded
from whiptool.rig.cyclelog import Cycles, Phase
from whiptool.rig.robots import robot_rig
from whiptool.rig.robots.addresses import robot_at
from whiptool.rig.robots.robot import Sample, payload_of
from whiptool.rig.robots.robot_rig import RobotRig, kept_lag, whip_on
from whiptool.rig.session import CYCLES
from whiptool.rig.stops import Locked, NotConfirmed, SafetyError, StrikeInterrupted, StrikeRefused, StrikeStopped
from whiptool.rig.strike_report import _cycle_table
from whiptool.rig.struck import Motion

sys.path.insert(0, str(ROOT / "examples" / "extending"))
from add_robot import LAG, LaggingRobot

MODEL = wt.preset("ur5e")
STRIKE = wt.Strike((-1.63, -1.07, -0.22, -0.49, 2.16, 0.42), (-2.17, -2.07, -0.33, -1.73, -0.35, 2.09), 1.5)


@pytest.fixture(autouse=True)
def usual_signals():
    """As in a terminal: who starts tests in the background may have them ignore signals."""
    before = {n: signal.signal(n, signal.default_int_handler) for n in (signal.SIGINT, signal.SIGTERM)}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


class Interrupted(LaggingRobot):
    """A robot to which something happens at the sample `at`; counts the commands that it gets."""

    def __init__(self, at: int, happens) -> None:
        super().__init__("lab", MODEL)
        self.at, self.happens, self.moves, self.connections = at, happens, 0, 0

    def connect(self) -> None:
        self.connections += 1

    def follow(self, trajectory, record, stop) -> None:
        def noticed(sample: Sample) -> None:
            record(sample)
            self.moves += 1
            if self.moves == self.at:
                self.happens()

        super().follow(trajectory, noticed, stop)


def test_the_recording_is_the_measured_motion_by_the_strikes_clock(tmp_path: Path) -> None:
    """A first-order lag on a minimum-jerk path: joints are late by its time constant, to first order."""
    struck = RobotRig(MODEL, LaggingRobot("lab", MODEL)).strike(STRIKE, folder=tmp_path)
    recording = struck.recording
    assert recording is not None
    assert recording.strike == STRIKE
    inside = (recording.joints_t > 0.1) & (recording.joints_t < STRIKE.D)
    late = np.array([STRIKE.reference(t - LAG)[0] for t in recording.joints_t[inside]])
    np.testing.assert_allclose(recording.joints_q[inside], late, atol=2e-3)
    cycles = Cycles.load(tmp_path / CYCLES)
    robot = LaggingRobot("lab", MODEL)
    assert cycles.about["strike_begins"] == RobotRig(MODEL, robot).trajectory(STRIKE, robot.posture()).strike_begins
    assert set(cycles.phase) == {Phase.APPROACH, Phase.SETTLE, Phase.STRIKE}
    assert np.ptp(cycles.during(Phase.SETTLE).t) == pytest.approx(2.0, abs=0.01)
    assert not np.diff(cycles.during(Phase.SETTLE).q_d, axis=0).any()
    np.testing.assert_allclose(cycles.q[-1], STRIKE.q_f, atol=1e-6)


def test_a_look_at_the_hanging_whip_is_recorded_from_where_the_arm_rests() -> None:
    still = wt.Strike(STRIKE.q_i, STRIKE.q_i, 1.0)
    recording = RobotRig(MODEL, LaggingRobot("lab", MODEL)).strike(still).recording
    assert recording is not None
    during = recording.joints_q[recording.joints_t >= 0]
    np.testing.assert_allclose(during, np.broadcast_to(STRIKE.q_i, during.shape), atol=1e-6)
    assert recording.joints_t[-1] == pytest.approx(1.3, abs=0.01)


@pytest.mark.parametrize("seed", range(8))
def test_a_signal_at_any_instant_ends_all_motion(seed: int, tmp_path: Path) -> None:
    at = int(np.random.default_rng(seed).integers(1, 1500))
    robot = Interrupted(at, lambda: os.kill(os.getpid(), signal.SIGINT))
    rig = RobotRig(MODEL, robot)
    with pytest.raises(StrikeInterrupted, match="SIGINT"):
        rig.strike(STRIKE, folder=tmp_path)
    assert robot.moves == at
    assert len(Cycles.load(tmp_path / CYCLES)) == at
    with pytest.raises(Locked):
        rig.strike(STRIKE)
    assert (robot.moves, robot.connections) == (at, 1)


def test_a_fault_of_the_robot_stops_the_session_until_a_person_releases_it() -> None:
    def reflex() -> None:
        raise SafetyError("reflex", "the robot stopped itself")

    robot = Interrupted(700, reflex)
    rig = RobotRig(MODEL, robot)
    with pytest.raises(StrikeStopped, match=r"reflex: the robot stopped itself; the robot's own .* holds the arm"):
        rig.strike(STRIKE)
    with pytest.raises(Locked, match="reflex"):
        rig.strike(STRIKE)
    assert robot.moves == 700
    rig.interlock.release()
    robot.at = 0
    assert rig.strike(STRIKE).run.fault is None


def test_an_error_of_a_driver_locks_the_robot_and_is_not_hidden() -> None:
    robot = Interrupted(3, lambda: [].pop())
    rig = RobotRig(MODEL, robot)
    with pytest.raises(IndexError):
        rig.strike(STRIKE)
    with pytest.raises(Locked, match="exception: IndexError"):
        rig.strike(STRIKE)


def test_a_camera_that_is_lost_stops_the_robot() -> None:
    class Lost(RobotRig):
        def _run(self, arm, attempt, motion):
            def lost(k, phase):
                if k == 40:
                    raise SafetyError("camera", "it gave no frame")

            return super()._run(arm, dataclasses.replace(attempt, on_cycle=lost), motion)

    robot = Interrupted(0, None)
    with pytest.raises(StrikeStopped, match="camera: it gave no frame"):
        Lost(MODEL, robot).strike(STRIKE)
    assert robot.moves == 41


def test_what_the_robot_must_not_do_is_refused_before_it_hears_of_it() -> None:
    robot = Interrupted(0, None)
    rig = RobotRig(MODEL, robot, limits=default_limits(MODEL, prescribed=True))
    fast = wt.Strike(STRIKE.q_i, STRIKE.q_f, 0.5)
    with pytest.raises(StrikeRefused, match=r"the velocity of .* its limit is 3.14"):
        rig.strike(fast)
    low = wt.Strike((0.0, -1.9, 1.4, -1.2, 0.0, 0.0), (0.0, -1.8, 1.3, -1.2, 0.0, 0.0), 1.0)
    with pytest.raises(StrikeRefused, match="below the floor"):
        rig.strike(low)
    assert robot.moves == 0
    with pytest.raises(InputError, match="'6 joints'; allowed: 7"):
        RobotRig(wt.preset("panda"), robot)


def test_what_would_be_refused_is_known_before_from_where_the_arm_stands() -> None:
    """The robot is asked once where it stands. Its whip may lie on the floor there, until the arm lifts it."""
    robot = Interrupted(0, None)
    rig = RobotRig(MODEL, robot, limits=default_limits(MODEL, prescribed=True))
    robot._q = low = np.array([-0.149, -0.052, -1.655, 1.914, -0.409, -2.555])
    quick = wt.Strike(STRIKE.q_i, STRIKE.q_f, 0.5)
    high, there = wt.Strike(STRIKE.q_i, STRIKE.q_i, 0.5), wt.Strike(tuple(low), tuple(low), 0.5)
    assert rig.refusal(high) is None
    said = rig.refusal(there) or ""
    assert said.startswith("on the way to the start, at 0.000 s, the hanging whip is 463 mm below the floor; raise")
    assert re.match(r"0\.\d\d\d s into the strike the velocity of", rig.refusal(quick) or "")
    assert (robot.connections, robot.moves) == (1, 0)
    rig.strike(high)
    assert rig.refusal(STRIKE) is None
    assert robot.connections == 3
    down = RobotRig(MODEL, robot, limits=default_limits(MODEL, prescribed=True))
    robot._q = np.array([0.0, 1.2, 0.0, 0.0, 0.0, 0.0])
    with pytest.raises(InputError, match=r"posture: .*where the robot stands .* below the floor: move it by hand"):
        down.refusal(STRIKE)


def test_a_whip_that_comes_to_lie_on_the_floor_and_one_that_is_lifted_from_it_are_said(capsys) -> None:
    """From a strike that ends low the next begins with the whip on the floor; heights by the rope's straight hanging.

    The rope of the preset is 1 m long, and hangs straight down from the hand.
    """
    low = (-0.149, -0.052, -1.655, 1.914, -0.409, -2.555)
    rig = RobotRig(MODEL, LaggingRobot("lab", MODEL), limits=default_limits(MODEL, prescribed=True))
    hand = arm_poses(MODEL.arm, np.array([low]))[0][0, -1, 2]
    below = rig._below_floor(np.array(low), None)
    assert below == pytest.approx(MODEL.whip.length - hand, abs=0.02)
    assert rig._below_floor(np.array(STRIKE.q_i), None) == 0.0
    rig._ask(Motion(wt.Strike(STRIKE.q_i, low, 1.5), "lab://one", "elbow", 1.0, 9.0))
    said = f"at the end of the strike the whip lies on the floor: hanging it would reach {below:.2f} m below it"
    assert said in capsys.readouterr().err
    rig.robot._q = np.array(low)
    rig.strike(wt.Strike(STRIKE.q_i, STRIKE.q_i, 0.5))
    said = capsys.readouterr().err
    assert "the whip lies on the floor where the arm stands: the way to the start lifts it clear" in said
    assert "at the end" not in said


def test_the_lag_of_a_robot_is_kept_for_the_next_process(tmp_path: Path, monkeypatch, capsys) -> None:
    """By the robot's address; the next run leads by it, says so, and replaces it by its own first fit."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    found = ServoLag(0.101, 300.0, 0.002, (1e-3, 5.0, 1e-3))
    monkeypatch.setattr(robot_rig, "fit_servo_lag", lambda t, u, q, period: found)

    class Leads(LaggingRobot):
        leads = True

    def made(port: str) -> tuple[ServoLag | None, str]:
        rig = RobotRig(MODEL, Leads("lab", MODEL), port=port)
        rig.robot._q = np.array(STRIKE.q_i)
        rig.strike(STRIKE)
        return rig.robot.lag, capsys.readouterr().err

    lag, said = made("lab://one")
    assert lag == found
    assert "the commands lead by" not in said
    file = kept_lag("lab://one")
    assert file is not None
    older = dataclasses.asdict(ServoLag(0.03, 300.0)) | {"date": "2026-01-02"}
    assert json.loads(file.read_text()).keys() == older.keys()
    file.write_text(json.dumps(older))
    lag, said = made("lab://one")
    assert "the commands lead by 30.0 ms, the lag of the joints found on 2026-01-02" in said
    assert lag == found
    assert json.loads(file.read_text())["lag"] == found.lag
    assert "the commands lead by" not in made("lab://two")[1]
    assert kept_lag("robot") is None
    for damaged in ("{}", '{"errors": [1, 2, 3], "lag": "long", "stiffness": 300}', "[]"):
        file.write_text(damaged)
        with pytest.raises(InputError, match=r"lab-one\.json"):
            made("lab://one")


def test_a_person_is_asked_once_all_is_known_and_before_anything_moves() -> None:
    asked: list[Motion] = []
    robot = Interrupted(0, None)

    def no(motion: Motion) -> bool:
        asked.append(motion)
        return False

    limits = default_limits(MODEL, prescribed=True)
    rig = RobotRig(MODEL, robot, port="lab://one", limits=limits, confirm=no)
    with pytest.raises(NotConfirmed, match="nothing was armed"):
        rig.strike(STRIKE)
    assert (robot.connections, robot.moves) == (1, 0)
    (motion,) = asked
    path = rig.trajectory(STRIKE, robot.posture())
    assert (motion.port, motion.duration, motion.unchecked) == ("lab://one", path.t[-1], ())
    j = MODEL.arm.names.index(motion.joint)
    assert motion.reach == pytest.approx(path.q[:, j].max() - path.q[:, j].min())
    assert motion.reach >= np.abs(np.subtract(STRIKE.q_f, STRIKE.q_i)).max()
    with pytest.raises(StrikeRefused):
        rig.strike(wt.Strike(STRIKE.q_i, STRIKE.q_f, 0.5))
    assert len(asked) == 1


def test_what_is_not_checked_is_known_of_limits() -> None:
    def left(**named) -> tuple[str, ...]:
        return unchecked_by(named_limits(named, MODEL, prescribed=True))

    assert left() == ()
    assert left(floor="none") == ("floor",)
    assert left(ignore_collisions=True) == ("collisions", "floor")
    assert left(limits="none") == ("collisions", "floor", "torques and speeds of the joints in the simulated strike")
    on_wall = dataclasses.replace(MODEL, arm=mounted(MODEL.arm.in_space(), "wall", None))
    assert unchecked_by(default_limits(on_wall, prescribed=True)) == ("floor",)
    arm = MODEL.arm.in_space()
    links = [dataclasses.replace(x, limits=dataclasses.replace(x.limits, velocity=np.inf)) for x in arm.links]
    slow = dataclasses.replace(MODEL, arm=dataclasses.replace(arm, links=(*arm.links[:2], *links[2:])))
    assert unchecked_by(default_limits(slow, prescribed=True)) == ("speeds of joints that have no limit of it",)


def test_motor_currents_are_recorded_where_the_robot_reports_them() -> None:
    class Reports(LaggingRobot):
        def follow(self, trajectory, record, stop) -> None:
            super().follow(trajectory, lambda x: record(dataclasses.replace(x, current=2 * x.q)), stop)

    cycles = RobotRig(MODEL, Reports("lab", MODEL)).strike(STRIKE).run.cycles
    np.testing.assert_array_equal(cycles.current, 2 * cycles.q)
    assert np.isnan(cycles.tau).all()


def test_states_that_did_not_come_are_counted_by_the_clock_of_the_controller(tmp_path: Path, capsys) -> None:
    """Every tenth state is lost, and once four in a row: in numbers, in the line, and in the report's table."""

    class Loses(LaggingRobot):
        def follow(self, trajectory, record, stop) -> None:
            self.number, self.kept = 0, 0

            def some(sample: Sample) -> None:
                self.number += 1
                if self.number % 10 and self.number not in (1001, 1002, 1003):
                    self.kept += 1
                    record(sample)

            super().follow(trajectory, some, stop)

    robot = Loses("lab", MODEL)
    struck = RobotRig(MODEL, robot).strike(STRIKE)
    run, inside = struck.run, robot.number - (robot.number % 10 == 0)
    assert (run.missed, run.overruns, len(run.cycles)) == (inside - robot.kept, None, robot.kept)
    assert run.cycles.longest_gap == pytest.approx(0.010)  # 1000 is one of the tenths
    assert "states of the robot were not received, the longest gap is 10 ms" in capsys.readouterr().err
    target = wt.Target((1.0, 0.2, 0.6))
    summary = _summary(struck, target)
    assert (
        f"{run.missed} more are missing by its clock, longest gap 10.0 ms"
        in _lines(struck, summary, target, "none")[-1]
    )
    table = _cycle_table(run.cycles).rows
    assert sum(int(row[2]) for row in table[1:]) == run.missed
    assert max(float(row[3]) for row in table[1:]) == pytest.approx(10.0)
    assert RobotRig(MODEL, LaggingRobot("lab", MODEL)).strike(STRIKE).run.missed == 0


def test_a_trajectory_from_elsewhere_is_refused() -> None:
    robot = LaggingRobot("lab", MODEL)
    trajectory = RobotRig(MODEL, robot).trajectory(STRIKE, robot.posture())
    robot._q = robot.posture() + np.array([0.02, 0, 0, 0, 0, 0])
    with pytest.raises(SafetyError, match=r"start: .* is 0.020 rad from .* nothing moved"):
        robot.follow(trajectory, lambda sample: None, lambda: None)


def test_the_payload_is_stick_and_whip() -> None:
    """Rod and point, put together by the theorem of parallel axes."""
    length, mass = MODEL.arm.stick
    assert (length, mass) == (0.65, 0.09)
    rod = RigidBody(mass, np.array([0, 0, length / 2]), np.diag([1, 1, 0]) * mass * length**2 / 12)
    both = welded([rod, RigidBody(MODEL.whip.mass, np.array([0, 0, length]), np.zeros((3, 3)))])
    payload = payload_of(MODEL)
    assert payload.mass == pytest.approx(both.mass)
    np.testing.assert_allclose(payload.center, both.com)
    np.testing.assert_allclose(payload.inertia, both.moments, atol=1e-15)


def test_the_simulated_whip_hangs_on_the_measured_joints() -> None:
    model = dataclasses.replace(MODEL, whip=rope(5))
    struck = RobotRig(model, LaggingRobot("lab", model)).strike(STRIKE)
    path = whip_on(model, struck.run.cycles, model.arm.names)
    recording = struck.recording
    assert recording is not None
    moved = np.array([np.interp(path.t, recording.joints_t, q) for q in recording.joints_q.T]).T
    np.testing.assert_allclose(path.q[:, :6], moved, atol=0.01)
    assert np.linalg.norm(path.tip_velocity, axis=1).max() > 10


def test_robots_are_found_by_their_address() -> None:
    with pytest.raises(InputError, match=r"robot: got '192.168.0.10'; allowed: franka://HOST, ur://HOST"):
        robot_at("192.168.0.10", MODEL)
    with pytest.raises(InputError, match=r"got 'kuka://lab'; allowed: franka://HOST, ur://HOST.*; write a driver"):
        robot_at("kuka://lab", MODEL)
