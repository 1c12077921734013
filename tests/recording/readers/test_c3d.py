"""C3D files, written by ezc3d, and every kind of damage."""

import numpy as np
import pytest
from recordings import FPS, T, fuzz, places, times

from whiptool.errors import InputError
from whiptool.models.presets import preset
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


def turned(points: np.ndarray, forward: str, up: str) -> np.ndarray:
    """Places (x forward, y left, z up) as a file has them in whose axes these two point forward and up."""
    out = np.zeros_like(points)
    for column, axis in ((0, forward), (2, up)):
        out[..., "XYZ".index(axis[1])] = float(axis[0] + "1") * points[..., column]
    third = ({0, 1, 2} - {"XYZ".index(axis[1]) for axis in (forward, up)}).pop()
    unit = [float(axis[0] + "1") * np.eye(3)["XYZ".index(axis[1])] for axis in (up, forward)]
    out[..., third] = np.cross(*unit)[third] * points[..., 1]  # left is up x forward
    return out


@pytest.mark.parametrize("screen", [("+X", "+Z"), ("+X", "+Y"), ("+Y", "+Z"), ("-X", "+Z"), ("+Z", "-Y")])
def test_axes_of_the_screen_serve_plane_and_space(tmp_path, screen):
    """The screen says which axis is up; in space that is z, in the plane y: no model is turned by 90 degrees."""
    places_in_space = places(d=3)
    write_c3d(tmp_path / "a.c3d", points=1e3 * turned(places_in_space, *screen), screen=screen)
    r = read_recording(tmp_path / "a.c3d", markers={"tip": "TIP", "handle": "Hand"})
    seen = ~np.isnan(r.points)
    in_space = r.for_model(preset("ur5e"))
    np.testing.assert_allclose(in_space.points, np.where(seen, places_in_space, np.nan), rtol=1e-6)
    assert in_space.for_model(preset("ur5e")) is in_space
    in_plane = in_space.for_model(preset("lemon2024"))
    np.testing.assert_allclose(in_plane.points[..., 0], np.where(seen, places_in_space, np.nan)[..., 0], rtol=1e-6)
    np.testing.assert_allclose(in_plane.points[..., 1], np.where(seen, places_in_space, np.nan)[..., 2], rtol=1e-6)
    assert any(
        f"{screen[1]} is up" in note and f"{screen[0]} (X_SCREEN) taken as forward" in note for note in r.remarks
    )
    said = read_recording(tmp_path / "a.c3d", axes=["x", "y", "z"])  # whoever says axes means the model's
    np.testing.assert_array_equal(said.for_model(preset("ur5e")).points, said.points)


def test_the_origin_of_the_file_is_no_place(tmp_path):
    """As exporters write a marker that was not seen."""
    points = 1e3 * places(d=3)
    points[[3, 20], 0] = 0
    write_c3d(tmp_path / "a.c3d", points=points)
    r = read_recording(tmp_path / "a.c3d", origin=[100, 200, 300])
    assert not r.seen[[3, 20], 0].any()
    assert r.seen[:, 0].sum() == T - 3  # and one has a negative residual
    assert any("2 points at (0, 0, 0) taken as missing" in note for note in r.remarks)


@pytest.mark.parametrize(("units", "factor"), [("mm", 1e3), ("cm", 100), ("m", 1), ("Meters", 1), ("MM", 1e3)])
def test_units_of_the_file_are_heard(tmp_path, units, factor):
    write_c3d(tmp_path / "a.c3d", points=factor * places(d=3), units=units)
    np.testing.assert_allclose(
        read_recording(tmp_path / "a.c3d").points[0, 0], places(d=3)[0, 0, [0, 2, 1]] * [1, 1, -1]
    )


@pytest.mark.parametrize(
    ("written", "options", "said"),
    [
        ({"units": ""}, {}, "UNITS.*units in the sidecar"),
        ({"screen": None}, {}, r"axes point forward, up and out \(no POINT:Y_SCREEN\)"),
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


def test_fuzz_c3d(tmp_path):
    write_c3d(tmp_path / "a.c3d")
    fuzz(tmp_path / "a.c3d", 20, lambda: read_recording(tmp_path / "a.c3d"))
