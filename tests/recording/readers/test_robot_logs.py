"""Logs of joints and of the hand: one motion gives the same numbers through all formats."""

from __future__ import annotations

import time

import numpy as np
import pytest
import tomli_w
from recordings import FPS, fuzz, plain_rows, write_rows
from robot_log_files import (
    EPOCH,
    JOINTS,
    BagWriter,
    S,
    angles,
    log_times,
    poses,
    write_lerobot_2,
    write_libfranka,
    write_rtde,
    write_states,
    write_table,
)
from scipy.spatial.transform import Rotation

from whiptool.errors import InputError
from whiptool.recording.mcap_file import write_recorded_mcap
from whiptool.recording.readers import bag_logs, open_any, read_recording
from whiptool.recording.readers.bag_logs import bag_hand, bag_joints
from whiptool.recording.readers.joint_log import Logs, read_joint_log
from whiptool.recording.strike_recording import StrikeRecording

needs_rosbags = pytest.mark.usefixtures("_rosbags")


@pytest.fixture
def _rosbags():
    pytest.importorskip("rosbags")


def own(path) -> None:
    write_table(path, ["t", *(f"position_{x}" for x in JOINTS)], np.column_stack([EPOCH + log_times(), angles()]))


def by_degrees(path) -> None:
    names = [f"/arm/{x}/position [deg]" for x in JOINTS]
    write_table(path, ["time [ms]", *names], np.column_stack([1e3 * (EPOCH + log_times()), np.degrees(angles())]))


def old_lerobot(folder) -> None:
    names = [f"main_{x.removesuffix('_joint')}" for x in JOINTS]
    write_lerobot_2(folder, names=names, state=np.degrees(angles()), version="v2.0")


FORMATS = {
    # of each file: its writer, when the motion begins by its clock [s], and how exact it is [rad]
    "own.csv": (own, EPOCH, 0.0),
    "degrees.csv": (by_degrees, EPOCH, 1e-15),
    "rtde.csv": (write_rtde, EPOCH, 0.0),
    "client.txt": (lambda path: write_rtde(path, " "), EPOCH, 0.0),
    "franka.csv": (write_libfranka, 5.0, 1e-9),
    "franka.log": (lambda path: write_libfranka(path, ""), 5.0, 1e-9),
    "one.bag": (write_states, EPOCH, 0.0),
    "two_db3": (write_states, EPOCH, 0.0),
    "two_mcap": (write_states, EPOCH, 0.0),
    "lerobot#1": (None, 0.0, 1e-6),
}


@pytest.mark.parametrize("name", FORMATS)
def test_one_motion_gives_the_same_numbers_through_all_formats(tmp_path, name):
    """Joints that a file calls by the robot's names are found in any order; numbered ones are in the robot's order."""
    write, start, exact = FORMATS[name]
    if write is None:
        pytest.importorskip("pyarrow")
        old_lerobot(tmp_path / "lerobot")
    else:
        if "csv" not in name and "franka" not in name and "client" not in name:
            pytest.importorskip("rosbags")
        write(tmp_path / name)
    write_rows(tmp_path / "a.csv", plain_rows())
    columns = {"joint_columns": {x: f"state.q[{i}]" for i, x in enumerate(JOINTS)}} if "franka" in name else {}
    side = {"joints": name, "joints_start": start, **columns}
    (tmp_path / "a.toml").write_text(tomli_w.dumps(side))
    read = read_recording(tmp_path / "a.csv").ordered(JOINTS)
    np.testing.assert_allclose(read.joints_q, angles(), rtol=0, atol=exact)
    np.testing.assert_allclose(read.joints_t, log_times(), atol=3e-7)
    assert any("taken as rad" in note for note in read.notes) == (name == "own.csv")  # where nothing says it


def test_seven_joints_of_libfranka_are_in_the_arms_order_without_a_word_of_the_user(tmp_path):
    write_libfranka(tmp_path / "a.csv")
    log = read_joint_log(tmp_path / "a.csv")
    assert (log.q.shape, log.names, log.unit) == ((S, 7), (), "rad")
    np.testing.assert_allclose(log.q[:, 6], angles()[:, 0], atol=1e-9)
    np.testing.assert_allclose(log.t, 5 + log_times())
    assert any("libfranka" in note and "[ms]" in note for note in log.notes)


