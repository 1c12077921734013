"""Logs of joints and of the hand that a sidecar names, in any of their formats: CSV, ROS bags, LeRobot datasets."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from whiptool.errors import InputError
from whiptool.given_files import without_number
from whiptool.recording.readers.bag_files import is_bag
from whiptool.recording.readers.bag_logs import bag_hand, bag_joints
from whiptool.recording.readers.joint_log import JointLog, read_joint_log, read_poses
from whiptool.recording.readers.lerobot_dataset import STATE, joints_of, lerobot_episode


def read_joints(
    path: Path,
    columns: Mapping[str, str] | Sequence[str] | None = None,
    topic: str | None = None,
    *,
    stated: bool = False,
) -> JointLog:
    """Read a log of joint positions from a CSV file, a ROS bag, or the folder of a LeRobot dataset (`FOLDER#3` is its
    episode 3).

    `columns` are those of the arm's joints, see `asked` of `whiptool.recording.readers.joint_log.joint_log`; `topic` is
    that of a bag, by default the only one with joints. `stated` says whether the user states the joints' unit.
    """
    folder, number = without_number(path)
    if (folder / "meta/info.json").is_file():
        _no_topic("joints_topic", topic, path)
        return joints_of(lerobot_episode(folder, number or 0), STATE, columns, stated=stated)
    if is_bag(path, b""):
        return bag_joints(path, topic, columns)
    _no_topic("joints_topic", topic, path)
    return read_joint_log(path, columns)


def read_hand(path: Path, topic: str | None = None, frames: Sequence[str] | None = None) -> JointLog:
    """Read a log of the hand's poses, (S, 7): place [m] and quaternion (x, y, z, w), from a CSV file with the columns
    `POSE` or a ROS bag, whose `topic` and `frames` are as for `bag_hand`."""
    if is_bag(path, b""):
        return bag_hand(path, topic, frames)
    _no_topic("hand_topic", topic, path)
    _no_topic("hand_frames", frames, path)
    return read_poses(path)


def _no_topic(key: str, given: object, path: Path) -> None:
    if given is not None:
        raise InputError(f"{path}: {key}", given, "none, except for ROS bags")
