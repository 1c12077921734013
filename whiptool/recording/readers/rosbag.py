"""Images from ROS 2 bags in SQLite (`.db3`): recordings of RealSense, and of `ros2 bag record`.

A bag is one `.db3` file or a folder with `metadata.yaml`. Its sidecar is `NAME.toml` next to the file or
`whiptool.toml` in the folder; in addition to the keys of `whiptool.recording.readers.footage` it can name the `topic`.
Times are those of the camera (RealSense writes them to a metadata topic), the stamps of the images, or those of the
bag: the first of these that nearly always increase. An image with a bad stamp is left out. `start` refers to that
clock; without it the first image is at 0. A key `timestamps` overrides these times.

Only `sensor_msgs/Image` as defined by rosbags is decoded; definitions in the bag are not used.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from whiptool.errors import InputError
from whiptool.extras import optional
from whiptool.given_files import parsing, sha256, whole_file
from whiptool.recording.logs import good_stamps
from whiptool.recording.readers.footage import VideoSource, frame_clock, source
from whiptool.recording.readers.sidecar import CLOCK, FILM, PIXELS, Sidecar

IMAGE, TEXT = "sensor_msgs/msg/Image", "std_msgs/msg/String"
ZSTD = b"\x28\xb5\x2f\xfd"  # RealSense compresses message by message
LARGEST_MESSAGE = 1 << 28  # [bytes]
ENCODINGS = {  # type of a number, how many a pixel, whether red comes first
    "mono8": ("u1", 1, False),
    "8UC1": ("u1", 1, False),
    "mono16": ("u2", 1, False),
    "16UC1": ("u2", 1, False),
    "bgr8": ("u1", 3, False),
    "8UC3": ("u1", 3, False),
    "rgb8": ("u1", 3, True),
    "bgra8": ("u1", 4, False),
    "rgba8": ("u1", 4, True),
}


def db3_topics(path: Path | str) -> dict[str, int]:
    """Return the topics with images, and the number of images of each.

    Raises:
        InputError: The file is not a bag or is damaged; or rosbags is not installed.
    """
    with _opened(path) as bag:
        return {c.topic: c.msgcount for c in bag.connections if c.msgtype == IMAGE}


def db3_frames(path: Path | str, topic: str | None = None) -> Iterator[tuple[float, np.ndarray]]:
    """Yield time stamp [s] and image of each message of a topic, in the order of recording.

    Args:
        path: The `.db3` file, or the bag's folder.
        topic: Topic of the images; None if only one topic has images.

    Yields:
        The time stamp in the message's header, and the image: (H, W, 3) uint8 in the order BGR, or (H, W) uint8 or
            uint16.

    Raises:
        InputError: The file is not a bag or is damaged; the topic does not exist; an image is cut off or has another
            encoding than 16UC1, mono16, 8UC1, mono8, rgb8, bgr8, rgba8 or bgra8; or rosbags is not installed.
    """
    topic = _one_topic(path, topic)
    for _, message in _messages(path, topic, IMAGE):
        with parsing(Path(path), "ROS 2 bag"):
            image = decode_image(message)
        yield _stamp(message), image


def decode_image(message: Any) -> np.ndarray:
    """Convert a `sensor_msgs/Image` to an array: (H, W, 3) uint8 in the order BGR, or (H, W) uint8 or uint16.

    Raises:
        InputError: The encoding is not supported, or the data do not fit the image size.
    """
    if message.encoding not in ENCODINGS:
        raise InputError("encoding", message.encoding, "one of " + ", ".join(ENCODINGS))
    kind, channels, red_first = ENCODINGS[message.encoding]
    dtype = np.dtype(kind).newbyteorder(">" if message.is_bigendian else "<")
    height, width, step = message.height, message.width, message.step
    row = width * channels * dtype.itemsize
    data = np.asarray(message.data, np.uint8)
    if not (height and width) or step < row or data.size < step * height:
        raise InputError("image", f"{data.size} bytes", f"{height} rows of {step} bytes for {width} pixels")
    image = np.ascontiguousarray(data[: step * height].reshape(height, step)[:, :row]).view(dtype)
    image = image.reshape(height, width, channels).astype(dtype.newbyteorder("="))
    if channels == 1:
        return image[..., 0]
    return np.ascontiguousarray(image[..., [2, 1, 0]] if red_first else image[..., :3])


def read_db3(path: Path | str, **options: Any) -> VideoSource:
    """Return the images of one topic of a bag.

    Args:
        path: The `.db3` file, or the bag's folder.
        options: Keys of the sidecar file, whose values they override.

    Raises:
        InputError: See `db3_frames`; or there are fewer than two images, they differ in size, or a value is not
            allowed.
    """
    path = Path(path)
    folder = path.is_dir()
    side = Sidecar.of(path, options, *CLOCK, *PIXELS, *FILM, "topic", file=path / "whiptool.toml" if folder else None)
    topic = _one_topic(path, side.table.get("topic"))
    own = _camera_times(path, topic)
    shapes, stamps, bag_times = set(), [], []
    for bag_time, message in _messages(path, topic, IMAGE):
        shapes.add((message.height, message.width, message.encoding))
        stamps.append(_stamp(message))
        bag_times.append(bag_time)
    if len(stamps) < 2:
        raise InputError(str(path), f"{len(stamps)} images on {topic}", "at least two")
    if len(shapes) > 1:
        raise InputError(str(path), f"images of {len(shapes)} sizes or encodings", "images of one size and encoding")
    if "timestamps" in side.table:
        clock = frame_clock(side, len(stamps))
    else:
        times, whose = _best_clock(
            {
                "the camera's own stamps": [own.get(time, np.nan) for time in bag_times] if own else [],
                "the images' header stamps": stamps,
                "the times at which the bag was written": [1e-9 * time for time in bag_times],
            },
            str(path),
        )
        origin = 0.0 if "start" in side.table else float(np.nanmin(times))
        clock = frame_clock(side, len(stamps), stamps=times - origin, of=whose)
    files = sorted(path.glob("*.db3")) if folder else [path]
    frames = lambda: (image for _, image in db3_frames(path, topic))  # noqa: E731
    return source(side, frames, clock, next(iter(shapes))[:2], path, sha256(files))


def _best_clock(clocks: dict[str, list[float]], place: str) -> tuple[np.ndarray, str]:
    """Return the first of several clocks of which nearly all stamps can be right, NaN for the others, and its name."""
    said = []
    for whose, times in clocks.items():
        if not times:
            continue
        stamps = np.array(times)
        try:
            keep, _ = good_stamps(stamps, whose)
        except InputError as error:
            said.append(f"{whose}: {error.given}")
            continue
        others = "".join(f"; not by {other}" for other in said)
        return np.where(keep, stamps, np.nan), whose + others
    fix = "state the key timestamps in the sidecar"
    raise InputError(place, f"time stamps that do not increase ({'; '.join(said)})", "increasing stamps", fix)


@contextmanager
def _opened(path: Path | str) -> Iterator[Any]:
    path = Path(path)
    rosbag2 = optional("rosbags.rosbag2", "ROS 2 bags")
    if path.is_dir():
        whole_file(path / "metadata.yaml")
    else:
        path = whole_file(path, largest=np.inf)
        with path.open("rb") as file:
            if file.read(16) != b"SQLite format 3\0":
                raise InputError(str(path), "no SQLite file", "a ROS 2 bag in SQLite (.db3)")
    with parsing(path, "ROS 2 bag"), rosbag2.Reader(path) as bag:
        yield bag


def _messages(path: Path | str, topic: str, kind: str) -> Iterator[tuple[int, Any]]:
    """The bag's time [ns] and the message, for each message of a topic."""
    with _opened(path) as bag:
        chosen = [c for c in bag.connections if c.topic == topic and c.msgtype == kind]
        for _, time, data in bag.messages(chosen) if chosen else ():
            yield time, _types().deserialize_cdr(_unpacked(bytes(data)), kind)


