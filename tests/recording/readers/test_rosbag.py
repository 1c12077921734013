"""ROS 2 bags, written by rosbags, and every kind of damage."""

import shutil

import numpy as np
import pytest
from recordings import H, T, fuzz, images, times

from whiptool.errors import InputError
from whiptool.recording.camera import Camera, write_cameras
from whiptool.recording.readers import (
    db3_frames,
    db3_topics,
    open_video,
)


def coloured(count: int = T) -> list[np.ndarray]:
    return [image // np.array([1, 2, 4], np.uint8) for image in images(count)]


def write_bag(folder, *, encoding="bgr8", metadata=False, compress=False, stamps=None, written=None, count=T):
    """A bag of rosbags' own writer; gives its .db3 file."""
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    shutil.rmtree(folder, ignore_errors=True)
    store = get_typestore(Stores.ROS2_HUMBLE)
    Image, Header, Time, Text = (
        store.types[x]
        for x in ("sensor_msgs/msg/Image", "std_msgs/msg/Header", "builtin_interfaces/msg/Time", "std_msgs/msg/String")
    )
    pack = lambda data: bytes(data)  # noqa: E731
    if compress:
        from backports import zstd

        pack = lambda data: zstd.compress(bytes(data))  # noqa: E731
    head = "/device_0/sensor_1/Color_0/image"
    with Writer(folder, version=9, storage_plugin=StoragePlugin.SQLITE3) as writer:
        topic = writer.add_connection(f"{head}/data", Image.__msgtype__, typestore=store)
        notes = writer.add_connection(f"{head}/metadata", Text.__msgtype__, typestore=store) if metadata else None
        for k, image in enumerate(coloured(count)):
            ns = int(1e9 + 1e9 * (times()[k] if stamps is None else stamps[k]))
            pixels = {"rgb8": image[..., ::-1], "16UC1": 257 * image[..., 0].astype("<u2")}.get(encoding, image)
            pixels = image[..., 0] if encoding in ("8UC1", "mono8") else pixels
            data = np.frombuffer(np.ascontiguousarray(pixels).tobytes(), np.uint8)
            header = Header(stamp=Time(sec=ns // 10**9, nanosec=ns % 10**9), frame_id="")
            step = data.size // 48
            message = Image(header=header, height=48, width=64, encoding=encoding, is_bigendian=0, step=step, data=data)
            writer.write(
                topic,
                ns if written is None else int(1e9 + 1e9 * written[k]),
                pack(store.serialize_cdr(message, Image.__msgtype__)),
            )
            if notes is not None:
                note = Text(data=f"Frame number={k};timestamp={5000 + 1000 * times()[k] * 1.01:.6f};")
                writer.write(notes, ns, pack(store.serialize_cdr(note, Text.__msgtype__)))
    return folder / f"{folder.name}.db3"


@pytest.mark.parametrize("encoding", ["bgr8", "rgb8", "8UC1", "mono8", "16UC1"])
def test_db3(tmp_path, encoding):
    file = write_bag(tmp_path / "bag", encoding=encoding)
    bare = tmp_path / "a.db3"  # as RealSense writes them, without metadata.yaml
    shutil.copy(file, bare)
    (topic,) = db3_topics(bare)
    assert db3_topics(tmp_path / "bag") == {topic: T}
    for path in (bare, tmp_path / "bag"):
        video = open_video(path, homography=H, exposure=0.002)
        np.testing.assert_allclose(video.times, times(), atol=1e-6)
        for (stamp, image), expected in zip(db3_frames(path, topic), coloured()):
            expected = expected if image.ndim == 3 else expected[..., 0]
            np.testing.assert_array_equal(image, expected.astype(np.uint16) * 257 if encoding == "16UC1" else expected)
            assert stamp >= 1
    absolute = open_video(bare, start=1.1)
    np.testing.assert_allclose(absolute.times, times() - 0.1, atol=1e-6)


def test_db3_of_a_camera_in_space(tmp_path):
    """Which camera it was stands in the sidecar or the options, as for a video."""
    lens = np.array([[50.0, 0, 32], [0, 50, 24], [0, 0, 1]])
    left = Camera("left", 64, 48, lens, np.eye(3), np.ones(3), exposure=2e-3, readout=0.012)
    write_cameras(tmp_path / "cameras.toml", {"left": left})
    video = open_video(write_bag(tmp_path / "bag"), cameras=tmp_path / "cameras.toml", camera="left", stamp="start")
    assert video.view.readout == pytest.approx(0.012)
    np.testing.assert_allclose(video.times, times() + 1e-3, atol=1e-6)


def test_db3_of_realsense(tmp_path):
    """Compressed message by message, the camera's own clock in a metadata topic."""
    video = open_video(write_bag(tmp_path / "bag", metadata=True, compress=True))
    np.testing.assert_allclose(video.times, 1.01 * times(), atol=1e-6)
    np.testing.assert_array_equal(list(video.frames()), coloured())


@pytest.mark.parametrize("value", [0.0, 11 / 60, -1.0])
def test_one_bad_stamp_costs_its_image_and_not_the_clock(tmp_path, value):
    """The bag was written 1 % too fast; the header of one image is zero, doubled or of long ago."""
    stamps = times().copy()
    stamps[12] = value
    file = write_bag(tmp_path / "bag", stamps=stamps, written=1.01 * times())
    for options in ({}, {"fps": 59.0}):
        video = open_video(file, **options)
        np.testing.assert_allclose(video.times, np.delete(times(), 12), atol=1e-6)
        np.testing.assert_array_equal(list(video.frames()), np.delete(coloured(), 12, axis=0))
        said = "; ".join(video.about["notes"])
        assert "times from the images' header stamps" in said
        assert "left out 1 of 30" in said


def test_a_clock_that_stands_still_is_left_for_the_next(tmp_path):
    video = open_video(write_bag(tmp_path / "bag", stamps=np.full(T, 3.0), written=times()))
    np.testing.assert_allclose(video.times, times(), atol=1e-6)
    assert "times at which the bag was written; not by the images' header stamps" in video.about["notes"][0]


@pytest.mark.parametrize(
    ("written", "options", "said"),
    [
        ({"encoding": "yuv422"}, {}, "one of mono8"),
        ({"count": 1}, {}, "at least two"),
        ({}, {"topic": "/nowhere"}, "Color_0/image/data"),
        ({"stamps": np.r_[0.5, times()[1:]]}, {"timestamps": times()[:9]}, "30, one per frame"),
    ],
)
def test_db3_damage(tmp_path, written, options, said):
    file = write_bag(tmp_path / "bag", **written)
    with pytest.raises(InputError, match=said):
        list(open_video(file, **options).frames())


def test_fuzz_db3(tmp_path):
    file = write_bag(tmp_path / "bag", metadata=True, count=3)
    fuzz(file, 50, lambda: list(open_video(file).frames()))