@pytest.mark.slow
def test_the_recorder_of_ur_rtde_is_read(tmp_path):
    """A file that the library's own recorder wrote, of an emulated robot at rest."""
    receive = pytest.importorskip("rtde_receive")
    from ur_robot import HOME, own_host

    from whiptool.rig.ur_emulator import UrEmulator, UrOptions

    file = tmp_path / "ur.csv"
    with UrEmulator(UrOptions(own_host())) as robot:
        client = receive.RTDEReceiveInterface(robot.host, 500.0, ["timestamp", "actual_q", "target_q"])
        client.startFileRecording(str(file), ["timestamp", "target_q", "actual_q"])
        time.sleep(0.2)
        client.stopFileRecording()
        client.disconnect()
    logs = open_any(str(file))
    assert isinstance(logs, Logs)
    assert logs.joints is not None
    np.testing.assert_allclose(logs.joints.q, np.tile(HOME, (len(logs.joints.t), 1)), atol=1e-6)
    assert np.median(np.diff(logs.joints.t)) < 0.1


@needs_rosbags
@pytest.mark.parametrize("name", ["a.bag", "b_db3", "c_mcap"])
def test_a_grippers_messages_are_left_out_with_a_word(tmp_path, name):
    write_states(tmp_path / name)
    log = bag_joints(tmp_path / name)
    assert log.names == tuple(sorted(JOINTS))
    assert any("left out 12 messages, which are of finger_joint" in note for note in log.notes)
    with pytest.raises(InputError, match=r"joints_topic: got '/else'; allowed: one of the topics of JointState"):
        bag_joints(tmp_path / name, "/else")


def write_moved(path, *, stray: bool = False) -> None:
    """The tool as poses of three kinds, and as `tf` through a fixed frame and one that moves at other times."""
    half = Rotation.from_euler("z", np.pi / 2).as_quat()
    with BagWriter(path) as bag:
        for t, row in zip(EPOCH + log_times(), poses(), strict=True):
            header = bag.header(t)
            bag.write("/tool/pose", t, bag.make("geometry_msgs/msg/PoseStamped", header, bag.pose(row)))
            bag.write("/vicon/tool", t, bag.transform(t, "world", "tool", row))
            several = [bag.pose(row), bag.pose([1, 2, 3, 0, 0, 0, 1])]
            bag.write("/bodies", t, bag.make("geometry_msgs/msg/PoseArray", header, several))
            frames = [bag.transform(t, "mount", "wrist", row)]
            frames += [] if stray else [bag.transform(t, "base_link", "mount", [0, 0, 1, *half])]
            bag.write("/tf", t, bag.make("tf2_msgs/msg/TFMessage", frames))
        fixed = bag.transform(EPOCH, "wrist", "tool0", [0, 0, 0.1, 0, 0, 0, 1])
        bag.write("/tf_static", EPOCH, bag.make("tf2_msgs/msg/TFMessage", [fixed]))


@needs_rosbags
@pytest.mark.parametrize("name", ["a.bag", "b_db3", "c_mcap"])
@pytest.mark.parametrize("topic", ["/tool/pose", "/vicon/tool", "/bodies"])
def test_poses_of_all_kinds_are_the_hand(tmp_path, name, topic):
    write_moved(tmp_path / name)
    log = bag_hand(tmp_path / name, topic)
    np.testing.assert_allclose(log.q, poses(), atol=1e-15)
    np.testing.assert_allclose(log.t - EPOCH, log_times(), atol=3e-7)
    with pytest.raises(InputError, match="hand_topic"):
        bag_hand(tmp_path / name)


@needs_rosbags
def test_tf_is_followed_from_the_base_to_the_tool(tmp_path):
    write_moved(tmp_path / "a.bag")
    log = bag_hand(tmp_path / "a.bag", frames=["base_link", "tool0"])
    turned = Rotation.from_quat(poses()[:, 3:])
    place = poses()[:, :3] + turned.apply([0, 0, 0.1])
    np.testing.assert_allclose(log.q[:, :3], np.column_stack([-place[:, 1], place[:, 0], 1 + place[:, 2]]), atol=1e-12)
    same = Rotation.from_quat(log.q[:, 3:]).inv() * (Rotation.from_euler("z", np.pi / 2) * turned)
    np.testing.assert_allclose(same.magnitude(), 0, atol=1e-7)
    write_moved(tmp_path / "b.bag", stray=True)
    with pytest.raises(InputError, match="two frames, the first before the second: mount, tool0, wrist"):
        bag_hand(tmp_path / "b.bag", frames=["base_link", "tool0"])