@cache
def _types() -> Any:
    from rosbags.typesys import Stores, get_typestore

    return get_typestore(Stores.ROS2_HUMBLE)


def _unpacked(data: bytes) -> bytes:
    """A message without the compression that RealSense may have put around it."""
    if not data.startswith(ZSTD):
        return data
    zstd = optional("backports.zstd", "compressed bags")  # rosbags brings it
    return zstd.ZstdDecompressor().decompress(data, LARGEST_MESSAGE)


def _stamp(message: Any) -> float:
    return message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec


def _one_topic(path: Path | str, topic: str | None) -> str:
    topics = db3_topics(path)
    if topic is None and len(topics) == 1:
        return next(iter(topics))
    if topic not in topics:
        raise InputError(f"{path}: topic", topic, "one of the topics of images: " + (", ".join(topics) or "none"))
    return topic


def _camera_times(path: Path, topic: str) -> dict[int, float]:
    """The camera's own time [s] of each image by the bag's time [ns], where RealSense's metadata has it."""
    head, _, last = topic.rpartition("/")
    if last != "data":
        return {}
    times = {}
    for bag_time, message in _messages(path, f"{head}/metadata", TEXT):
        pairs = dict(pair.partition("=")[::2] for pair in message.data.split(";"))
        try:
            times[bag_time] = 1e-3 * float(pairs["timestamp"])
        except (KeyError, ValueError):
            return {}
    return times
