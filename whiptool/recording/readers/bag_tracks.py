"""Tracks from ROS bags: markers that were published as points or poses, with the joints and the hand of the same bag.

A marker is a topic of `geometry_msgs/PointStamped`, `PoseStamped` or `TransformStamped`, as motion capture publishes
rigid bodies, or one pose of a `PoseArray`. The key `markers` names them, as in `{tip = "/vrpn/tip/pose", node3 =
"/whip[3]"}`; default: topics of points that are called after a marker, such as `/tip`. Topics that were published at
other times make further frames, in which the other markers are missing.

All markers have one clock: that of the headers, or, where the headers of two topics are by clocks that differ by more
than 1 s, that by which the bag was written. Places are in m, by the definition of the messages, in the axes of their
frame, whose z is taken to point up. Time 0 is the first frame, unless `start` says when the command began by the bag's
clock. Joints and hand are those of the bag, unless the keys `joints` and `hand` name another file.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from whiptool.errors import InputError
from whiptool.given_files import parsing
from whiptool.recording.readers.bag_files import bag_parts, bag_topics, common_clock
from whiptool.recording.readers.bag_logs import (
    ARRAY,
    HEADER,
    PLACES,
    POINT,
    POSE,
    STATE,
    WRITTEN,
    Published,
    published,
)
from whiptool.recording.readers.footage import clock_of_rows
from whiptool.recording.readers.rosbag import IMAGE, bag_sidecar
from whiptool.recording.readers.sidecar import CLOCK, FILM, PIXELS, Sidecar
from whiptool.recording.strike_recording import PARTS, StrikeRecording

SAME = 1e-6  # [s] between stamps of one frame
DELAYED, OTHER_CLOCK = 0.05, 1.0  # [s] between delays of two topics: a word is said, and their clocks are others


def read_bag(path: Path | str, **options: Any) -> StrikeRecording:
    """Read the markers of a bag, a file or folder; `options` are keys of its sidecar, whose values they override."""
    path = Path(path)
    side = bag_sidecar(path, options)
    topics = bag_topics(path)
    own = {name.rpartition("/")[2]: name for name, topic in topics.items() if topic.kind == POINT}
    markers = side.names("markers") or {name: topic for name, topic in own.items() if PARTS.fullmatch(name)}
    if not markers:
        given = ", ".join(f"{name} ({topic.kind})" for name, topic in topics.items()) or "no messages"
        raise InputError(f"{path}: topics", given[:400], "topics of points: name the markers' topics (key markers)")
    places = {name: _place(path, topics, written) for name, written in markers.items()}
    numbers = {topic: sorted({k for other, k in places.values() if other == topic}) for topic, _ in places.values()}
    found = published(path, numbers, PLACES)
    times, whose = _clock(found, path)
    t, points = _frames([(times[topic], found[topic].poses[k][:, :3]) for topic, k in places.values()])
    side = _with_logs(side.starting(t[0]), path, {name: topic.kind for name, topic in topics.items()})
    with parsing(path, "ROS bag"):
        clock = clock_of_rows(side, t, f"times from {whose}", "stamps")
        return side.recording(
            path,
            notes=[*clock.notes, *_delays(found), "units: m, by the definition of the messages"],
            t=clock.times,
            points=side.metres(points[clock.keep]),
            markers=tuple(places),
            sigma=side.sigma(),
            files=bag_parts(path),
            up="" if "axes" in side.table else "z",
            others=(*CLOCK, *PIXELS, *FILM, "topic") if any(x.kind == IMAGE for x in topics.values()) else (),
        )


def _place(path: Path, topics: dict[str, Any], written: str) -> tuple[str, int]:
    """The topic of a marker, and the number of its pose: of `/whip[3]` pose 3 of an array."""
    match = re.fullmatch(r"(.+)\[(\d+)\]", written)
    topic, index = (match[1], int(match[2])) if match else (written, 0)
    kind = topics[topic].kind if topic in topics else None
    if kind not in PLACES or (kind == ARRAY) != bool(match):
        known = [name + "[0]" * (about.kind == ARRAY) for name, about in topics.items() if about.kind in PLACES]
        raise InputError(f"{path}: markers", written, "one of the topics " + (", ".join(known) or "(none)"))
    return topic, index


def _clock(found: Mapping[str, Published], path: Path) -> tuple[dict[str, np.ndarray], str]:
    """Stamps [s] of all topics by one clock, and its name: headers of several computers have several clocks."""
    clocks = {
        HEADER: {topic: one.stamps for topic, one in found.items()},
        WRITTEN: {topic: one.written for topic, one in found.items()},
    }
    delays = [_delay(one) for one in found.values()]
    if max(delays) - min(delays) <= OTHER_CLOCK:
        return common_clock(clocks, f"{path}: topics")
    apart = f"{HEADER}: those of the markers' topics are {max(delays) - min(delays):.6g} s apart"
    return common_clock({WRITTEN: clocks[WRITTEN]}, f"{path}: topics", against=[apart])


def _delay(one: Published) -> float:
    """Usual time from a message's stamp until it was written [s]."""
    return float(np.median(np.subtract(one.written, one.stamps)))


def _delays(found: Mapping[str, Published]) -> list[str]:
    """A sentence where topics were written at different times after their stamps, as of clocks that differ a little."""
    delays = {topic: _delay(one) for topic, one in found.items()}
    first, last = min(delays, key=delays.__getitem__), max(delays, key=delays.__getitem__)
    apart = delays[last] - delays[first]
    if not DELAYED < apart <= OTHER_CLOCK:
        return []
    return [
        f"messages of {last} were written {apart:.3f} s longer after their stamps than those of {first}: either they "
        "took so long, or their computers' clocks differ"
    ]


def _frames(found: list[tuple[np.ndarray, np.ndarray]]) -> tuple[np.ndarray, np.ndarray]:
    """Times of all frames (T,), and places (T, M, 3), NaN where a marker has none; rows of a bad stamp are left out."""
    found = [(times[np.isfinite(times)], places[np.isfinite(times)]) for times, places in found]
    every = np.sort(np.concatenate([times for times, _ in found]))
    t = every[np.concatenate([[True], np.diff(every) > SAME])]
    points = np.full((len(t), len(found), 3), np.nan)
    for m, (times, places) in enumerate(found):
        points[np.searchsorted(t, times + SAME, side="right") - 1, m] = places
    return t, points


def _with_logs(side: Sidecar, path: Path, kinds: dict[str, str]) -> Sidecar:
    """The sidecar with the bag as the file of joints and of the hand, where it holds them and no other is named."""
    logs: dict[str, Path] = {}
    if "joints" not in side.table and ("joints_topic" in side.table or list(kinds.values()).count(STATE) == 1):
        logs["joints"] = path
    hands = [name for name, kind in kinds.items() if kind == POSE and "hand" in name.lower()]
    if "hand" not in side.table and ({"hand_topic", "hand_frames"} & set(side.table) or len(hands) == 1):
        logs["hand"] = path
    return side.changed(**logs)
