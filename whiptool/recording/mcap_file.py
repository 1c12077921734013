"""MCAP files of plans, strikes and recordings, which Foxglove and Rerun show and ROS 2 plays: CDR messages of ROS 2.

The messages are of the standard packages, with their definitions in the file (profile `ros2`). Times are those of the
strike or recording, from 0; the frame `base` is that of the arm's base. The plane stands upright in it.
"""

from __future__ import annotations

import io
from collections.abc import Iterable, Iterator, Sequence
from functools import cache
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from whiptool.errors import InputError
from whiptool.extras import optional
from whiptool.models.joint_trajectory import JointTrajectory
from whiptool.models.kinematics import joint_points, upright
from whiptool.models.parameters import Model
from whiptool.models.trajectory import Trajectory
from whiptool.recording.strike_recording import StrikeRecording
from whiptool.whole_files import write_whole

NEEDS = ("mcap", "rosbags")  # modules
JOINTS, COMMAND, WHIP, TIP, HAND = "/joint_states", "/joint_trajectory", "/whip", "/tip", "/hand"  # topics
FRAME = "base"
_STATE, _TRAJECTORY = "sensor_msgs/msg/JointState", "trajectory_msgs/msg/JointTrajectory"
_POINT, _POSE, _POSES = (f"geometry_msgs/msg/{name}" for name in ("PointStamped", "PoseStamped", "PoseArray"))

Message: TypeAlias = tuple[str, float, Any]  # topic, time [s], message of rosbags


def write_commanded_mcap(path: Path | str, trajectory: JointTrajectory) -> None:
    """Write a joint trajectory: `/joint_trajectory`, one message with the points of `JointTrajectory.for_splines`,
    `/joint_states` of all samples, and the poses of a strike of the hand, `/hand`.

    Raises:
        MissingPackage: mcap or rosbags is not installed.
        OSError: The file cannot be written.
    """
    few = trajectory.for_splines()
    points = [
        _message(f"{_TRAJECTORY}Point", q, v, a, np.empty(0), _message("builtin_interfaces/msg/Duration", *_split(t)))
        for t, q, v, a in zip(few.t, few.q, few.v, few.a, strict=True)
    ]
    found = [(COMMAND, 0.0, _message(_TRAJECTORY, _header(0.0), list(trajectory.joints), points))]
    found += _states(trajectory.joints, trajectory.t, trajectory.q, trajectory.v)
    if trajectory.hand is not None:
        found += _poses(trajectory.t, trajectory.hand)
    _write(path, found)


def write_strike_mcap(path: Path | str, model: Model, trajectory: Trajectory) -> None:
    """Write a simulated strike: `/joint_states` of the arm, `/whip`, the places of the hand and all nodes, and `/tip`.

    Args:
        path: The file.
        model: Model of arm and whip.
        trajectory: The strike.

    Raises:
        MissingPackage: mcap or rosbags is not installed.
        OSError: The file cannot be written.
    """
    a, t = model.arm.n, trajectory.t
    found = list(_states(model.arm.names, t, trajectory.q[:, :a], trajectory.v[:, :a]))
    places = upright(joint_points(model, trajectory.q))[:, a:]  # the hand, then the nodes
    still = _message("geometry_msgs/msg/Quaternion", 0.0, 0.0, 0.0, 1.0)
    for time, points in zip(t, places, strict=True):
        poses = [_message("geometry_msgs/msg/Pose", _point(x), still) for x in points]
        found.append((WHIP, time, _message(_POSES, _header(time), poses)))
    found += _places(TIP, t, upright(trajectory.tip))
    _write(path, found)


def write_recorded_mcap(path: Path | str, recording: StrikeRecording) -> None:
    """Write a recording: `/joint_states` of the joint log, a topic of each marker (`/tip`), and `/hand` if measured.

    Raises:
        InputError: The points are pixels or angles, not positions.
        MissingPackage: mcap or rosbags is not installed.
        OSError: The file cannot be written.
    """
    if recording.view is not None or recording.angular:
        given = "angles" if recording.angular else "pixels"
        raise InputError(recording.called, given, "positions of markers [m]", "triangulate the recording first")
    found: list[Message] = []
    if recording.joints_t is not None and recording.joints_q is not None:
        names = recording.joint_names or [f"joint{i + 1}" for i in range(recording.joints_q.shape[1])]
        found += _states(names, recording.joints_t, recording.joints_q)
    times = np.broadcast_to(recording.t_points, recording.points.shape[:2])
    for j, marker in enumerate(recording.markers):
        seen = np.isfinite(recording.points[:, j]).all(axis=1)
        found += _places(f"/{marker}", times[seen, j], upright(recording.points[seen, j]))
    if recording.hand_t is not None and recording.hand_pose is not None:
        found += _poses(recording.hand_t, recording.hand_pose)
    first = min(0.0, *(time for _, time, _ in found))
    _write(path, found, later=-first)


def _states(names: Sequence[str], t: np.ndarray, q: np.ndarray, v: np.ndarray | None = None) -> Iterator[Message]:
    rates = np.empty((len(t), 0)) if v is None else v
    for time, position, velocity in zip(t, q, rates, strict=True):
        yield JOINTS, time, _message(_STATE, _header(time), list(names), position, velocity, np.empty(0))


def _places(topic: str, t: np.ndarray, places: np.ndarray) -> Iterator[Message]:
    for time, place in zip(t, places, strict=True):
        yield topic, time, _message(_POINT, _header(time), _point(place))


def _poses(t: np.ndarray, poses: np.ndarray) -> Iterator[Message]:
    for time, pose in zip(t, poses, strict=True):
        turned = _message("geometry_msgs/msg/Quaternion", *map(float, pose[3:]))
        yield HAND, time, _message(_POSE, _header(time), _message("geometry_msgs/msg/Pose", _point(pose), turned))


def _point(place: np.ndarray) -> Any:
    return _message("geometry_msgs/msg/Point", *map(float, place[:3]))


def _header(time: float) -> Any:
    return _message("std_msgs/msg/Header", _message("builtin_interfaces/msg/Time", *_split(time)), FRAME)


def _split(time: float) -> tuple[int, int]:
    return divmod(round(1e9 * float(time)), 10**9)


@cache
def _types() -> Any:
    optional("rosbags", "MCAP files")
    from rosbags.typesys import Stores, get_typestore

    return get_typestore(Stores.ROS2_HUMBLE)


def _message(kind: str, *fields: Any) -> Any:
    """A message, or a part of one, with the fields in the order of their definition."""
    return _types().types[kind](*(np.ascontiguousarray(x) if isinstance(x, np.ndarray) else x for x in fields))


def _write(path: Path | str, messages: Iterable[Message], *, later: float = 0.0) -> None:
    """Write messages in the order of their times, which are shifted [s] so that none is before 0."""
    mcap, types, content = optional("mcap.writer", "MCAP files"), _types(), io.BytesIO()
    writer, channels = mcap.Writer(content), {}
    writer.start(profile="ros2", library="whiptool")
    for topic, time, message in sorted(messages, key=lambda one: one[1]):
        kind = message.__msgtype__
        if later and hasattr(message, "header"):
            message.header = _header(time + later)
        if topic not in channels:
            text = types.generate_msgdef(kind, ros_version=2)[0]
            schema = writer.register_schema(kind, "ros2msg", text.encode())
            channels[topic] = writer.register_channel(topic, "cdr", schema)
        stamp = round(1e9 * float(time + later))
        writer.add_message(channels[topic], stamp, bytes(types.serialize_cdr(message, kind)), stamp)
    writer.finish()
    write_whole(path, content.getvalue())
