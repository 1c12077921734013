"""Joint trajectories for robots: their parts, limits, files, and a hand as joints of a virtual arm."""

from __future__ import annotations

import dataclasses
import math
import re
import warnings

import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation, Slerp

from whiptool.errors import InputError
from whiptool.impedance.arm import Arm
from whiptool.models import preset
from whiptool.models.hand_space import HandSpace, hand_poses
from whiptool.models.joint_trajectory import JointTrajectory, hand_joints
from whiptool.models.kinematics import HandKinematics, arm_frames
from whiptool.models.smooth_path import path_between
from whiptool.models.spatial_arm import JointLimits
from whiptool.models.strike import Strike

STRIKE = Strike((-1.2, 0.9), (1.2, 0.3), 0.7005)
JOINTS = ("shoulder", "elbow")
LIMITS = (JointLimits((-3, 3), 8.0, 40.0, 900.0), JointLimits((-3, 3), 4.0, 20.0, 400.0))
POSTURE = (0.4, -0.5)


def trajectory(**options) -> JointTrajectory:
    return JointTrajectory.of_strike(STRIKE, JOINTS, **{"limits": LIMITS, "rest": 1.0, "t_stay": 0.2, **options})


def test_way_rest_strike_and_stay_follow_each_other():
    found = trajectory(start=POSTURE, rate=250)
    begins = found.strike_begins
    way = path_between(POSTURE, STRIKE.q_i, LIMITS, 250)
    assert begins == pytest.approx((len(way[0]) - 1) / 250 + 1, abs=1e-9)
    for values, expected in zip((found.q, found.v, found.a), way, strict=True):
        np.testing.assert_array_equal(values[: len(expected)], expected)
    np.testing.assert_allclose(np.diff(found.t), 1 / 250)
    np.testing.assert_allclose(found.q[0], POSTURE)
    resting = (found.t > begins - 0.99) & (found.t <= begins)
    assert not found.v[resting].any()
    np.testing.assert_allclose(found.q[resting], np.tile(STRIKE.q_i, (resting.sum(), 1)))
    during = found.t >= begins
    for values, expected in zip((found.q, found.v, found.a), STRIKE.reference(found.t[during] - begins), strict=True):
        np.testing.assert_allclose(values[during], expected, atol=1e-9)
    assert found.t[-1] - begins >= STRIKE.D + 0.2 - 1e-9
    np.testing.assert_allclose(found.q[-1], STRIKE.q_f)
    assert not found.v[-1].any()


def test_velocities_and_accelerations_are_derivatives_of_positions():
    found = trajectory(start=POSTURE, rate=2000)
    inside = slice(2, -2)
    np.testing.assert_allclose(np.gradient(found.q, found.t, axis=0)[inside], found.v[inside], atol=2e-4)
    corner = 60 * 2.4 / STRIKE.D**3 / 2000 / 2  # the jerk jumps where parts meet
    np.testing.assert_allclose(np.gradient(found.v, found.t, axis=0)[inside], found.a[inside], atol=corner)


@pytest.mark.parametrize(
    ("limit", "said"),
    [
        (JointLimits(velocity=6.0), "velocity of shoulder is [+]6.42. rad/s; its limit is 6 rad/s"),
        (JointLimits(acceleration=25.0), "acceleration of shoulder is [-+]28.* rad/s.2; its limit is 25 rad/s.2"),
        (JointLimits(jerk=400.0), "jerk of shoulder is .* rad/s.3; its limit is 400 rad/s.3"),
        (JointLimits((-1.0, 3.0)), r"position of shoulder is -1.200 rad; its limit is -1 to 3 rad"),
    ],
)
def test_what_is_beyond_a_limit_is_told(limit, said):
    """The strike's largest speed is 15/8 span/D, its largest acceleration 10/sqrt(3) span/D^2."""
    largest = 15 / 8 * 2.4 / STRIKE.D
    assert largest == pytest.approx(6.42, abs=0.01)
    assert 10 / math.sqrt(3) * 2.4 / STRIKE.D**2 == pytest.approx(28.2, abs=0.1)
    found = trajectory()
    assert found.beyond((JointLimits(), JointLimits())) is None
    assert found.beyond(()) is None
    limits = (limit, JointLimits())
    assert re.search(said, str(found.beyond(limits)))
    assert re.search(said.replace("rad", "m"), str(found.beyond(limits, slides=(True, False))))


