"""Clock and frame of tracks against a robot's logs: what is found is written into the sidecar, and then all agree."""

from __future__ import annotations

import re
import tomllib

import numpy as np
import pytest
from robot_log_files import EPOCH, BagWriter, write_table
from scipy.spatial.transform import Rotation

from whiptool.errors import InputError
from whiptool.identification.inputs import opened
from whiptool.impedance.controller import Controller
from whiptool.impedance.laws import PositionControl
from whiptool.models import preset
from whiptool.models.kinematics import arm_poses, joint_points
from whiptool.models.pose_columns import POSE
from whiptool.models.strike import Strike, default_bounds
from whiptool.recording.compared import compared
from whiptool.recording.finding import Finding
from whiptool.recording.understood import understand
from whiptool.rollout.compiled import CompiledRollout

ARM = preset("ur5e").arm
LATE, ORIGIN = 0.35, np.array([150.0, -40.0, 900.0])  # [s] of the frames' clock, [mm]


def joints(t: np.ndarray) -> np.ndarray:
    """A smooth motion of all joints after 0.3 s of rest [rad], (T, 6)."""
    s = np.clip(t - 0.3, 0, None)[:, None]
    away = (1 - np.cos(s * np.array([2.0, 3.0, 4.0, 2.5, 3.5, 1.5]))) / 2
    return np.array([0.1, -1.9, 1.2, -0.9, 0.3, 0.0]) + away * np.array([0.8, 0.9, -1.1, 0.5, 0.7, 0.4])


def in_file(places: np.ndarray) -> np.ndarray:
    """Places of the base's axes (x forward, y left, z up) as a motion capture system has them: mm, y up."""
    return 1e3 * np.stack([places[..., 0], places[..., 2], -places[..., 1]], -1) + ORIGIN


def write(folder, *, markers=("handle", "tip"), rate: float = 1.0) -> None:
    """Tracks at 120 a second from motion capture, and a log of the robot at 500 by the computer's clock."""
    t, logged = np.arange(0, 3, 1 / 120), np.arange(-0.5, 3.5, 1 / 500)
    origins, rotations = arm_poses(ARM, joints(t))
    hand = origins[:, -1] + rotations[:, -1] @ [0.01, 0.02, -0.02]
    tip = hand - [0, 0, 0.8]
    named = [f"{m}_{x}" for m in markers for x in "xyz"]
    places = {"handle": hand, "tip": tip}
    table = np.hstack([in_file(places[m]) for m in markers])
    table += np.random.default_rng(0).normal(size=table.shape)  # 1 mm
    write_table(folder / "take.csv", ["t", *named], np.column_stack([LATE + rate * t, table]))
    names = [f"position_{x}" for x in ARM.joints]
    write_table(folder / "robot.csv", ["t", *names], np.column_stack([EPOCH + logged, joints(logged)]))
    (folder / "take.toml").write_text('units = "mm"\nsigma = 0.001\n')


def found(folder, *more: str) -> list[Finding]:
    files = [understand(str(folder / name)) for name in ("take.csv", *more)]
    return list(compared(files, ARM)[0].findings)


def of(findings: list[Finding], topic: str) -> Finding:
    return next(f for f in reversed(findings) if f.topic == topic)


def test_what_is_advised_makes_clock_and_frame_agree(tmp_path):
    write(tmp_path)
    first = found(tmp_path, str(tmp_path / "robot.csv"))
    offset = of(first, "offset")
    assert offset.certainty == "doubtful"
    assert offset.numbers["offset"] == pytest.approx(LATE - EPOCH, abs=1e-3, rel=0)
    assert of(first, "up").fix.startswith("as for a model in the plane")
    assert of(first, "frame").numbers["axes"] == ["x", "-z", "y"]
    advised = [re.search(r"(\w+) = (\[.*?\]|[-\d.]+)", of(first, topic).fix) for topic in ("offset", "frame", "origin")]
    said = "".join(f"{match[1]} = {match[2]}\n" for match in advised if match)
    side = tmp_path / "take.toml"
    side.write_text(side.read_text() + said + 'joints = "robot.csv"\n')
    table = tomllib.loads(side.read_text())
    assert set(table) == {"units", "sigma", "joints_start", "axes", "origin", "joints"}
    np.testing.assert_allclose(table["origin"], ORIGIN, atol=30)  # the marker is some cm from the hand
    again = found(tmp_path)
    assert {
        f.topic: f.certainty for f in again if f.topic in ("offset", "frame", "scale", "clock rate")
    } == dict.fromkeys(("offset", "frame", "scale", "clock rate"), "measured")
    assert "z is up" in of(again, "up").value
    assert abs(of(again, "offset").numbers["offset"]) < 1e-3


