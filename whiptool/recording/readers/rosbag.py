"""Images from ROS bags: recordings of RealSense, and of `ros2 bag record` and `rosbag record`.

A bag is a `.db3`, `.mcap` or `.bag` file, or a folder with `metadata.yaml`. Its sidecar is `NAME.toml` next to the file
or `whiptool.toml` in the folder; besides the keys of `whiptool.recording.readers.footage` it can name the `topic`.
Times are those of the camera (RealSense writes them to a metadata topic), the stamps of the images, or those of the
bag: the first of these that nearly always increase. An image with a bad stamp is left out. `start` refers to that
clock; without it the first image is at 0. A key `timestamps` overrides these times.

Only `sensor_msgs/Image` as defined by rosbags is decoded; definitions in the bag are not used.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from whiptool.errors import InputError
from whiptool.given_files import number_in, parsing, sha256
from whiptool.recording.readers.bag_files import bag_messages, bag_parts, bag_topics, best_clock, stamp_of
from whiptool.recording.readers.bag_logs import PLACES
from whiptool.recording.readers.footage import VideoSource, frame_clock, source
from whiptool.recording.readers.keys import refuse_unheard
from whiptool.recording.readers.sidecar import CLOCK, FILM, PIXELS, SPACE, Sidecar

IMAGE, TEXT = "sensor_msgs/msg/Image", "std_msgs/msg/String"
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
    """Return the topics with images, and the number of images of each."""
    return {name: topic.count for name, topic in bag_topics(path).items() if topic.kind == IMAGE}


def db3_frames(path: Path | str, topic: str | None = None) -> Iterator[tuple[float, np.ndarray]]:
    """Yield the time stamp in the header [s] and the image of each message of a topic, by default the only one with
    images, in the order of recording. An image is (H, W, 3) uint8 in the order BGR, or (H, W) uint8 or uint16. `path`
    is the `.db3` file, or the bag's folder."""
    topic = _one_topic(path, topic)
    for _, _, message in bag_messages(path, [topic], [IMAGE]):
        with parsing(Path(path), "ROS bag"):
            image = decode_image(message)
        yield stamp_of(message), image


def decode_image(message: Any) -> np.ndarray:
    """Convert a `sensor_msgs/Image` to an array: (H, W, 3) uint8 in the order BGR, or (H, W) uint8 or uint16."""
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
    """Return the images of one topic of a bag, a `.db3` file or a folder; `options` are keys of its sidecar, whose
    values they override."""
    path = Path(path)
    side = bag_sidecar(path, options)
    topic = _one_topic(path, side.table.get("topic"))
    own = _camera_times(path, topic)
    shapes, stamps, bag_times = set(), [], []
    for _, bag_time, message in bag_messages(path, [topic], [IMAGE]):
        shapes.add((message.height, message.width, message.encoding))
        stamps.append(stamp_of(message))
        bag_times.append(bag_time)
    if len(stamps) < 2:
        raise InputError(str(path), f"{len(stamps)} images on {topic}", "at least two")
    if len(shapes) > 1:
        raise InputError(str(path), f"images of {len(shapes)} sizes or encodings", "images of one size and encoding")
    if "timestamps" in side.table:
        clock = frame_clock(side, len(stamps))
    else:
        times, whose = best_clock(
            {
                "the camera's own stamps": [own.get(time, np.nan) for time in bag_times] if own else [],
                "the images' header stamps": stamps,
                "the times at which the bag was written": [1e-9 * time for time in bag_times],
            },
            str(path),
        )
        side = side.starting(float(np.nanmin(times)))
        clock = frame_clock(side, len(stamps), stamps=times, of=whose)
    files = bag_parts(path)
    frames = lambda: (image for _, image in db3_frames(path, topic))  # noqa: E731
    others = (*SPACE, "markers", "sigma") if any(x.kind in PLACES for x in bag_topics(path).values()) else ()
    return source(side, frames, clock, next(iter(shapes))[:2], path, sha256(files), others=others)


def bag_sidecar(path: Path, options: dict[str, Any]) -> Sidecar:
    """Return the sidecar of a bag: `NAME.toml` next to the file, or `whiptool.toml` in the folder; one next to a folder
    is refused, because nothing reads it."""
    if path.is_dir():
        refuse_unheard(path, "a bag in a folder", "move it into the folder, as whiptool.toml")
    keys = (*CLOCK, *PIXELS, *FILM, *SPACE, "topic", "markers", "sigma")
    return Sidecar.of(path, options, *keys, file=path / "whiptool.toml" if path.is_dir() else None)


def _one_topic(path: Path | str, topic: str | None) -> str:
    topics = db3_topics(path)
    if topic is None and len(topics) == 1:
        return next(iter(topics))
    if topic not in topics:
        name = f"{path}: topic" if topics else f"{path}: topics"
        raise InputError(name, topic, "one of the topics of images: " + (", ".join(topics) or "none"))
    return topic


def _camera_times(path: Path, topic: str) -> dict[int, float]:
    """The camera's own time [s] of each image by the bag's time [ns], where RealSense's metadata has it."""
    head, _, last = topic.rpartition("/")
    if last != "data":
        return {}
    times = {}
    for _, bag_time, message in bag_messages(path, [f"{head}/metadata"], [TEXT]):
        pairs = dict(pair.partition("=")[::2] for pair in message.data.split(";"))
        try:
            times[bag_time] = 1e-3 * number_in(pairs["timestamp"])
        except (KeyError, ValueError):
            return {}
    return times
