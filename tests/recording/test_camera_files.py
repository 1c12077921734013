"""Cameras come back from their file as they were written."""

from __future__ import annotations

import numpy as np
import pytest

from whiptool.errors import InputError
from whiptool.recording.camera_files import read_cameras, write_cameras
from whiptool.recording.space_camera import SpaceCamera, looking_at

K = np.array([[610.1, 0, 420.5], [0, 605.0, 238.0], [0, 0, 1]])
PLACE = np.array([2.0, -1.5, 0.8])
LEFT = SpaceCamera(
    "left", 848, 480, K, looking_at(PLACE, (0, 0, 1 / 3)), PLACE, (0.1, -0.2, 1e-3, -8e-4), 90.0, 2e-3, 0.01
)
RIGHT = SpaceCamera("right", 640, 480, K, looking_at(-PLACE, (0, 0, 1 / 3)), -PLACE)


def test_a_file_gives_back_the_cameras(tmp_path):
    file = tmp_path / "cameras.toml"
    write_cameras(file, {"left": LEFT, "right": RIGHT})
    read = read_cameras(file)
    assert list(read) == ["left", "right"]
    points = np.random.default_rng(0).uniform(-0.5, 0.5, (9, 3))
    for camera in (LEFT, RIGHT):
        np.testing.assert_array_equal(read[camera.name].project(points), camera.project(points))
        for name in ("width", "height", "fps", "exposure", "readout", "distortion", "name"):
            assert getattr(read[camera.name], name) == getattr(camera, name)


@pytest.mark.parametrize(
    ("changed", "told"),
    [
        (lambda text: "a = 1", r"cameras\.toml: got 'a'"),
        (lambda text: "[", "valid TOML"),
        (lambda text: text.replace("width = 848", ""), r"cameras\.left\.width: got None"),
        (lambda text: text.replace("width", "wide"), r"cameras\.left\.wide"),
        (lambda text: text.replace("width = 848", "width = 0"), r"cameras\.left\.width: got 0"),
        (lambda text: text.replace("width = 848", 'width = "a"'), r"cameras\.left"),
        (lambda text: text.replace("848", '848\nname = "x"'), r"cameras\.left"),
    ],
)
def test_what_is_no_file_of_cameras_gets_one_line(changed, told, tmp_path):
    file = tmp_path / "cameras.toml"
    write_cameras(file, {"left": LEFT})
    file.write_text(changed(file.read_text()))
    with pytest.raises(InputError, match=told) as error:
        read_cameras(file)
    assert "\n" not in str(error.value)