@needs_rosbags
def test_a_tools_frame_becomes_the_hands(tmp_path):
    """The whip goes on along the tool's z, 0.3 m in front of it."""
    write_moved(tmp_path / "robot.bag")
    write_rows(tmp_path / "a.csv", plain_rows(d=3))
    side = {"hand": "robot.bag", "hand_topic": "/tool/pose", "hand_start": EPOCH}
    (tmp_path / "a.toml").write_text(
        tomli_w.dumps({**side, "hand_axes": ["x", "-y", "-z"], "hand_offset": [0, 0, 0.3]})
    )
    hand = read_recording(tmp_path / "a.csv").hand_pose
    tool, held = Rotation.from_quat(poses()[:, 3:]), Rotation.from_quat(hand[:, 3:])
    np.testing.assert_allclose(hand[:, :3], poses()[:, :3] + tool.apply([0, 0, 0.3]), atol=1e-12)
    np.testing.assert_allclose(held.apply([0, 0, -1]), tool.apply([0, 0, 1]), atol=1e-12)
    (tmp_path / "a.toml").write_text(tomli_w.dumps(side))
    assert any("hand_axes" in note for note in read_recording(tmp_path / "a.csv").notes)
    (tmp_path / "a.toml").write_text(tomli_w.dumps({**side, "hand_axes": ["x", "y", "-z"]}))
    with pytest.raises(InputError, match="right-handed"):
        read_recording(tmp_path / "a.csv")


@needs_rosbags
@pytest.mark.parametrize("name", ["a.bag", "b_db3", "c_mcap"])
def test_motion_capture_that_ros_published_is_tracks(tmp_path, name):
    """Rigid bodies at two rates; the joints and the hand are in the same bag, on the same clock."""
    rows = poses()
    with BagWriter(tmp_path / name) as bag:
        for k, (t, row, q) in enumerate(zip(EPOCH + log_times(), rows, angles(), strict=True)):
            bag.write("/joint_states", t, bag.state(t, JOINTS, q))
            pose = bag.make("geometry_msgs/msg/PoseStamped", bag.header(t, "world"), bag.pose(row))
            bag.write("/vrpn/Whip tip/pose", t, pose)
            if k % 2 == 0:
                both = [bag.pose(row + 1), bag.pose(row + 2)]
                bag.write("/markers", t, bag.make("geometry_msgs/msg/PoseArray", bag.header(t, "world"), both))
    markers = {"tip": "/vrpn/Whip tip/pose", "handle": "/markers[1]"}
    read = read_recording(tmp_path / name, markers=markers, start=EPOCH + 0.1)
    np.testing.assert_allclose(read.t, log_times() - 0.1, atol=3e-7)
    np.testing.assert_allclose(read.marker("tip"), rows[:, :3])
    np.testing.assert_allclose(read.marker("handle")[::2], rows[::2, :3] + 2)
    assert np.isnan(read.marker("handle")[1::2]).all()
    np.testing.assert_allclose(read.joints_t, log_times() - 0.1, atol=3e-7)
    np.testing.assert_array_equal(read.ordered(JOINTS).joints_q, angles())
    assert read.up == "z"
    assert read_recording(tmp_path / name, markers=markers).t[0] == 0
    with pytest.raises(InputError, match=r"markers: got '/markers'; allowed: one of the topics .*/markers\[0\]"):
        read_recording(tmp_path / name, markers={"tip": "/markers"})
    logs = open_any(str(tmp_path / name))
    assert isinstance(logs, Logs)  # without names of markers there are only logs


def write_markers(path, late: float, behind: float = 0.0) -> None:
    """Two markers in one array and one of another computer, whose stamps differ by `late` seconds and which writes
    `behind` seconds later.
    """
    with BagWriter(path) as bag:
        for t, row in zip(EPOCH + log_times(), poses(), strict=True):
            both = [bag.pose(row), bag.pose(row + 1)]
            bag.write("/whip", t, bag.make("geometry_msgs/msg/PoseArray", bag.header(t, "world"), both))
            third = bag.make("geometry_msgs/msg/PoseStamped", bag.header(t + late, "world"), bag.pose(row + 2))
            bag.write("/tracker/node3", t + behind, third)


WHIP = {"tip": "/whip[0]", "handle": "/whip[1]", "node3": "/tracker/node3"}


