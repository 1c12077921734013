"""C3D files, written by ezc3d, and every kind of damage."""

import struct

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


def with_analog(path, words: int) -> None:
    """Put analog numbers into each frame, which the header counts, and no parameter."""
    data = path.read_bytes()
    start = 512 * (struct.unpack("<H", data[16:18])[0] - 1)
    frames = np.frombuffer(data[start : start + T * 8 * 4], "<f4").reshape(T, 8)
    body = np.hstack([frames, np.full((T, words), 0.5, "<f4")]).astype("<f4").tobytes()
    head = data[:4] + struct.pack("<H", words) + data[6:18] + struct.pack("<H", 1) + data[20:start]
    path.write_bytes(head + body + b"\0" * (-len(body) % 512))


def test_analog_numbers_that_no_parameter_announces_move_no_marker(tmp_path):
    """Where a reader steps by the parameters, every frame but the first is read from amidst another one."""
    write_c3d(tmp_path / "a.c3d")
    plain = read_recording(tmp_path / "a.c3d")
    for words in (1, 8, 40):
        write_c3d(tmp_path / "b.c3d")
        with_analog(tmp_path / "b.c3d", words)
        found = read_recording(tmp_path / "b.c3d")
        np.testing.assert_array_equal(found.points, plain.points)
        assert any(
            f"the header counts 2 points and {words} analog numbers a frame, and the parameters 2 and 0" in x
            for x in found.notes
        )
    data = (tmp_path / "b.c3d").read_bytes()
    (tmp_path / "b.c3d").write_bytes(data[:4] + struct.pack("<H", 5) + data[6:])
    with pytest.raises(
        InputError,
        match="header: got 'the header counts 2 points and 5 analog numbers a frame, and the parameters 2 and 0'",
    ):
        read_recording(tmp_path / "b.c3d")


def test_points_that_no_parameter_announces_move_no_marker(tmp_path):
    """A third point in each frame, which the header counts."""
    write_c3d(tmp_path / "a.c3d")
    plain = read_recording(tmp_path / "a.c3d")
    with_analog(tmp_path / "a.c3d", 4)
    data = (tmp_path / "a.c3d").read_bytes()
    (tmp_path / "a.c3d").write_bytes(data[:2] + struct.pack("<2H", 3, 0) + data[6:])
    found = read_recording(tmp_path / "a.c3d")
    np.testing.assert_array_equal(found.points[:, :2], plain.points)
    assert found.markers == (*plain.markers, "marker3")


def test_frames_that_a_header_cannot_count_are_read(tmp_path):
    import ezc3d

    c3d, count = ezc3d.c3d(), 66_000
    group = c3d["parameters"]["POINT"]
    group["RATE"]["value"], group["UNITS"]["value"], group["LABELS"]["value"] = [1000.0], ["mm"], ["tip"]
    c3d.add_parameter("POINT", "X_SCREEN", ["+X"])
    c3d.add_parameter("POINT", "Y_SCREEN", ["+Z"])
    height = 500 * np.cos(np.arange(count) / 1e4)
    c3d["data"]["points"] = np.stack([np.ones(count), np.ones(count), height, np.ones(count)])[:, None]
    c3d.write(str(tmp_path / "a.c3d"))
    found = read_recording(tmp_path / "a.c3d")
    np.testing.assert_allclose(found.marker("tip")[:, 1], height / 1e3, rtol=1e-6)
    np.testing.assert_allclose(found.t, np.arange(count) / 1e3)
    assert any(note.startswith("66000 frames by the file's size") for note in found.notes)


@pytest.mark.parametrize(
    "start", [[100_000 & 0xFFFF, 100_000 >> 16], [100_000 - 2 * 65_536 + 0.0, 1], [1e5], [13, 0], [-1, -1], ["?"]]
)
def test_a_first_frame_that_a_header_cannot_count_is_heard(tmp_path, start):
    """Words may be signed, or one number: a header holds 65535 instead, and times began at it without a word."""
    import ezc3d

    first = 12 if start[0] in (13, -1, "?") else 99_999
    write_c3d(tmp_path / "a.c3d", first=min(first, 65_534))
    c3d = ezc3d.c3d(str(tmp_path / "a.c3d"))
    c3d.add_parameter("TRIAL", "ACTUAL_START_FIELD", start)
    c3d.write(str(tmp_path / "b.c3d"))
    found = read_recording(tmp_path / "b.c3d")
    np.testing.assert_allclose(found.t, times() + first / FPS)
    assert any("ACTUAL_START_FIELD" in note for note in found.notes) == (first > 12)


def test_modelled_outputs_are_no_markers(tmp_path):
    import ezc3d

    c3d, labels = ezc3d.c3d(), ["tip", "LHipAngles", "LHipMoment", "Whip:Speed"]
    group = c3d["parameters"]["POINT"]
    group["RATE"]["value"], group["UNITS"]["value"], group["LABELS"]["value"] = [FPS], ["mm"], labels
    for name, value in (("X_SCREEN", "+X"), ("Y_SCREEN", "+Z"), ("ANGLES", "LHipAngles"), ("MOMENTS", "LHipMoment"),
                        ("SCALARS2", "Speed")):  # fmt: skip
        c3d.add_parameter("POINT", name, [value])
    c3d["data"]["points"] = np.random.default_rng(0).normal(size=(4, 4, T))
    c3d.write(str(tmp_path / "a.c3d"))
    found = read_recording(tmp_path / "a.c3d")
    assert found.markers == ("tip",)
    assert any(
        x == "left out 3 modelled outputs, which are no markers: LHipAngles, LHipMoment, Whip:Speed"
        for x in found.notes
    )


def test_points_without_a_separate_label_are_numbered(tmp_path):
    write_c3d(tmp_path / "a.c3d", labels=("tip", ""))
    found = read_recording(tmp_path / "a.c3d")
    assert found.markers == ("tip", "marker2")
    assert any("without a separate name" in note and "marker2" in note for note in found.notes)
    write_c3d(tmp_path / "b.c3d", labels=("tip", "tip"))
    assert read_recording(tmp_path / "b.c3d").markers == ("tip", "marker2")
