"""A recording of the RealSense SDK, made with its software device, played back through the camera."""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np
import pytest

from whiptool import extras
from whiptool.commands import doctor
from whiptool.errors import InputError, WhiptoolError
from whiptool.recording.camera import Camera, camera_preset, pinhole
from whiptool.vision import source
from whiptool.vision.source import RealSenseCamera, frames_of

SETTINGS = camera_preset("d435-infrared")
FRAMES = 10


def images() -> np.ndarray:
    """Grey images with a bright spot that moves."""
    some = np.full((FRAMES, SETTINGS.height, SETTINGS.width), 30, np.uint8)
    for i, image in enumerate(some):
        image[100 + 10 * i : 110 + 10 * i, 200:210] = 250
    return some


def record(rs, path: Path, settings: Camera) -> None:
    """Write the images as a camera of the SDK would, into a .db3 file."""
    device = rs.software_device()
    sensor = device.add_sensor("Stereo Module")
    lens = rs.intrinsics()
    lens.width, lens.height, lens.ppx, lens.ppy = settings.width, settings.height, 420.0, 241.0
    lens.fx, lens.fy, lens.model, lens.coeffs = 430.0, 431.0, rs.distortion.none, [0.0] * 5
    stream = rs.video_stream()
    stream.type, stream.index, stream.uid, stream.fmt = rs.stream.infrared, 1, 0, rs.format.y8
    stream.width, stream.height, stream.fps, stream.bpp = settings.width, settings.height, round(settings.fps), 1
    stream.intrinsics = lens
    profile = sensor.add_video_stream(stream).as_video_stream_profile()
    recorder = rs.recorder(str(path), device)
    recorded = recorder.query_sensors()[0]
    recorded.open(recorded.get_stream_profiles()[0])
    recorded.start(rs.frame_queue(FRAMES))
    kept = images()  # the SDK does not copy them
    for i, image in enumerate(kept):
        frame = rs.software_video_frame()
        frame.pixels, frame.stride, frame.bpp, frame.profile = image, settings.width, 1, profile
        frame.timestamp, frame.frame_number = 1000.0 + 10 * i, i + 1
        frame.domain = rs.timestamp_domain.hardware_clock
        sensor.on_video_frame(frame)
        time.sleep(0.02)  # the recorder drops what comes faster than it writes
    recorded.stop()
    recorded.close()
    del recorder  # closes the file


def test_a_recording_of_the_sdk_is_played_back(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """All of it, also where the machine is busy right after the stream was started."""
    try:
        rs = source.realsense()
    except WhiptoolError as error:
        pytest.skip(str(error))
    path = tmp_path / "strike.db3"
    try:
        record(rs, path, SETTINGS)
    except RuntimeError as error:
        pytest.skip(f"this SDK does not write .db3: {error}")
    start = rs.pipeline.start
    monkeypatch.setattr(rs.pipeline, "start", lambda *given: (start(*given), time.sleep(0.3))[0])
    camera = RealSenseCamera(SETTINGS, file=path)
    for _ in range(2):  # a recording can be played again
        frames = list(frames_of(camera))
        assert [frame.sequence for frame in frames] == list(range(1, FRAMES + 1))
        np.testing.assert_array_equal([frame.image for frame in frames], images())
        middles = np.array([frame.t for frame in frames]) + SETTINGS.exposure / 2
        np.testing.assert_allclose(middles, 1 + 0.01 * np.arange(FRAMES), atol=1e-6)
        lens = frames[0].settings
        assert lens == SETTINGS.replace(camera_matrix=pinhole(430, 431, 420, 241))


def test_doctor_says_what_the_camera_lacks(monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(name: str) -> None:
        raise ImportError("libusb-1.0.so.0: cannot open shared object file")

    monkeypatch.setattr(doctor, "version", lambda name: "2.59")
    monkeypatch.setattr(extras, "import_module", missing)
    (finding,) = doctor._camera()
    assert "libusb" in finding.found
    assert finding.fix == "apt-get install libusb-1.0-0"
    monkeypatch.setattr(extras, "import_module", lambda name: object())
    assert doctor._camera()[0].fix == ""
    monkeypatch.setattr(doctor, "_version", lambda name: None)
    assert doctor._camera() == []


SEEN = {"width": 424, "camera_matrix": pinhole(426, 426, 211.5, 239.5)}  # all that the tip can reach
CAMERA = camera_preset("d435-infrared").replace(**SEEN)


class FakeSdk:
    """As much of pyrealsense2 as the camera uses, in front of two images."""

    class stream:
        color, infrared = "color", "infrared"

    class format:
        rgb8, y8 = "rgb8", "y8"

    class option:
        enable_auto_exposure, exposure, emitter_enabled = "auto", "exposure", "emitter"

    def __init__(self, settings):
        self.settings, self.set, self.left, self.stopped, self.asked = settings, {}, 2, 0, []

    def __getattr__(self, name):  # every object of the SDK is this one
        return lambda *words, **named: self.asked.append((name, *words)) or self

    def set_option(self, name, value):
        self.set[name] = value

    def supports(self, name):
        return True

    def get_intrinsics(self):
        s = self.settings
        return type(
            "Lens", (), {"width": s.width, "height": s.height, "fx": 430.0, "fy": 431.0, "ppx": 210.0, "ppy": 241.0}
        )

    def try_wait_for_frames(self, milliseconds):
        self.left -= 1
        return self.left >= 0, self

    def get_data(self):
        s = self.settings
        return np.full((s.height, s.width), 7, np.uint8)

    def get_timestamp(self):
        return 1000.0 - 10 * self.left

    def get_frame_number(self):
        return 5 - self.left

    def stop(self):
        self.stopped += 1


def test_a_realsense_gives_frames_of_its_own_lens(monkeypatch, tmp_path):
    from whiptool.vision.source import FrameSource, frames_of

    sdk = FakeSdk(CAMERA)
    monkeypatch.setitem(sys.modules, "pyrealsense2", sdk)
    camera = source.RealSenseCamera(CAMERA, serial="123")
    assert isinstance(camera, FrameSource)
    with pytest.raises(InputError, match="open"):
        camera.read()
    frames = list(frames_of(camera))
    assert ("enable_device", "123") in sdk.asked
    assert ("enable_stream", "infrared", 1, 424, 480, "y8", 90) in sdk.asked
    assert sdk.set == {"auto": 0, "exposure": 2000, "emitter": 0}
    assert [frame.sequence for frame in frames] == [4, 5]
    np.testing.assert_allclose([frame.t for frame in frames], [0.989, 0.999])
    assert frames[0].settings.camera_matrix.tolist() == [[430, 0, 210], [0, 431, 241], [0, 0, 1]]
    np.testing.assert_array_equal(frames[0].settings.position, CAMERA.position)
    assert sdk.stopped == 1
    camera.close()
    assert sdk.stopped == 1
    with pytest.raises(InputError, match="exists"):
        source.RealSenseCamera(CAMERA, file=tmp_path / "none.bag")


def test_a_realsense_without_its_libraries_says_what_to_install(monkeypatch):
    for reason, fix in (("libusb-1.0.so.0: cannot open", "apt-get install libusb-1.0-0"), ("No module", "pip install")):

        def missing(name, reason=reason):
            raise ImportError(reason)

        monkeypatch.setattr("whiptool.extras.import_module", missing)
        with pytest.raises(InputError, match=fix):
            source.RealSenseCamera(CAMERA).open()
