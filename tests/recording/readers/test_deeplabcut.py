"""Files of DeepLabCut, and every kind of damage."""

import numpy as np
import pytest
from recordings import FPS, STRIKE, H, fuzz, places, to_pixels, write_rows

from whiptool.errors import InputError
from whiptool.recording.readers import (
    find_format,
    read_recording,
)


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
        (lambda r: [r[0], ["individuals"], *r[1:]], {"homography": H, "fps": FPS}, "one animal"),
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