@needs_rosbags
def test_markers_of_two_computers_clocks_are_by_the_clock_of_the_bag(tmp_path):
    write_markers(tmp_path / "a.bag", 12.5 - EPOCH)
    read = read_recording(tmp_path / "a.bag", markers=WHIP)
    np.testing.assert_allclose(read.t, log_times(), atol=1e-6)
    assert read.seen.all()
    for i, name in enumerate(WHIP):
        np.testing.assert_array_equal(read.marker(name), (poses() + i)[:, :3])
    said = "the times at which the bag was written; not by the messages' header stamps: those of the markers' topics"
    assert any(f"{said} are 1.7326e+09 s apart" in note for note in read.notes)


@needs_rosbags
def test_topics_that_are_written_after_other_delays_are_said(tmp_path):
    write_markers(tmp_path / "a.bag", 0.0, behind=0.2)
    read = read_recording(tmp_path / "a.bag", markers=WHIP)
    assert read.seen.all()
    assert any("messages of /tracker/node3 were written 0.200 s longer after their stamps" in x for x in read.notes)
    write_markers(tmp_path / "b.bag", 0.0)
    assert not any("longer" in x for x in read_recording(tmp_path / "b.bag", markers=WHIP).notes)


@needs_rosbags
def test_a_topic_is_decoded_once_for_all_its_markers(tmp_path, monkeypatch):
    write_markers(tmp_path / "a.bag", 0.0)
    decoded, messages = [], bag_logs.bag_messages

    def counted(*args):
        for one in messages(*args):
            decoded.append(one[0])
            yield one

    monkeypatch.setattr(bag_logs, "bag_messages", counted)
    read_recording(tmp_path / "a.bag", markers=WHIP)
    assert len(decoded) == 2 * S


@needs_rosbags
def test_our_own_mcap_of_a_recording_is_read_back(tmp_path):
    pytest.importorskip("mcap")
    rng = np.random.default_rng(0)
    t = np.arange(50) / FPS
    points = rng.normal(size=(50, 2, 3))
    points[3:5, 1] = np.nan
    made = StrikeRecording(
        t, points, ("tip", "handle"), joints_t=log_times(), joints_q=angles(), joint_names=JOINTS,
        hand_t=log_times(), hand_pose=poses(),
    )  # fmt: skip
    write_recorded_mcap(tmp_path / "a.mcap", made)
    read = read_recording(tmp_path / "a.mcap")
    np.testing.assert_allclose(read.t, t, atol=2e-9)
    np.testing.assert_array_equal(read.points, points)
    np.testing.assert_array_equal(read.joints_q, angles())
    np.testing.assert_allclose(read.hand_pose, poses(), atol=1e-15)
    np.testing.assert_allclose(read.joints_t, log_times(), atol=2e-9)


STATES = np.degrees(angles()[:, :3])


@pytest.mark.parametrize(
    ("names", "state", "said"),
    [
        (["main_a", "main_b", "main_c"], STATES, "before its motors could be normalized"),
        (["a.pos", "b.pos", "c.pos"], 3 * STATES, "do not go beyond 100"),
    ],
)
def test_degrees_of_lerobots_motors_are_known_where_they_can_be(tmp_path, names, state, said):
    pytest.importorskip("pyarrow")
    write_lerobot_2(tmp_path / "d", names=names, state=state)
    logs = open_any(f"{tmp_path / 'd'}#1")
    assert isinstance(logs, Logs)
    assert logs.joints is not None
    assert logs.joints.unit == "deg"
    assert any(said in note for note in logs.joints.notes)
    np.testing.assert_allclose(logs.joints.q, state, atol=1e-4)


def test_degrees_of_lerobots_motors_are_asked_for_where_they_cannot_be_known(tmp_path):
    pytest.importorskip("pyarrow")
    write_lerobot_2(tmp_path / "d", names=["a.pos", "b.pos", "c.pos"], state=STATES)
    with pytest.raises(InputError, match=r"joint_units: got None; allowed: deg, or normalized"):
        open_any(f"{tmp_path / 'd'}#1")
    with pytest.raises(InputError, match="one of 2 episodes"):
        open_any(f"{tmp_path / 'd'}#2")


@needs_rosbags
@pytest.mark.parametrize("name", ["a.bag", "b.mcap"])
def test_fuzz_bags(tmp_path, name):
    if name == "a.bag":
        write_states(tmp_path / name)
        file = tmp_path / name
    else:
        write_states(tmp_path / "b_mcap")
        file = next((tmp_path / "b_mcap").glob("*.mcap"))
    fuzz(file, 60, lambda: bag_joints(file))