def test_a_robot_judges_differences_of_the_positions():
    """Velocities and accelerations that a file states do not matter to a robot that receives positions only."""
    found = trajectory(rate=1000.0)
    v, a, jerk = found.differences()
    np.testing.assert_allclose(v[1:], (found.v[1:] + found.v[:-1]) / 2, atol=2e-3)
    np.testing.assert_allclose(a[2:], found.a[1:-1], atol=0.2)
    assert np.abs(jerk).max() <= 60 * 2.4 / STRIKE.D**3 + 1e-3
    still = dataclasses.replace(found, v=0 * found.v, a=0 * found.a)
    for limit, said in ((JointLimits(velocity=6.0), "velocity"), (JointLimits(acceleration=25.0), "acceleration"),
                        (JointLimits(jerk=400.0), "jerk")):  # fmt: skip
        assert f"the {said} of shoulder between samples is" in str(still.beyond((limit, JointLimits())))
    jump = dataclasses.replace(found, q=found.q + np.array([1e-3, 0]) * (np.arange(len(found.t)) == 500)[:, None])
    assert "jerk of shoulder between samples" in str(jump.beyond(LIMITS))


def test_a_velocity_is_judged_by_its_position():
    slowed, found = JointLimits((-3, 3), velocity=8.0, deceleration=6.0, velocity_offset=0.3), trajectory()
    left = 3 - found.q[:, 0]
    i = int(np.argmax(found.v[:, 0] - np.sqrt(12 * left) + 0.3))
    said = f"is {found.v[i, 0]:+.3f} rad/s; its limit at this position is -"
    assert said in str(found.beyond((slowed, JointLimits())))
    assert f" to {math.sqrt(12 * left[i]) - 0.3:.3f} rad/s" in str(found.beyond((slowed, JointLimits())))


def test_csv_is_read_back_to_the_last_digit(tmp_path):
    found = trajectory(start=POSTURE)
    found.save_csv(tmp_path / "strike.csv")
    assert (tmp_path / "strike.csv").read_text().startswith("time,position_shoulder,position_elbow,velocity_shoulder,")
    read = JointTrajectory.load_csv(tmp_path / "strike.csv")
    assert read.joints == JOINTS
    for name in ("t", "q", "v", "a"):
        np.testing.assert_array_equal(getattr(read, name), getattr(found, name))


def of_controller(goal: dict, t: float) -> np.ndarray:
    """Positions that ROS 2's joint_trajectory_controller commands at a time, by the formula of its trajectory.cpp."""
    points = goal["points"]
    at = [p["time_from_start"]["sec"] + 1e-9 * p["time_from_start"]["nanosec"] for p in points]
    i = min(int(np.searchsorted(at, t, side="right")) - 1, len(points) - 2)
    p0, v0, a0 = (np.array(points[i][x]) for x in ("positions", "velocities", "accelerations"))
    p1, v1, a1 = (np.array(points[i + 1][x]) for x in ("positions", "velocities", "accelerations"))
    T, s = at[i + 1] - at[i], t - at[i]
    c3 = (-20 * p0 + 20 * p1 - 3 * a0 * T**2 + a1 * T**2 - 12 * v0 * T - 8 * v1 * T) / (2 * T**3)
    c4 = (30 * p0 - 30 * p1 + 3 * a0 * T**2 - 2 * a1 * T**2 + 16 * v0 * T + 14 * v1 * T) / (2 * T**4)
    c5 = (-12 * p0 + 12 * p1 - a0 * T**2 + a1 * T**2 - 6 * v0 * T - 6 * v1 * T) / (2 * T**5)
    return p0 + v0 * s + a0 / 2 * s**2 + c3 * s**3 + c4 * s**4 + c5 * s**5


LONGEST_ARGUMENT = 128 * 1024  # bytes of an argument of a command in Linux (MAX_ARG_STRLEN)


@pytest.mark.parametrize("space", ["joints", "pose"])
def test_a_controller_makes_the_whole_movement_of_a_goal_that_fits_an_argument(space, tmp_path):
    """A strike at 1000 Hz and one of the hand's pose at 500 Hz; between the few points by the controller's splines."""
    if space == "joints":
        found = trajectory(start=POSTURE, rate=1000, rest=3.0, sway=1.7)
    else:
        _, hand, vector = of_hand("ur5e", orientation=True)
        arm, start = preset("ur5e").arm, (hand.kinematics.posture + 0.1).tolist()
        found = JointTrajectory.of_strike(hand.path(vector), arm.names, start=start, rate=500)
    found.save_goal(tmp_path / "goal.yaml")
    text = (tmp_path / "goal.yaml").read_text()
    assert len(text.encode()) < LONGEST_ARGUMENT / 8
    goal = yaml.safe_load(text)["trajectory"]
    commanded = np.array([of_controller(goal, t) for t in found.t])
    assert np.abs(commanded - found.q).max() < 1.1e-6
    step = found.t[1]
    jerk, of_found = (np.diff(q, 3, axis=0) / step**3 for q in (commanded, found.q))
    assert np.abs(jerk).max() < 1.2 * np.abs(of_found).max()


