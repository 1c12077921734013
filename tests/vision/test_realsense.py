"""A recording of the RealSense SDK, made with its software device, played back through the camera."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pytest

from whiptool.commands import doctor
from whiptool.errors import WhiptoolError
from whiptool.vision import realsense
from whiptool.vision.camera_model import CameraSettings, camera_preset
from whiptool.vision.realsense import RealSenseCamera
from whiptool.vision.source import frames_of

pytestmark = pytest.mark.slow

SETTINGS = camera_preset("d435-infrared")
FRAMES = 10


def images() -> np.ndarray:
    """Grey images with a bright spot that moves."""
    some = np.full((FRAMES, SETTINGS.height, SETTINGS.width), 30, np.uint8)
    for i, image in enumerate(some):
        image[100 + 10 * i : 110 + 10 * i, 200:210] = 250
    return some


def record(rs, path: Path, settings: CameraSettings) -> None:
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


def test_a_recording_of_the_sdk_is_played_back(tmp_path: Path) -> None:
    try:
        rs = realsense.realsense()
    except WhiptoolError as error:
        pytest.skip(str(error))
    path = tmp_path / "strike.db3"
    try:
        record(rs, path, SETTINGS)
    except RuntimeError as error:
        pytest.skip(f"this SDK does not write .db3: {error}")
    camera = RealSenseCamera(SETTINGS, file=path)
    for _ in range(2):  # a recording can be played again
        frames = list(frames_of(camera))
        assert [frame.sequence for frame in frames] == list(range(1, FRAMES + 1))
        np.testing.assert_array_equal([frame.image for frame in frames], images())
        middles = np.array([frame.t for frame in frames]) + SETTINGS.exposure / 2
        np.testing.assert_allclose(middles, 1 + 0.01 * np.arange(FRAMES), atol=1e-6)
        lens = frames[0].settings
        assert (lens.fx, lens.fy, lens.cx, lens.cy) == (430.0, 431.0, 420.0, 241.0)
        assert lens.position == SETTINGS.position


def test_doctor_says_what_the_camera_lacks(monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(name: str) -> None:
        raise ImportError("libusb-1.0.so.0: cannot open shared object file")

    monkeypatch.setattr(doctor, "version", lambda name: "2.59")
    monkeypatch.setattr(realsense.importlib, "import_module", missing)
    (finding,) = doctor._camera()
    assert "libusb" in finding.found
    assert finding.fix == "apt-get install libusb-1.0-0"
    monkeypatch.setattr(realsense.importlib, "import_module", lambda name: object())
    assert doctor._camera()[0].fix == ""
    monkeypatch.setattr(doctor, "_version", lambda name: None)
    assert doctor._camera() == []
