"""Logs of joints and of the hand from ROS bags.

Joints are messages `sensor_msgs/JointState`, in rad and m by their definition. The hand's poses are messages
`geometry_msgs/PoseStamped`, `PoseArray` (the first pose of each) or `TransformStamped` of one topic, or transforms of
`tf` from one frame to another, along the chain of frames between them; transforms that were published at other times
are interpolated.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from whiptool.errors import InputError
from whiptool.recording.logs import Column, good_stamps
from whiptool.recording.readers.bag_files import FRAMES, bag_messages, bag_topics, best_clock, stamp_of
from whiptool.recording.readers.joint_log import JointLog, Logs, joint_log

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation

STATE = "sensor_msgs/msg/JointState"
POSE, ARRAY, MOVED, POINT = (
    f"geometry_msgs/msg/{name}" for name in ("PoseStamped", "PoseArray", "TransformStamped", "PointStamped")
)
PLACES = (POINT, POSE, MOVED, ARRAY)  # kinds of messages in which a marker is
STATIC = "/tf_static"
HAND = "hand"  # in the name of a topic of its poses
HEADER, WRITTEN = "the messages' header stamps", "the times at which the bag was written"


def read_bag_logs(path: Path | str) -> Logs:
    """Read all logs of a bag that need no choice: joints of the only topic with such, poses of the only such topic."""
    topics = bag_topics(path)
    joints = [name for name, topic in topics.items() if topic.kind == STATE]
    poses = [name for name, topic in topics.items() if topic.kind in (POSE, ARRAY, MOVED)]
    used = (joints if len(joints) == 1 else []) + (poses if len(poses) == 1 else [])
    aside = tuple(f"{name} ({topic.kind}, {topic.count})" for name, topic in topics.items() if name not in used)
    if not used:
        given = ", ".join(f"{name} ({topic.kind})" for name, topic in topics.items()) or "no messages"
        fix = "name one: joints_topic or hand_topic in the sidecar of the tracks" if joints or poses else ""
        raise InputError(f"{path}: topics", given[:400], "one topic of joints, of poses, or of points", fix)
    log = bag_joints(path) if len(joints) == 1 else None
    hand = bag_hand(path) if len(poses) == 1 else None
    if hand is not None and HAND not in poses[0]:
        guess = "hand: taken as the hand's, for no other topic has poses; of a marker say markers"
        hand = replace(hand, notes=(*hand.notes, guess))
    return Logs(log, hand, aside)


def bag_joints(path: Path | str, topic: str | None = None, columns: Any = None) -> JointLog:
    """Read the log of joints of one topic, by default of the only one with joints; `columns` names the arm's joints,
    see `asked` of `whiptool.recording.readers.joint_log.joint_log`."""
    topic = _topic(path, topic, [STATE], "joints_topic")
    stamps: list[float] = []
    written: list[float] = []
    states: list[dict[str, float]] = []
    for _, time, message in bag_messages(path, [topic], [STATE]):
        if len(message.position) not in (0, len(message.name)):
            given = f"{len(message.position)} positions of {len(message.name)} joints"
            raise InputError(f"{path}: {topic}", given, "a position for each joint, or none")
        stamps.append(stamp_of(message))
        written.append(1e-9 * time)
        states.append(dict(zip(message.name, message.position.tolist(), strict=False)))
    whole = [len(state) for state in states]
    if not any(whole):
        raise InputError(f"{path}: {topic}", f"{len(states)} messages without positions", "positions of joints")
    names = _joints_of(states)
    keep = [i for i, state in enumerate(states) if set(names) <= set(state)]
    table = np.array([[states[i][name] for name in names] for i in keep])
    times, whose = best_clock(
        {HEADER: [stamps[i] for i in keep], WRITTEN: [written[i] for i in keep]}, f"{path}: {topic}"
    )
    log = joint_log(times, table, names, columns, f"{path}: {topic}", of=whose)
    notes = [f"joints: from {topic}, rad by the definition of JointState, times from {whose}"]
    aside = sorted({name for state in states for name in state} - set(names))
    others = f", which are of {', '.join(aside)}" if aside else ""
    notes += [f"joints: left out {len(states) - len(keep)} messages{others}"] if len(keep) < len(states) else []
    return replace(log, unit="rad", notes=(*notes, *log.notes))


def _joints_of(states: Sequence[dict[str, float]]) -> list[str]:
    """Names of the joints of most messages: several programs may write to a topic, such as those of arm and gripper."""
    kinds = Counter(tuple(state) for state in states if state)

    def joints(names: tuple[str, ...]) -> int:
        return sum(not Column.of(name).holds for name in names)

    most = max(joints(names) for names in kinds)
    return list(max((names for names in kinds if joints(names) == most), key=lambda names: kinds[names]))


def bag_hand(path: Path | str, topic: str | None = None, frames: Sequence[str] | None = None) -> JointLog:
    """Read the poses of the hand, (S, 7): place [m] and quaternion (x, y, z, w). The topic is by default the only one
    with poses, or whose name holds `hand`; for poses from `tf`, `frames` names those of the base and of the hand."""
    if frames is not None:
        times, poses, said = _along_frames(path, *frames)
    else:
        topic = _topic(path, topic, [POSE, ARRAY, MOVED], "hand_topic", HAND)
        found = published(path, {topic: [0]}, [POSE, ARRAY, MOVED])[topic]
        times, whose = best_clock({HEADER: found.stamps, WRITTEN: found.written}, f"{path}: {topic}")
        poses, said = found.poses[0], f"from {topic}, times from {whose}"
    keep, bad = good_stamps(times, f"{path}: hand")
    return JointLog(times[keep], poses[keep], notes=(f"hand: {said}", *bad))


@dataclass(frozen=True, eq=False)
class Published:
    """Poses of one topic, of S messages."""

    stamps: list[float]  # stamps in the messages' headers [s]
    written: list[float]  # times at which they were written [s]
    poses: dict[int, np.ndarray]  # by the number of the pose in a message, (S, 7): place [m], quaternion (x, y, z, w)


def published(path: Path | str, topics: Mapping[str, Sequence[int]], kinds: Sequence[str]) -> dict[str, Published]:
    """Read places and orientations of topics with messages of these kinds, each message once; a point has the
    orientation (0, 0, 0, 1). Each topic has the numbers of its poses: 0, or those of a `PoseArray`."""
    stamps: dict[str, list[float]] = {topic: [] for topic in topics}
    written: dict[str, list[float]] = {topic: [] for topic in topics}
    rows: dict[str, list[list[list[float]]]] = {topic: [] for topic in topics}
    for topic, time, message in bag_messages(path, list(topics), kinds):
        rows[topic].append([_pose(message, index, f"{path}: {topic}") for index in topics[topic]])
        stamps[topic].append(stamp_of(message))
        written[topic].append(1e-9 * time)
    found = {}
    for topic, numbers in topics.items():
        if len(rows[topic]) < 2:
            raise InputError(f"{path}: {topic}", f"{len(rows[topic])} messages", "at least two")
        table = np.array(rows[topic], float)
        poses = {number: table[:, i] for i, number in enumerate(numbers)}
        found[topic] = Published(stamps[topic], written[topic], poses)
    return found


def _pose(message: Any, index: int, place: str) -> list[float]:
    """Place and quaternion of a message."""
    at, turned = _parts(message, message.__msgtype__, index, place)
    return [at.x, at.y, at.z, *((0, 0, 0, 1) if turned is None else _quaternion(turned))]


def _parts(message: Any, kind: str, index: int, place: str) -> tuple[Any, Any]:
    """Place and orientation of a message; None without orientation."""
    if kind == POINT:
        return message.point, None
    if kind == MOVED:
        return message.transform.translation, message.transform.rotation
    if kind == ARRAY:
        if len(message.poses) <= index:
            raise InputError(place, f"{len(message.poses)} poses", f"at least {index + 1}")
        return message.poses[index].position, message.poses[index].orientation
    return message.pose.position, message.pose.orientation


def _quaternion(q: Any) -> tuple[float, float, float, float]:
    if q.x == q.y == q.z == q.w == 0:
        raise InputError("orientation", "0, 0, 0, 0", "a quaternion in every message")
    return q.x, q.y, q.z, q.w


def _topic(path: Path | str, topic: str | None, kinds: Sequence[str], key: str, named: str = "") -> str:
    """The topic that is asked for, or the only one of these kinds."""
    found = [name for name, about in bag_topics(path).items() if about.kind in kinds]
    likely = [name for name in found if named and named in name.lower()]
    if topic is None and (len(found) == 1 or len(likely) == 1):
        return (found if len(found) == 1 else likely)[0]
    if topic not in found:
        said = ", ".join(found) or "none"
        raise InputError(f"{path}: {key}", topic, f"one of the topics of {kinds[0].rpartition('/')[2]}: {said}")
    return topic


def _along_frames(path: Path | str, base: str, hand: str) -> tuple[np.ndarray, np.ndarray, str]:
    """Times and poses of a frame in another, from the transforms between them."""
    from scipy.spatial.transform import Rotation

    parents, samples = _transforms(path)
    chain, at = [], hand.lstrip("/")
    while at != base.lstrip("/"):
        if at not in parents or len(chain) > len(parents):
            known = ", ".join(sorted({*parents, *parents.values()})) or "none"
            raise InputError(f"{path}: hand_frames", [base, hand], f"two frames, the first before the second: {known}")
        chain.append(at)
        at = parents[at]
    moving = [frame for frame in chain if len(samples[frame][0]) > 1]
    if not moving:
        raise InputError(f"{path}: hand_frames", [base, hand], "frames that move against each other")
    low, high = (f(samples[frame][0][i] for frame in moving) for f, i in ((max, 0), (min, -1)))
    most = max(moving, key=lambda frame: len(samples[frame][0]))
    times = samples[most][0]
    times = times[(times >= low) & (times <= high)]
    if len(times) < 2:
        raise InputError(f"{path}: hand_frames", [base, hand], "frames whose transforms were published at one time")
    place, turned = np.zeros((len(times), 3)), Rotation.identity(len(times))
    for frame in chain:  # from the hand to the base
        t, rows = samples[frame]
        rotation, shift = _between(t, rows, times)
        place, turned = rotation.apply(place) + shift, rotation * turned
    said = f"from tf, {hand} in {base}, through {', '.join(chain[1:]) or 'no other frame'}, times from {HEADER}"
    return times, np.hstack([place, turned.as_quat()]), said


def _between(t: np.ndarray, rows: np.ndarray, times: np.ndarray) -> tuple[Rotation, np.ndarray]:
    """Rotations and shifts (S, 3) at times (S,) of transforms (K, 7) at times t (K,)."""
    from scipy.spatial.transform import Rotation, Slerp

    turned = Rotation.from_quat(rows[:, 3:])
    if len(t) == 1:
        return turned[np.zeros(len(times), int)], np.repeat(rows[:, :3], len(times), axis=0)
    shift = np.column_stack([np.interp(times, t, x) for x in rows[:, :3].T])
    return Slerp(t, turned)(times), shift


def _transforms(path: Path | str) -> tuple[dict[str, str], dict[str, tuple[np.ndarray, np.ndarray]]]:
    """The parent of each frame, and its transforms: times (K,) and places with quaternions (K, 7)."""
    topics = [name for name, about in bag_topics(path).items() if about.kind == FRAMES]
    parents: dict[str, str] = {}
    listed: dict[str, dict[float, list[float]]] = {}
    for topic, _, message in bag_messages(path, topics, [FRAMES]):
        for one in message.transforms:
            frame, shift = one.child_frame_id.lstrip("/"), one.transform.translation
            parents[frame] = one.header.frame_id.lstrip("/")
            stamp = 0.0 if topic == STATIC else stamp_of(one)
            listed.setdefault(frame, {})[stamp] = [shift.x, shift.y, shift.z, *_quaternion(one.transform.rotation)]
    rows = {frame: sorted(found.items()) for frame, found in listed.items()}
    return parents, {
        frame: (np.array([t for t, _ in found]), np.array([x for _, x in found])) for frame, found in rows.items()
    }
