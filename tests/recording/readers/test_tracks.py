"""Recordings in CSV, our own and others', and every kind of damage."""

import numpy as np
import pytest
import tomli_w
from recordings import FPS, STRIKE, TABLE, H, T, full, fuzz, places, plain_rows, same, times, to_pixels, write_rows

from whiptool.errors import InputError
from whiptool.recording.readers import (
    find_format,
    read_recording,
    write_csv,
)


def test_csv_round_trip(tmp_path):
    files = write_csv(full(), tmp_path / "a.csv")
    assert [f.name for f in files] == ["a.csv", "a.toml", "a.joints.csv"]
    same(read_recording(tmp_path / "a.csv"), full(), but=("source", "sha256"))


def test_csv_of_others(tmp_path):
    rows = plain_rows(3)
    rows[5][4] = ""  # an empty cell is a missing point
    rows = [[*row, extra] for row, extra in zip(rows, ["tip_sigma", *[0.5] * T])]
    write_rows(tmp_path / "a.csv", rows)
    side = {"units": "cm", "strike": TABLE, "start": 0.1, "axes": ["x", "z", "-y"], "target": [1.0, 0.2], "sigma": 0.02}
    (tmp_path / "a.toml").write_text(tomli_w.dumps(side))
    r = read_recording(tmp_path / "a.csv")
    expected = 0.01 * places(d=3)[:, :, [0, 2, 1]] * [1, 1, -1]
    expected[4] = np.where([[True], [False]], expected[4], np.nan)
    np.testing.assert_allclose(r.points, expected)
    np.testing.assert_allclose(r.t, times() - 0.1)
    np.testing.assert_allclose(r.sigma, np.broadcast_to([0.005, 0.02], (T, 2)))
    assert (r.strike, r.target) == (STRIKE, (1.0, 0.2))
    assert read_recording(tmp_path / "a.csv", start=0.0).t[0] == 0  # an option wins over the sidecar


@pytest.mark.parametrize(
    ("damage", "said"),
    [
        (lambda rows: rows[:0], "an empty file"),
        (lambda rows: rows[:1], "at least one row of numbers"),
        (lambda rows: rows[:2], "at least two times"),
        (lambda rows: [row[1:] for row in rows], "a column t"),
        (lambda rows: [row[:2] for row in rows], "tip_x and tip_y"),
        (lambda rows: [row[:1] for row in rows], "no markers"),
        (lambda rows: [["t", "tip", *rows[0][2:]], *rows[1:]], "MARKER with one of"),
        (lambda rows: [["t", "t", *rows[0][2:]], *rows[1:]], "different names"),
        (lambda rows: [*rows[:9], rows[9][:3], *rows[10:]], "row 10.*cut off"),
        (lambda rows: [*rows[:9], [*rows[9][:-1], "7,5"], *rows[10:]], "row 10, column 5"),
        (
            lambda rows: [*rows[:9], *[[rows[8][0], *row[1:]] for row in rows[9:14]], *rows[14:]],
            r"samples 8 to 13.*later than",
        ),
        (lambda rows: [rows[0], *[[1000 * x for x in row] for row in rows[1:]]], "millimetres|milliseconds"),
        (lambda rows: [rows[0], *[[row[0], *[500 * x for x in row[1:]]] for row in rows[1:]]], "millimetres or pixels"),
    ],
)
def test_csv_damage(tmp_path, damage, said):
    write_rows(tmp_path / "a.csv", damage(plain_rows()))
    with pytest.raises(InputError, match=said) as caught:
        read_recording(tmp_path / "a.csv")
    assert "\n" not in str(caught.value)
    assert "a.csv" in str(caught.value)


def test_fuzz_csv(tmp_path):
    write_csv(full(), tmp_path / "a.csv")
    fuzz(tmp_path / "a.csv", 150, lambda: read_recording(tmp_path / "a.csv"))


@pytest.mark.parametrize(("mark", "point"), [(";", ","), (";", "."), ("\t", ","), ("\t", ".")])
def test_semicolons_tabs_and_decimal_commas_are_read(tmp_path, mark, point):
    """As spreadsheets of half the world write tables."""
    table = [
        ["time", *plain_rows()[0][1:]],
        *[[f"{x:.9g}".replace(".", point) for x in row] for row in plain_rows()[1:]],
    ]
    (tmp_path / "a.csv").write_text("\n".join(mark.join(row) for row in table))
    r = read_recording(tmp_path / "a.csv")
    np.testing.assert_allclose(r.points, places(), rtol=1e-8)
    np.testing.assert_allclose(r.t, times(), atol=1e-9)


def test_a_bad_stamp_costs_its_frame_and_a_repeated_row_nothing(tmp_path):
    rows = plain_rows()
    rows[12][0] = rows[11][0]
    write_rows(tmp_path / "a.csv", [*rows[:20], rows[19], *rows[20:]])
    r = read_recording(tmp_path / "a.csv")
    np.testing.assert_array_equal(r.t, np.delete(times(), 11))
    np.testing.assert_array_equal(r.points, np.delete(places(), 11, axis=0))
    said = "; ".join(r.remarks)
    assert "left out 1 rows that repeat" in said
    assert "left out 1 of 30 samples, whose stamps cannot be right: 12 (" in said
    assert "frames: a hole where about 1 samples are missing" in said


