"""C3D files, written by ezc3d, and every kind of damage."""

import numpy as np
import pytest
from recordings import FPS, T, fuzz, places, times

from whiptool.errors import InputError
from whiptool.recording.readers import (
    read_recording,
)


def write_c3d(path, *, points=None, units="mm", rate=FPS, first=0, screen=("+X", "+Z"), labels=("TIP", "Hand")) -> None:
    import ezc3d

    points = 1e3 * places(d=3) if points is None else points
    c3d = ezc3d.c3d()
    group = c3d["parameters"]["POINT"]
    group["RATE"]["value"], group["UNITS"]["value"], group["LABELS"]["value"] = [rate], [units], list(labels)
    if screen:
        c3d.add_parameter("POINT", "X_SCREEN", [screen[0]])
        c3d.add_parameter("POINT", "Y_SCREEN", [screen[1]])
    c3d["header"]["points"]["first_frame"] = first
    c3d["data"]["points"] = np.concatenate([points.transpose(2, 1, 0), np.ones((1, 2, T))])
    residuals = np.zeros((1, 2, T))
    residuals[0, 0, 9] = -1  # the place is there, and not to be trusted
    c3d["data"]["meta_points"]["residuals"] = residuals
    c3d.write(str(path))


def test_c3d(tmp_path):
    write_c3d(tmp_path / "a.c3d", first=12)
    r = read_recording(tmp_path / "a.c3d", markers={"tip": "TIP", "handle": "Hand"})
    expected = places(d=3)[:, :, [0, 2, 1]] * [1, 1, -1]  # z was up
    expected[9, 0] = np.nan
    np.testing.assert_allclose(r.points, expected, rtol=1e-6)
    np.testing.assert_allclose(r.t, times() + 12 / FPS)
    assert read_recording(tmp_path / "a.c3d").markers == ("tip", "Hand")
    assert read_recording(tmp_path / "a.c3d", start=0.2).t[0] == 0
    origin = read_recording(tmp_path / "a.c3d", origin=[100, 200, 300])
    np.testing.assert_allclose(origin.points[0, 0], r.points[0, 0] - [0.1, 0.3, -0.2], rtol=1e-5)


@pytest.mark.parametrize(
    ("written", "options", "said"),
    [
        ({"units": ""}, {}, "UNITS.*option units"),
        ({"screen": None}, {}, "which axis points up"),
        ({"units": "m"}, {}, "millimetres"),
        ({"rate": 0.5}, {}, "RATE"),
        ({}, {"markers": {"tip": "toe"}}, "TIP, Hand"),
    ],
)
def test_c3d_damage(tmp_path, written, options, said):
    write_c3d(tmp_path / "a.c3d", **written)
    with pytest.raises(InputError, match=said):
        read_recording(tmp_path / "a.c3d", **options)


def test_c3d_cut_off(tmp_path):
    write_c3d(tmp_path / "a.c3d")
    data = (tmp_path / "a.c3d").read_bytes()
    (tmp_path / "a.c3d").write_bytes(data[: len(data) - 200])
    with pytest.raises(InputError, match=r"cut off|whole C3D|its parser"):
        read_recording(tmp_path / "a.c3d")


@pytest.mark.heavy
def test_fuzz_c3d(tmp_path):
    write_c3d(tmp_path / "a.c3d")
    fuzz(tmp_path / "a.c3d", 20, lambda: read_recording(tmp_path / "a.c3d"))