def test_a_goal_has_the_fields_of_ros(tmp_path):
    found = trajectory(rest=0.5)
    found.save_goal(tmp_path / "strike.yaml")
    goal = yaml.safe_load((tmp_path / "strike.yaml").read_text())["trajectory"]
    assert goal["joint_names"] == list(JOINTS)
    points, few = goal["points"], found.for_splines()
    assert len(points) == len(few.t) < 12
    seconds = [p["time_from_start"]["sec"] + 1e-9 * p["time_from_start"]["nanosec"] for p in points]
    np.testing.assert_allclose(seconds, few.t, atol=1e-9)
    assert all(isinstance(p["time_from_start"]["nanosec"], int) for p in points)
    for field, values in (("positions", few.q), ("velocities", few.v), ("accelerations", few.a)):
        np.testing.assert_array_equal([p[field] for p in points], values)


@pytest.mark.parametrize("text", ["", "time,position_a\n0,1\n", "t,q\n0,1\n1,2\n", "a,b\n\x00"])
def test_what_is_no_trajectory_gets_one_line(text, tmp_path):
    path = tmp_path / "no.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=r"^trajectory: got "):
        JointTrajectory.load_csv(path)
    with pytest.raises(InputError, match=r"^trajectory: got "):
        JointTrajectory.load_csv(tmp_path / "none.csv")


def test_bad_arguments_are_named():
    with pytest.raises(InputError, match=r"^joints: got .*the names of 2 joints"):
        JointTrajectory.of_strike(STRIKE, ("shoulder",))
    with pytest.raises(InputError, match=r"^start posture: got .*2 finite numbers"):
        trajectory(start=(0.0,))
    with pytest.raises(InputError, match=r"^rate"):
        trajectory(rate=0)
    flat = np.zeros((3, 2))
    with pytest.raises(InputError, match="increasing from 0"):
        JointTrajectory(JOINTS, np.array([0.0, 1.0, 1.0]), flat, flat, flat)


def of_hand(name: str, *, orientation: bool = False) -> tuple[JointTrajectory, HandSpace, np.ndarray]:
    """A strike of the hand near a model's home posture, as a trajectory from a posture nearby."""
    arm = preset(name).arm
    space = HandSpace(arm, orientation=orientation)
    home = space.kinematics.coordinates(space.kinematics.posture)
    by = np.array([-0.06, 0.05, 0.04, 0.2, -0.1, 0.15] if orientation else [-0.06, 0.05, 0.04])[: space.size]
    vector = np.array([*(home + by), *(home - by), 0.6])
    start = (space.kinematics.posture + 0.1).tolist()
    found = JointTrajectory.of_strike(space.path(vector), arm.joints, start=start, rate=100, rest=0.2)
    return found, space, vector


@pytest.mark.parametrize(("name", "orientation"), [("lemon2024", False), ("panda", False), ("ur5e", True)])
def test_a_strike_of_the_hand_holds_the_hands_poses(name, orientation):
    """Where Pinocchio has the hand in each of the postures, and where the strike's numbers have it at the ends."""
    found, space, vector = of_hand(name, orientation=orientation)
    assert found.hand is not None
    arm = Arm(preset(name))
    at = [arm.hand(q) for q in found.q]
    np.testing.assert_allclose(found.hand[:, :3], [x.position for x in at], atol=1e-12)
    rotations = Rotation.from_quat(found.hand[:, 3:])
    np.testing.assert_allclose(rotations.as_matrix(), [x.rotation for x in at], atol=1e-12)
    begins, seen = int(np.searchsorted(found.t, found.strike_begins)), [0, 2] if space.arm.dimension == 2 else [0, 1, 2]
    for k, part in ((begins, slice(0, space.size)), (-1, slice(space.size, 2 * space.size))):
        coordinates = vector[part]
        np.testing.assert_allclose(found.hand[k, seen], coordinates[: len(seen)], atol=1e-7)
        if orientation:
            turned = Rotation.from_rotvec(coordinates[3:]).as_matrix() @ space.kinematics.upright
            np.testing.assert_allclose(rotations[k].as_matrix(), turned, atol=1e-7)


def test_quaternions_of_a_turning_hand_do_not_jump():
    arm = preset("panda").arm
    q = np.zeros((200, 7))
    q[:, 6] = np.linspace(0, 9.0, 200)  # one and a half turns
    poses = hand_poses(HandKinematics(arm, q[0], orientation=True), q)
    np.testing.assert_allclose(np.linalg.norm(np.diff(poses[:, 3:], axis=0), axis=1), 9.0 / 199 / 2, rtol=1e-3)