def test_logs_of_another_clock_are_shown_before_they_can_be_read(tmp_path):
    """A recording that readers refuse, for frames and joints do not overlap."""
    write(tmp_path)
    (tmp_path / "take.toml").write_text('units = "mm"\njoints = "robot.csv"\n')
    findings = found(tmp_path)
    assert "another clock" in of(findings, "clocks").value
    assert of(findings, "offset").numbers["start"] == pytest.approx(EPOCH - LATE, abs=1e-3, rel=0)


def write_moving_bag(path, late: float) -> None:
    """The handle, and the hand by a clock that is `late` seconds ahead, in one bag."""
    with BagWriter(path) as bag:
        for t in np.arange(0, 3, 1 / 120):
            origins, rotations = arm_poses(ARM, joints(np.array([t])))
            row, stamp = [*origins[0, -1], *Rotation.from_matrix(rotations[0, -1]).as_quat()], EPOCH + t
            marker = bag.make("geometry_msgs/msg/PoseStamped", bag.header(stamp), bag.pose(row))
            bag.write("/vrpn/handle/pose", stamp, marker)
            hand = bag.make("geometry_msgs/msg/PoseStamped", bag.header(stamp + late), bag.pose(row))
            bag.write("/hand", stamp, hand)


@pytest.mark.parametrize(
    ("name", "sidecar", "late"),
    [("a.bag", "a.toml", 0.25), ("a.bag", "a.toml", 40.0 - EPOCH), ("a_mcap", "a_mcap/whiptool.toml", 0.25)],
)
def test_the_advice_on_a_bags_own_logs_is_by_their_clock(tmp_path, name, sidecar, late):
    """Without `start` frames begin at 0; the second hand's clock counts since its computer was started."""
    pytest.importorskip("rosbags")
    write_moving_bag(tmp_path / name, late)
    bag, sidecar = str(tmp_path / name), tmp_path / sidecar
    side = 'hand_topic = "/hand"\nmarkers = {handle = "/vrpn/handle/pose"}\n'
    sidecar.write_text(side)
    first = of(list(compared([understand(bag)])[0].findings), "offset")
    assert first.certainty == "doubtful"
    assert first.numbers["start"] == pytest.approx(EPOCH + late, abs=2e-3, rel=0)
    advised = re.search(r"hand_start = [-\d.]+", first.fix)
    sidecar.write_text(side + (advised[0] if advised else ""))
    again = of(list(compared([understand(bag)])[0].findings), "offset")
    assert again.certainty == "measured"
    assert abs(again.numbers["offset"]) < 1e-3


def test_a_bag_whose_only_poses_may_be_a_markers_asks_for_the_markers(tmp_path):
    """They are not stated to be the hand's, and what to write is what `identify` says, too."""
    pytest.importorskip("rosbags")
    with BagWriter(tmp_path / "a.bag") as bag:
        for t in np.arange(5) / 100:
            message = bag.make("geometry_msgs/msg/PoseStamped", bag.header(EPOCH + t), bag.pose([t, 0, 0, 0, 0, 0, 1]))
            bag.write("/vrpn/whip/pose", EPOCH + t, message)
    findings = understand(str(tmp_path / "a.bag")).findings
    assert of(findings, "hand").certainty == "assumed"
    assert "of a marker say markers" in of(findings, "hand").reason
    fix = 'say in a.toml which topics are markers, as markers = {tip = "/TOPIC"}'
    assert fix in of(findings, "tracks").fix
    with pytest.raises(InputError, match=re.escape(fix)):
        opened(str(tmp_path / "a.bag"))


def test_a_clock_that_runs_fast_is_seen(tmp_path):
    write(tmp_path, rate=1.01)
    rate = of(found(tmp_path, str(tmp_path / "robot.csv")), "clock rate")
    assert rate.certainty == "doubtful"
    assert rate.numbers["rate"] == pytest.approx(1.01, abs=3 * rate.numbers["error"] + 1e-3)


def test_without_the_handle_the_beginnings_of_the_motion_tell_the_offset_roughly(tmp_path):
    write(tmp_path, markers=("tip",))
    offset = of(found(tmp_path, str(tmp_path / "robot.csv")), "offset")
    assert offset.numbers["offset"] == pytest.approx(LATE - EPOCH, abs=0.3, rel=0)
    assert "within 0.3 s" in offset.value


