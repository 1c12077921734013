"""Films as frames with times, and every kind of damage."""

import dataclasses
import subprocess

import imageio_ffmpeg
import numpy as np
import pytest
import tomli_w
from recordings import FPS, STRIKE, TABLE, H, T, fuzz, images, times, write_rows, write_video

from whiptool.errors import InputError
from whiptool.recording.camera import Camera, write_cameras
from whiptool.recording.readers import (
    open_video,
    read_recording,
    video_frames,
)


@pytest.mark.parametrize(("name", "fourcc"), [("a.avi", "MJPG"), ("a.mp4", "mp4v")])
def test_video(tmp_path, name, fourcc):
    write_video(tmp_path / name, images(), fourcc)
    write_rows(tmp_path / "a.times.csv", [["frame", "t"], *[[k, t + 0.5] for k, t in enumerate(times())]])
    side = {
        "timestamps": "a.times.csv", "stamp": "start", "start": 0.5, "exposure": 0.004, "shutter": "rolling",
        "readout": 0.015, "homography": H.tolist(), "strike": TABLE, "camera": "D435",
    }  # fmt: skip
    (tmp_path / "a.toml").write_text(tomli_w.dumps(side))
    video = open_video(tmp_path / name)
    np.testing.assert_allclose(video.times, times() + 0.002)
    assert (len(video), video.shape, video.exposure, video.readout) == (T, (48, 64), 0.004, 0.015)
    assert video.fps == pytest.approx(FPS)
    assert (video.about["strike"], video.about["camera"]) == (STRIKE, "D435")
    np.testing.assert_array_equal(video.homography, H)
    for _ in range(2):  # as often as one likes
        for k, (_, image) in enumerate(video):
            assert np.argwhere(image[..., 0] > 127).mean(axis=0)[1] == pytest.approx(k + 3.5, abs=0.5)
    with pytest.raises(InputError, match="track"):
        read_recording(tmp_path / name)


def without_images(path, out, *gone: int, codec=("-c:v", "ffv1")) -> None:
    """A film again, some images left out and the stamps of the others kept, as recorders do."""
    chosen = "+".join(f"eq(n\\,{k})" for k in gone)
    told = ["-vf", f"select=not({chosen})", "-fps_mode", "vfr", *codec, str(out)]
    subprocess.run([imageio_ffmpeg.get_ffmpeg_exe(), "-y", "-v", "error", "-i", str(path), *told], check=True)


@pytest.mark.parametrize(("name", "codec"), [("b.mkv", ("-c:v", "ffv1")), ("b.mp4", ("-c:v", "mpeg4", "-q:v", "2"))])
def test_stamps_in_a_film_know_of_images_that_were_dropped(tmp_path, name, codec):
    write_video(tmp_path / "a.avi", images())
    without_images(tmp_path / "a.avi", tmp_path / name, 9, 20, 21, codec=codec)
    left = np.delete(times(), [9, 20, 21])
    for fps in (None, FPS, 61.0):
        video = open_video(tmp_path / name, **({} if fps is None else {"fps": fps}))
        np.testing.assert_allclose(video.times, left, atol=2e-4)  # stamps of MKV are in whole milliseconds
        (note,) = video.about["notes"]
        assert note.startswith("times from the film's own stamps")
        assert (", 60" in note) == (fps == 61)
    slow = open_video(tmp_path / name, fps=8 * FPS)
    np.testing.assert_allclose(slow.times, left / 8, atol=2e-5)
    assert "8 times slower than fps = 480: slow motion" in slow.about["notes"][0]


def test_a_bad_timestamp_costs_its_image(tmp_path):
    write_video(tmp_path / "a.avi", images())
    stamps = times().copy()
    stamps[12] = stamps[11]
    video = open_video(tmp_path / "a.avi", timestamps=stamps.tolist())
    np.testing.assert_array_equal(video.times, np.delete(times(), 12))
    places = [np.argwhere(image[..., 0] > 127).mean(axis=0)[1] for _, image in video]
    np.testing.assert_allclose(places, np.delete(np.arange(T), 12) + 3.5, atol=0.5)
    assert "left out 1 of 30" in "; ".join(video.about["notes"])


def test_a_film_of_a_camera_in_space(tmp_path):
    """Exposure and readout are the camera's, or those of this film; rows of a rolling shutter end after the last."""
    write_video(tmp_path / "a.avi", images())
    lens = np.array([[50.0, 0, 32], [0, 50, 24], [0, 0, 1]])
    left = Camera("left", 64, 48, lens, np.eye(3), np.ones(3), exposure=2e-3, readout=0.012)
    write_cameras(tmp_path / "cameras.toml", {"left": left})
    given = {"fps": FPS, "stamp": "start", "camera": "left", "cameras": "cameras.toml"}
    video = open_video(tmp_path / "a.avi", **given)
    assert video.homography is None
    assert (video.exposure, video.view.exposure, video.view.name) == (2e-3, 2e-3, "left")
    assert video.view.readout == pytest.approx(0.012)
    assert video.readout == pytest.approx(0.012 * 47 / 48)
    assert video.times[0] == pytest.approx(1e-3)
    assert video.view.fps == pytest.approx(FPS)
    video = open_video(tmp_path / "a.avi", **given, exposure=4e-3, readout=0.0047, shutter="rolling")
    assert (video.view.exposure, video.times[0]) == (4e-3, pytest.approx(2e-3))
    assert video.view.readout == pytest.approx(0.0048)
    for slip, said in (
        ({"camera": "top"}, "camera: got 'top'; allowed: the camera that saw it, one of left"),
        ({"cameras": "none.toml"}, "none.toml"),
        ({"scale": 0.01, "origin": [1, 2]}, "not both"),
        ({"cameras": "wide.toml"}, "got '64 x 48 pixels'; allowed: 128 x 48"),
    ):
        write_cameras(tmp_path / "wide.toml", {"left": dataclasses.replace(left, width=128)})
        with pytest.raises(InputError, match=said) as caught:
            open_video(tmp_path / "a.avi", **given | slip)
        assert "\n" not in str(caught.value)


def test_video_damage(tmp_path):
    write_video(tmp_path / "a.avi", images())
    with pytest.raises(InputError, match=r"fps or timestamps.*60"):
        open_video(tmp_path / "a.avi")
    with pytest.raises(InputError, match="30, one per frame"):
        open_video(tmp_path / "a.avi", timestamps=[0.0, 0.1])
    with pytest.raises(InputError, match="increasing"):
        open_video(tmp_path / "a.avi", timestamps=np.zeros(T))
    with pytest.raises(InputError, match=r"known_points\.pixels"):
        open_video(tmp_path / "a.avi", fps=FPS, known_points={"pixels": [[1]], "metres": [[1, 2]]})
    write_video(tmp_path / "b.avi", images(1))
    with pytest.raises(InputError, match="1 images"):
        open_video(tmp_path / "b.avi", fps=FPS)
    (tmp_path / "c.mp4").write_bytes(b"no video" * 99)
    with pytest.raises(InputError, match="decoded"):
        next(video_frames(tmp_path / "c.mp4"))


@pytest.mark.parametrize(("name", "fourcc"), [("a.avi", "MJPG"), ("a.mp4", "mp4v")])
def test_fuzz_video(tmp_path, name, fourcc):
    write_video(tmp_path / name, images(6), fourcc)
    fuzz(tmp_path / name, 40, lambda: list(open_video(tmp_path / name, fps=FPS)))