@pytest.mark.parametrize("clock", [4e5, 1.7e9])
def test_an_uptime_clock_needs_a_start(tmp_path, clock):
    """Frames by a clock since the computer was started, or since 1970, are none of a strike that begins at 0."""
    rows = plain_rows()
    write_rows(tmp_path / "a.csv", [rows[0], *[[row[0] + clock, *row[1:]] for row in rows[1:]]])
    with pytest.raises(
        InputError,
        match=r"a\.csv: t: got 'frames from .*1970\? Give the time at which the command began by that clock: key start",
    ):
        read_recording(tmp_path / "a.csv", strike=STRIKE)
    np.testing.assert_allclose(read_recording(tmp_path / "a.csv", strike=STRIKE, start=clock).t, times(), atol=1e-6)


@pytest.mark.parametrize(("unit", "factor"), [("ms", 1e3), ("us", 1e6), ("ns", 1e9)])
def test_the_unit_of_a_time_is_heard(tmp_path, unit, factor):
    rows = plain_rows()
    write_rows(tmp_path / "a.csv", [[f"t [{unit}]", *rows[0][1:]], *[[row[0] * factor, *row[1:]] for row in rows[1:]]])
    np.testing.assert_allclose(read_recording(tmp_path / "a.csv").t, times(), atol=1e-12)


def deeplabcut_rows() -> list[list]:
    pixels = to_pixels(np.nan_to_num(0.3 * places()))
    likelihood = np.where(np.isnan(places()[..., 0]), 0.1, 0.99)
    rows = [["scorer"] + ["DLC_resnet50"] * 6, ["bodyparts"] + ["whip_end"] * 3 + ["hand"] * 3]
    rows += [["coords"] + ["x", "y", "likelihood"] * 2]
    return rows + [[k, *np.concatenate([p, l[:, None]], 1).ravel()] for k, (p, l) in enumerate(zip(pixels, likelihood))]


def test_deeplabcut(tmp_path):
    write_rows(tmp_path / "a.csv", deeplabcut_rows())
    options = {"fps": FPS, "homography": H, "markers": {"tip": "whip_end", "handle": "hand"}}
    assert find_format(tmp_path / "a.csv") == "deeplabcut"
    r = read_recording(tmp_path / "a.csv", **options, strike=STRIKE)
    np.testing.assert_allclose(r.points, 0.3 * places(), atol=1e-9)
    assert r.markers == ("tip", "handle")
    np.testing.assert_allclose(r.sigma[r.seen], 0.004, rtol=0.1)  # one pixel
    rolling = read_recording(tmp_path / "a.csv", **options, shutter="rolling", readout=0.015, rows=480)
    late = (rolling.t_points - r.t_points)[r.seen]
    np.testing.assert_allclose(late, 0.015 * to_pixels(r.points)[r.seen][:, 1] / 479, atol=1e-9)
    flipped = read_recording(tmp_path / "a.csv", fps=FPS, scale=0.004, origin=[424, 240])
    assert flipped.markers == ("whip_end", "hand")
    u, v = to_pixels(0.3 * places())[0, 0]
    np.testing.assert_allclose(flipped.points[0, 0], [0.004 * (u - 424), 0.004 * (240 - v)])  # rows go down, y up


@pytest.mark.parametrize(
    ("damage", "options", "said"),
    [
        (lambda r: r, {}, "homography"),
        (lambda r: r, {"homography": H}, "fps"),
        (lambda r: r, {"homography": H, "fps": FPS, "scale": 0.1}, "only one of"),
        (lambda r: r, {"homography": np.ones((3, 3)), "fps": FPS}, "inverted"),
        (lambda r: r, {"homography": H, "fps": FPS, "markers": {"tip": "toe"}}, "whip_end, hand"),
        (lambda r: r, {"scale": 0.004, "fps": FPS}, "origin"),
        (lambda r: r, {"homography": H, "timestamps": [0.0, 0.1]}, "30, one per frame"),
        (lambda r: r, {"homography": H, "fps": FPS, "readout": 0.01}, "height"),
        (lambda r: r, {"homography": H, "fps": FPS, "shutter": "rolling"}, "readout"),
        (lambda r: r, {"homography": np.diag([1.0, 1.0, 1.0]), "fps": FPS}, "millimetres or pixels"),
        (lambda r: r[:3], {"homography": H, "fps": FPS}, "at least two frames"),
        (lambda r: [r[0], r[2], r[1], *r[3:]], {"homography": H, "fps": FPS}, "bodyparts"),
        (lambda r: [r[0], ["individuals"], *r[1:]], {"homography": H, "fps": FPS}, "begins with individuals"),
        (lambda r: [*r[:5], *[r[4]] * 4, *r[5:]], {"homography": H, "fps": FPS}, "later than"),
        (lambda r: [*r[:5], [*r[5][:-1], "high"], *r[6:]], {"homography": H, "fps": FPS}, "row 6, column 7"),
    ],
)
def test_deeplabcut_damage(tmp_path, damage, options, said):
    write_rows(tmp_path / "a.csv", damage(deeplabcut_rows()))
    with pytest.raises(InputError, match=said):
        read_recording(tmp_path / "a.csv", **options)


def test_fuzz_deeplabcut(tmp_path):
    write_rows(tmp_path / "a.csv", deeplabcut_rows())
    read = lambda: read_recording(tmp_path / "a.csv", format="deeplabcut", fps=FPS, homography=H)  # noqa: E731
    fuzz(tmp_path / "a.csv", 150, read)
