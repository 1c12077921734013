"""Tracks from ROS bags: markers that were published as points or poses, with the joints and the hand of the same bag.

A marker is a topic of `geometry_msgs/PointStamped`, `PoseStamped` or `TransformStamped`, as motion capture publishes
rigid bodies, or one pose of a `PoseArray`. The key `markers` names them, as in `{tip = "/vrpn/tip/pose", node3 =
"/whip[3]"}`; default: topics of points that are called after a marker, such as `/tip`. Topics that were published at
other times make further frames, in which the other markers are missing.

Places are in m, by the definition of the messages, in the axes of their frame, whose z is taken to point up. Time 0 is
the first frame, unless `start` says when the command began by the bag's clock. Joints and hand are those of the bag,
unless the keys `joints` and `hand` name another file.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np

from whiptool.errors import InputError
from whiptool.given_files import parsing
from whiptool.recording.readers.bag_files import bag_parts, bag_topics
from whiptool.recording.readers.bag_logs import ARRAY, MOVED, POINT, POSE, STATE, posed
from whiptool.recording.readers.footage import clock_of_rows
from whiptool.recording.readers.rosbag import bag_sidecar
from whiptool.recording.readers.sidecar import Sidecar
from whiptool.recording.strike_recording import StrikeRecording

MARKER = re.compile(r"tip|handle|shoulder|elbow|node\d+")
SAME = 1e-6  # [s] between stamps of one frame
_KINDS = (POINT, POSE, MOVED, ARRAY)


def read_bag(path: Path | str, **options: Any) -> StrikeRecording:
    """Read the markers of a bag.

    Args:
        path: The bag, a file or folder.
        options: Keys of the sidecar file, whose values they override.

    Raises:
        InputError: The file is not a bag or is damaged, holds no markers, lacks a topic, or a value is not allowed.
    """
    path = Path(path)
    side = bag_sidecar(path, options)
    topics = bag_topics(path)
    own = {name.rpartition("/")[2]: name for name, topic in topics.items() if topic.kind == POINT}
    markers = side.names("markers") or {name: topic for name, topic in own.items() if MARKER.fullmatch(name)}
    if not markers:
        given = ", ".join(f"{name} ({topic.kind})" for name, topic in topics.items()) or "no messages"
        raise InputError(f"{path}: topics", given[:400], "topics of points: name the markers' topics (key markers)")
    found = {name: _marker(path, topics, topic) for name, topic in markers.items()}
    t, points = _frames([(times, places) for times, places, _ in found.values()])
    side = side if "start" in side.table else Sidecar({**side.table, "start": float(t[0])}, side.folder, side.place)
    side = _with_logs(side, path, {name: topic.kind for name, topic in topics.items()})
    with parsing(path, "ROS bag"):
        whose = next(iter(found.values()))[2]
        clock = clock_of_rows(side, t, f"times from {whose}", "stamps")
        return side.recording(
            path,
            notes=[*clock.notes, "units: m, by the definition of the messages"],
            t=clock.times,
            points=side.metres(points[clock.keep]),
            markers=tuple(found),
            sigma=side.number("sigma", 1e-3, low=1e-9, high=1.0),
            files=bag_parts(path),
            up="" if "axes" in side.table else "z",
        )


def _marker(path: Path, topics: dict[str, Any], written: str) -> tuple[np.ndarray, np.ndarray, str]:
    """Times (S,), places (S, 3) and the clock of a topic, `/whip[3]` being pose 3 of an array."""
    match = re.fullmatch(r"(.+)\[(\d+)\]", written)
    topic, index = (match[1], int(match[2])) if match else (written, 0)
    kind = topics[topic].kind if topic in topics else None
    if kind not in _KINDS or (kind == ARRAY) != bool(match):
        known = [name + "[0]" * (about.kind == ARRAY) for name, about in topics.items() if about.kind in _KINDS]
        raise InputError(f"{path}: markers", written, "one of the topics " + (", ".join(known) or "(none)"))
    _, times, poses, whose = posed(path, topic, [kind], index)
    keep = np.isfinite(times)
    return times[keep], poses[keep, :3], whose


def _frames(found: list[tuple[np.ndarray, np.ndarray]]) -> tuple[np.ndarray, np.ndarray]:
    """Times of all frames (T,), and places (T, M, 3), NaN where a marker has none."""
    every = np.sort(np.concatenate([times for times, _ in found]))
    t = every[np.concatenate([[True], np.diff(every) > SAME])]
    points = np.full((len(t), len(found), 3), np.nan)
    for m, (times, places) in enumerate(found):
        points[np.searchsorted(t, times + SAME, side="right") - 1, m] = places
    return t, points


def _with_logs(side: Sidecar, path: Path, kinds: dict[str, str]) -> Sidecar:
    """The sidecar with the bag as the file of joints and of the hand, where it holds them and no other is named."""
    table = dict(side.table)
    if "joints" not in table and ("joints_topic" in table or list(kinds.values()).count(STATE) == 1):
        table["joints"] = path
    hands = [name for name, kind in kinds.items() if kind == POSE and "hand" in name.lower()]
    if "hand" not in table and ({"hand_topic", "hand_frames"} & set(table) or len(hands) == 1):
        table["hand"] = path
    return Sidecar(table, side.folder, side.place)
