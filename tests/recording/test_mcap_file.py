"""MCAP files, read back by two readers: rosbags with its own types, and mcap with the bytes of CDR decoded here."""

from __future__ import annotations

import struct

import numpy as np
import pytest

from whiptool.errors import InputError
from whiptool.models import preset
from whiptool.models.joint_trajectory import JointTrajectory
from whiptool.models.kinematics import joint_points
from whiptool.models.strike import Strike
from whiptool.models.trajectory import Trajectory
from whiptool.recording.mcap_file import write_commanded_mcap, write_recorded_mcap, write_strike_mcap
from whiptool.recording.strike_recording import StrikeRecording

pytest.importorskip("mcap", reason="MCAP files need pip install 'whiptool[io]'")
pytest.importorskip("rosbags", reason="MCAP files need pip install 'whiptool[io]'")
UR5E = preset("ur5e")
STRIKE = Strike((0.1, -1.9, 1.2, -0.9, 0.3, 0.0), (0.5, -1.2, 0.6, -1.6, -0.4, 0.2), 0.6)


def by_rosbags(path) -> dict[str, list]:
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    found: dict[str, list] = {}
    with AnyReader([path], default_typestore=get_typestore(Stores.EMPTY)) as bag:  # the file's own definitions
        for connection, time, data in bag.messages():
            found.setdefault(connection.topic, []).append((1e-9 * time, bag.deserialize(data, connection.msgtype)))
    return found


def first_state(path) -> tuple[str, str, list[str], np.ndarray]:
    """Definition's name and encoding, names and positions of the first joint state, from the bytes of its CDR."""
    from mcap.reader import make_reader

    with path.open("rb") as file:
        schema, channel, message = next(iter(make_reader(file).iter_messages(topics=["/joint_states"])))
    data, at = message.data[4:], 8  # without the encapsulation; after the stamp

    def number(kind: str) -> int | float:
        nonlocal at
        size = struct.calcsize(kind)
        at = -(-at // size) * size
        (value,) = struct.unpack_from("<" + kind, data, at)
        at += size
        return value

    def text() -> str:
        nonlocal at
        length = number("I")
        at += length
        return bytes(data[at - length : at - 1]).decode()

    assert text() == "base"
    names = [text() for _ in range(number("I"))]
    positions = np.array([number("d") for _ in range(number("I"))])
    assert channel.message_encoding == "cdr"
    return schema.name, schema.encoding, names, positions


def test_a_plan_is_read_by_both(tmp_path):
    path = tmp_path / "plan.mcap"
    told = JointTrajectory.of_strike(STRIKE, UR5E.arm.names, rest=0.1, rate=100)
    write_commanded_mcap(path, told)
    read = by_rosbags(path)
    assert set(read) == {"/joint_states", "/joint_trajectory"}
    np.testing.assert_allclose([time for time, _ in read["/joint_states"]], told.t, atol=1e-9)
    np.testing.assert_array_equal([m.position for _, m in read["/joint_states"]], told.q)
    np.testing.assert_array_equal([m.velocity for _, m in read["/joint_states"]], told.v)
    (_, command), few = read["/joint_trajectory"][0], told.for_splines()
    assert command.joint_names == list(UR5E.arm.names)
    np.testing.assert_array_equal([p.accelerations for p in command.points], few.a)
    seconds = [p.time_from_start.sec + 1e-9 * p.time_from_start.nanosec for p in command.points]
    np.testing.assert_allclose(seconds, few.t, atol=1e-9)
    name, encoding, names, positions = first_state(path)
    assert (name, encoding) == ("sensor_msgs/msg/JointState", "ros2msg")
    assert names == list(UR5E.arm.names)
    np.testing.assert_array_equal(positions, told.q[0])


@pytest.mark.parametrize("model", [preset("lemon2024"), UR5E])
def test_a_strike_has_its_whip_and_tip(model, tmp_path):
    rng, T, n, a = np.random.default_rng(0), 4, model.coordinates, model.arm.n
    q = rng.normal(size=(T, n))
    if model.dimension == 3:
        rods = q[:, a:].reshape(T, -1, 3)
        q[:, a:] = (rods / np.linalg.norm(rods, axis=2, keepdims=True)).reshape(T, -1)
    places = joint_points(model, q)
    none, arm, tip = np.zeros((T, a, a)), np.zeros((T, a)), places[:, -1]
    moved = Trajectory(np.arange(T) / 10, q, q, q[:, :a], q[:, :a], arm, none, none, tip, tip, False)
    write_strike_mcap(tmp_path / "strike.mcap", model, moved)
    read = by_rosbags(tmp_path / "strike.mcap")
    seen = np.array([[[p.position.x, p.position.y, p.position.z] for p in m.poses] for _, m in read["/whip"]])
    axes = [0, 1, 2] if model.dimension == 3 else [0, 2]
    np.testing.assert_array_equal(seen[..., axes], places[:, a:])
    tip = np.array([[m.point.x, m.point.y, m.point.z] for _, m in read["/tip"]])
    np.testing.assert_array_equal(tip, seen[:, -1])
    assert read["/tip"][0][1].header.frame_id == "base"


def test_a_recording_begins_at_0_and_leaves_out_what_was_not_seen(tmp_path):
    t = np.arange(-2, 6) / 60
    points = np.random.default_rng(0).normal(size=(8, 1, 3))
    points[3] = np.nan
    log = np.arange(20) / 100
    recording = StrikeRecording(t, points, ("tip",), joints_t=log, joints_q=np.ones((20, 2)), joint_names=("a", "b"))
    write_recorded_mcap(tmp_path / "recorded.mcap", recording)
    read = by_rosbags(tmp_path / "recorded.mcap")
    kept = np.delete(np.arange(8), 3)
    np.testing.assert_allclose([time for time, _ in read["/tip"]], t[kept] + 2 / 60, atol=2e-9)
    stamps = [m.header.stamp.sec + 1e-9 * m.header.stamp.nanosec for _, m in read["/tip"]]
    np.testing.assert_allclose(stamps, t[kept] + 2 / 60, atol=2e-9)
    np.testing.assert_array_equal([m.point.z for _, m in read["/tip"]], points[kept, 0, 2])
    assert read["/joint_states"][0][1].name == ["a", "b"]
    assert len(read["/joint_states"]) == 20


def test_pixels_are_refused(tmp_path):
    from whiptool.recording.camera import Camera

    camera = Camera("left", 640, 480, np.diag([500.0, 500.0, 1.0]), np.eye(3), np.zeros(3))
    seen = StrikeRecording(np.arange(4) / 60, np.full((4, 1, 2), 100.0), ("tip",), view=camera)
    with pytest.raises(InputError, match="got 'pixels'; allowed: positions"):
        write_recorded_mcap(tmp_path / "a.mcap", seen)
