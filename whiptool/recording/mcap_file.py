"""MCAP files of plans, strikes and recordings, which Foxglove and Rerun show and ROS 2 plays: CDR messages of ROS 2.

The messages are of the standard packages, with their definitions in the file (profile `ros2`). Times are those of the
strike or recording, from 0; the frame `base` is that of the arm's base. The plane stands upright in it.
"""

from __future__ import annotations

import io
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
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

_ON_PATH = 300  # places, about, of a whole path in one message

Message: TypeAlias = tuple[str, float, Any]  # topic, time [s], message of rosbags


def write_commanded_mcap(path: Path | str, trajectory: JointTrajectory) -> None:
    """Write a joint trajectory: `/joint_trajectory`, one message with the points of `JointTrajectory.for_splines`,
    `/joint_states` of all samples, and the poses of a strike of the hand, `/hand`."""
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
    """Write a simulated strike: `/joint_states` of the arm, `/whip`, the places of the hand and all nodes, and
    `/tip`."""
    _write(path, _strike(model, trajectory, trajectory.t))


def write_progress_mcap(
    path: Path | str,
    curves: Mapping[str, tuple[np.ndarray, np.ndarray]],
    points: Mapping[str, np.ndarray],
    strike: tuple[Model, Trajectory, Sequence[float]] | None,
) -> None:
    """Write how a run went: a number a second, such as a trial's, and after the last the strike that was chosen, its
    model, trajectory and target (d,) [m], or None.

    `curves` are numbers of trials (K,), which count as seconds, and values (K,), by names in small letters with
    underscores; values that are not finite are left out. `points` are positions (K, d) [m] by name. Topics are
    `/progress/NAME` of each curve, and at the strike `/joint_states`, `/whip`, `/tip`, its whole path `/tip_path`,
    `/target`, and `/points/NAME`.
    """
    counted = np.concatenate([np.zeros(1), *(x for x, _ in curves.values())])
    first, last = float(counted.min()), float(counted.max())
    found: list[Message] = []
    for name, (x, y) in curves.items():
        known = np.isfinite(y)
        for time, value in zip(x[known] - first, y[known], strict=True):
            found.append((f"/progress/{_topic(name)}", time, _message("std_msgs/msg/Float64", float(value))))
    begins = last - first + 1
    if strike is not None:
        model, trajectory, target = strike
        found += _strike(model, trajectory, begins + trajectory.t)
        few = trajectory.tip[:: max(1, round(len(trajectory.t) / _ON_PATH))]
        way = [_message(_POSE, _header(begins), _pose(place)) for place in upright(few)]
        found.append(("/tip_path", begins, _message("nav_msgs/msg/Path", _header(begins), way)))
        found += _places("/target", np.array([begins]), upright(np.array([target])))
    for name, places in points.items():
        poses = [_pose(place) for place in upright(places)]
        found.append((f"/points/{_topic(name)}", begins, _message(_POSES, _header(begins), poses)))
    _write(path, found)


def _topic(name: str) -> str:
    """A name as part of a topic of ROS: small letters, digits and underscores."""
    return re.sub(r"[^a-z0-9]+", "_", name.lower()).strip("_")


def _strike(model: Model, trajectory: Trajectory, t: np.ndarray) -> list[Message]:
    """Messages of a strike: the arm's joints, the places of the hand and all nodes, and the tip, at times (T,) [s]."""
    a = model.arm.n
    found = list(_states(model.arm.names, t, trajectory.q[:, :a], trajectory.v[:, :a]))
    places = upright(joint_points(model, trajectory.q))[:, a:]  # the hand, then the nodes
    for time, points in zip(t, places, strict=True):
        found.append((WHIP, time, _message(_POSES, _header(time), [_pose(x) for x in points])))
    return [*found, *_places(TIP, t, upright(trajectory.tip))]


def write_recorded_mcap(path: Path | str, recording: StrikeRecording) -> None:
    """Write a recording of positions: `/joint_states` of the joint log, a topic of each marker (`/tip`), and `/hand` if
    measured."""
    if recording.view is not None or recording.angular:
        given = "angles" if recording.angular else "pixels"
        raise InputError(recording.called, given, "positions of markers [m]", "triangulate the recording first")
    recording, found = recording.upright("z"), list[Message]()
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


def _pose(place: np.ndarray) -> Any:
    """A place without a direction."""
    still = _message("geometry_msgs/msg/Quaternion", 0.0, 0.0, 0.0, 1.0)
    return _message("geometry_msgs/msg/Pose", _point(place), still)


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