def test_poses_are_read_back_from_csv_to_the_last_digit(tmp_path):
    found = of_hand("ur5e", orientation=True)[0]
    found.save_csv(tmp_path / "strike.csv")
    read = JointTrajectory.load_csv(tmp_path / "strike.csv")
    header = (tmp_path / "strike.csv").read_text().splitlines()[0].split(",")
    assert header[-7:] == ["hand_x", "hand_y", "hand_z", "hand_qx", "hand_qy", "hand_qz", "hand_qw"]
    for name in ("t", "q", "v", "a", "hand"):
        np.testing.assert_array_equal(getattr(read, name), getattr(found, name))
    damaged = (tmp_path / "strike.csv").read_text().replace("hand_qw", "hand_w")
    (tmp_path / "strike.csv").write_text(damaged)
    with pytest.raises(InputError, match="the columns time"):
        JointTrajectory.load_csv(tmp_path / "strike.csv")


def test_a_hands_poses_have_the_fields_of_ros(tmp_path):
    found = of_hand("ur5e", orientation=True)[0]
    found.save_hand(tmp_path / "hand.yaml")
    message = yaml.safe_load((tmp_path / "hand.yaml").read_text())
    assert message["joint_names"] == ["hand"]
    read = [
        [*(p["transforms"][0]["translation"][x] for x in "xyz"), *(p["transforms"][0]["rotation"][x] for x in "xyzw")]
        for p in message["points"]
    ]
    np.testing.assert_array_equal(read, found.hand)
    seconds = [p["time_from_start"]["sec"] + 1e-9 * p["time_from_start"]["nanosec"] for p in message["points"]]
    np.testing.assert_allclose(seconds, found.t, atol=1e-9)
    found.save_goal(tmp_path / "strike.yaml")
    assert set(yaml.safe_load((tmp_path / "strike.yaml").read_text())) == {"trajectory"}


def test_poses_of_no_unit_quaternion_are_refused():
    flat = np.zeros((3, 2))
    with pytest.raises(InputError, match="unit quaternions"):
        JointTrajectory(JOINTS, np.arange(3.0), flat, flat, flat, np.zeros((3, 7)))
    with pytest.raises(InputError, match=r"trajectory's hand: got .*\(3, 7\)"):
        JointTrajectory(JOINTS, np.arange(3.0), flat, flat, flat, np.ones((3, 6)))


def turning(first: Rotation, by: np.ndarray, count: int = 50) -> np.ndarray:
    """Poses of a hand that turns by a rotation vector and moves along."""
    way = Slerp([0, 1], Rotation.concatenate([first, Rotation.from_rotvec(by) * first]))(np.linspace(0, 1, count))
    places = np.linspace([0.1, -0.2, 0.3], [0.5, 0.4, -0.1], count)
    return np.hstack([places, way.as_quat()])


@pytest.mark.parametrize("seed", range(8))
def test_the_joints_hold_the_hand_where_it_was_seen(seed):
    """Whichever way it points, and while it turns by 100 degrees; quaternions may change their sign."""
    rng = np.random.default_rng(seed)
    axis = rng.normal(size=3)
    poses = turning(Rotation.random(rng=rng), np.deg2rad(100) * axis / np.linalg.norm(axis))
    poses[::3, 3:] *= -1
    arm, joints = hand_joints(poses)
    hand = arm_frames(arm, joints)[-1]
    np.testing.assert_allclose(hand.origin, poses[:, :3], atol=1e-12)
    np.testing.assert_allclose(hand.rotation, Rotation.from_quat(poses[:, 3:]).as_matrix(), atol=1e-12)
    assert np.abs(np.diff(joints, axis=0)).max() < 0.3


def test_a_hand_that_turns_all_ways_is_refused():
    poses = np.hstack([np.zeros((200, 3)), Rotation.random(200, rng=np.random.default_rng(0)).as_quat()])
    with pytest.raises(InputError, match="middle Euler angle"):
        hand_joints(poses)


def test_no_warning_of_gimbal_lock_is_given_for_orientations_that_are_not_taken():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        hand_joints(turning(Rotation.identity(), [0.3, 0.0, 0.0]))


@pytest.mark.parametrize("kind", [bool, complex, str])
def test_what_are_no_real_numbers_is_refused_in_a_trajectory(kind):
    t, rest = np.arange(4) / 10, np.zeros((4, 2))
    for name in ("q", "v", "a"):
        parts = {"q": rest, "v": rest, "a": rest} | {name: rest.astype(kind)}
        with pytest.raises(InputError, match=rf"trajectory's {name}: got .*numbers"):
            JointTrajectory(("a", "b"), t, **parts)
