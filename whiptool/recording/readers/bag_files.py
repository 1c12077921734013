"""ROS bags of any kind: files `.bag` of ROS 1, `.db3` and `.mcap` of ROS 2, and the folder that holds one of these.

Messages are decoded by rosbags with the definitions of the standard packages; definitions in the bag are not used.
Times are the messages' stamps, or those at which the bag was written: the first of these that nearly always increase.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from whiptool.errors import InputError
from whiptool.extras import optional
from whiptool.given_files import parsing, whole_file
from whiptool.recording.logs import good_stamps

BEGINNINGS = {".bag": b"#ROSBAG V2.0", ".db3": b"SQLite format 3\0", ".mcap": b"\x89MCAP0\r\n"}  # by suffix
ZSTD = b"\x28\xb5\x2f\xfd"  # RealSense compresses message by message
LARGEST_MESSAGE = 1 << 28  # [bytes]
FRAMES = "tf2_msgs/msg/TFMessage"
_SAME_AS = {"tf/msg/tfMessage": FRAMES}  # kinds of messages that were renamed


@dataclass(frozen=True)
class Topic:
    """A topic of a bag."""

    kind: str  # kind of its messages, such as `sensor_msgs/msg/JointState`
    count: int  # number of messages


def is_bag(path: Path, head: bytes) -> bool:
    """Whether a path is a ROS bag: by its suffix, or the metadata in the folder."""
    return path.suffix.lower() in BEGINNINGS or (path / "metadata.yaml").is_file()


def bag_parts(path: Path) -> list[Path]:
    """Return the files of a bag, which is a file or a folder."""
    return sorted(x for x in path.iterdir() if x.suffix.lower() in BEGINNINGS) if path.is_dir() else [path]


def bag_topics(path: Path | str) -> dict[str, Topic]:
    """Return the topics of a bag by name."""
    found: dict[str, Topic] = {}
    with _opened(path) as (bag, _):
        for c in bag.connections:
            before = found[c.topic].count if c.topic in found else 0
            found[c.topic] = Topic(_SAME_AS.get(c.msgtype, c.msgtype), before + c.msgcount)
    return found


def bag_messages(path: Path | str, topics: Collection[str], kinds: Collection[str]) -> Iterator[tuple[str, int, Any]]:
    """Yield topic, the bag's time [ns] and the message, for each message of these topics and kinds."""
    with _opened(path) as (bag, ros):
        chosen = [c for c in bag.connections if c.topic in topics and _SAME_AS.get(c.msgtype, c.msgtype) in kinds]
        types = _types(ros)
        decode = types.deserialize_ros1 if ros == 1 else types.deserialize_cdr
        for c, time, data in bag.messages(chosen) if chosen else ():
            yield c.topic, time, decode(_unpacked(bytes(data)), _SAME_AS.get(c.msgtype, c.msgtype))


def stamp_of(message: Any) -> float:
    """Return the stamp in a message's header [s]."""
    return message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec


def best_clock(clocks: dict[str, list[float]], place: str) -> tuple[np.ndarray, str]:
    """Return the stamps [s] of the first of several clocks, by name, of which nearly all stamps can be right, NaN where
    one cannot, and the clock's name with the reasons against those before it. `place` locates the stamps in
    messages."""
    times, whose = common_clock({name: {place: stamps} for name, stamps in clocks.items() if stamps}, place)
    return times[place], whose


def common_clock(
    clocks: Mapping[str, Mapping[str, Sequence[float]]], place: str, *, against: Sequence[str] = ()
) -> tuple[dict[str, np.ndarray], str]:
    """Return the stamps [s] by topic of the first of several clocks of which nearly all stamps of all topics can be
    right, NaN where one cannot, and the clock's name with the reasons against those before it.

    `clocks` are stamps [s] by clock and topic; `place` locates them in messages, and `against` are reasons against
    clocks that were left out before.
    """
    said = list(against)
    for whose, topics in clocks.items():
        stamps = {topic: np.array(times) for topic, times in topics.items()}
        try:
            keep = {topic: good_stamps(times, whose)[0] for topic, times in stamps.items()}
        except InputError as error:
            said.append(f"{whose}: {error.given}")
            continue
        others = "".join(f"; not by {other}" for other in said)
        return {topic: np.where(keep[topic], times, np.nan) for topic, times in stamps.items()}, whose + others
    fix = "state the key timestamps in the sidecar"
    raise InputError(place, f"time stamps that do not increase ({'; '.join(said)})", "increasing stamps", fix)


@contextmanager
def _opened(path: Path | str) -> Iterator[tuple[Any, int]]:
    """A reader of rosbags, and the version of ROS."""
    path = Path(path)
    ros = 1 if path.suffix.lower() == ".bag" and not path.is_dir() else 2
    module = optional(f"rosbags.rosbag{ros}", "ROS bags")
    if path.is_dir():
        whole_file(path / "metadata.yaml")
    else:
        path = whole_file(path, largest=np.inf)
        expected = BEGINNINGS.get(path.suffix.lower(), b"")
        with path.open("rb") as file:
            if not expected or file.read(len(expected)) != expected:
                raise InputError(str(path), f"no file {path.suffix}", f"a ROS bag: {', '.join(BEGINNINGS)}")
    with parsing(path, f"ROS {ros} bag"), module.Reader(path) as bag:
        yield bag, ros


@cache
def _types(ros: int) -> Any:
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    types = get_typestore(Stores.ROS1_NOETIC if ros == 1 else Stores.ROS2_HUMBLE)
    if FRAMES not in types.types:  # rosbags has it for ROS 2 alone
        types.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", FRAMES))
    return types


def _unpacked(data: bytes) -> bytes:
    """A message without the compression that RealSense may have put around it."""
    if not data.startswith(ZSTD):
        return data
    zstd = optional("backports.zstd", "compressed bags")  # rosbags brings it
    return zstd.ZstdDecompressor().decompress(data, LARGEST_MESSAGE)