def test_the_rough_offset_is_as_near_as_it_says_for_whips(tmp_path):
    """Of simulated strikes with a rope at a UR5e, whose frames and poses have one clock, by the tip alone."""
    model = preset("ur5e")
    rollout = CompiledRollout(model, Controller(PositionControl()))
    for i, vector in enumerate(default_bounds(model.arm).sample(np.random.default_rng(0), 6)):
        path = rollout.trajectory(Strike.from_vector(vector), t_stay=0.5)
        t = np.arange(-0.5, path.t[-1], 1 / 200)
        sampled = lambda x: np.stack([np.interp(t, path.t, column) for column in x.T], 1)  # noqa: E731, B023
        hand = sampled(joint_points(model, path.q)[:, model.arm.n])
        file, log = tmp_path / f"take{i}.csv", tmp_path / f"hand{i}.csv"
        write_table(file, ["t", "tip_x", "tip_y", "tip_z"], np.column_stack([t, sampled(path.tip)]))
        write_table(log, ["t", *POSE], np.column_stack([t, hand, np.zeros((len(t), 3)), np.ones(len(t))]))
        offset = of(list(compared([understand(str(file)), understand(str(log))])[0].findings), "offset")
        assert abs(offset.numbers["offset"]) < offset.numbers["error"] == 0.3
        assert offset.certainty == "measured"


def test_joints_need_the_arm_and_another_arm_is_refused(tmp_path):
    write(tmp_path)
    files = [understand(str(tmp_path / name)) for name in ("take.csv", "robot.csv")]
    assert "give --model" in compared(files)[0].findings[-1].fix
    other = compared(files, preset("panda").arm)[0].findings[-1]
    assert other.certainty == "doubtful"
    assert "not compared" in other.value


def test_two_systems_of_cameras_are_compared_by_their_markers(tmp_path):
    """The second is late by 20 ms, at another rate of frames, and in other axes."""
    t = np.arange(0, 1.5, 1 / 240)
    path = lambda t: np.stack([np.sin(3 * t), 0.5 * np.cos(2 * t), 0.4 * np.sin(5 * t)], 1)  # noqa: E731
    turned = path(t[::4]) @ Rotation.from_euler("z", 1.0).as_matrix() + np.array([0.5, 0, 0])
    write_table(tmp_path / "a.csv", ["t", "tip_x", "tip_y", "tip_z"], np.column_stack([t, path(t)]))
    write_table(tmp_path / "b.csv", ["t", "tip_x", "tip_y", "tip_z"], np.column_stack([t[::4] + 0.02, turned]))
    files = compared([understand(str(tmp_path / name)) for name in ("a.csv", "b.csv")])
    offset = of(list(files[1].findings), "offset")
    assert offset.numbers["offset"] == pytest.approx(-0.02, abs=1e-4)
    assert "say start = 0.02" in offset.fix
    assert [of(list(one.findings), "rate").numbers["rate"] for one in files] == pytest.approx([240, 60])


@pytest.mark.parametrize("columns", [("shoulder", "elbow"), ("elbow", "shoulder")])
def test_joints_that_are_logged_against_the_vertical_are_named_and_no_other_correction_is_offered(columns, tmp_path):
    """Scale, axes and clock can be turned so that even these angles nearly fit; the differences fit to the noise."""
    arm, strike = preset("lemon2024").arm, Strike((-1.36, 0.47), (1.73, 1.41), 0.95)
    t = np.arange(0, 1.3, 0.01)
    q = np.array([strike.reference(min(float(x), 0.95))[0] for x in t])
    upright = q.cumsum(axis=1)
    hand = np.stack([np.sin(upright) @ arm.lengths, -np.cos(upright) @ arm.lengths], axis=1)
    hand += np.random.default_rng(0).normal(scale=5e-4, size=hand.shape)
    write_table(tmp_path / "a.csv", ["t", "handle_x", "handle_y"], np.column_stack([t, hand]))
    said = {}
    for name, logged in (("right", q), ("vertical", upright)):
        order = [("shoulder", "elbow").index(x) for x in columns]
        write_table(tmp_path / f"{name}.csv", ["t", *columns], np.column_stack([t, logged[:, order]]))
        (one,) = compared([understand(str(tmp_path / "a.csv"), joints=tmp_path / f"{name}.csv")], arm)
        said[name] = {finding.topic: finding for finding in one.findings}
    doubt = said["vertical"]["joints"]
    assert (doubt.certainty, "against the vertical" in doubt.value) == ("doubtful", True)
    assert not {"scale", "offset", "clock rate", "frame"} & said["vertical"].keys()
    assert said["right"]["joints"].certainty != "doubtful"
    assert said["right"]["scale"].certainty == "measured"
