"""Recordings: every format, written by somebody else's writer, and every kind of damage to it."""

import csv
import dataclasses
import pickle
import shutil

import numpy as np
import pytest
import tomli_w
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from recordings import FPS, STRIKE, TABLE, H, T, full, places, times, write_lerobot

from whiptool.errors import InputError, WhiptoolError
from whiptool.recording.readers import (
    READERS,
    db3_frames,
    db3_topics,
    find_format,
    lerobot_episode,
    lerobot_video,
    open_video,
    plane,
    read_recording,
    video_frames,
    write_csv,
)
from whiptool.recording.strike_recording import StrikeRecording


def same(a: StrikeRecording, b: StrikeRecording, but: tuple[str, ...] = ()) -> None:
    for f in dataclasses.fields(a):
        if f.name not in but:
            np.testing.assert_array_equal(getattr(a, f.name), getattr(b, f.name), err_msg=f.name)


# ---------------------------------------------------------------- the recording itself


def test_defaults_and_shapes():
    points = places()
    points[9, 0, 0] = np.nan  # half a point is no point
    r = StrikeRecording(times(), points, ("tip", "handle"))
    assert r.sigma.shape == r.t_points.shape == r.seen.shape == (T, 2)
    np.testing.assert_array_equal(r.t_points[:, 1], r.t)
    assert np.isnan(r.marker("tip")[9]).all()
    assert r.seen.sum() == 2 * T - 4
    assert r.provenance["markers"] == {"tip": T - 1, "handle": T - 3}
    points[:] = 7
    assert (r.points[r.seen] != 7).all()  # it keeps a copy
    hidden = r.without(r.t > 0.2)
    assert hidden.seen[r.t <= 0.2].sum() == r.seen[r.t <= 0.2].sum()
    assert not hidden.seen[r.t > 0.2].any()
    with pytest.raises(InputError, match="tip, handle"):
        r.marker("toe")


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"t": np.zeros(T)}, "later than"),
        ({"t": np.r_[times()[:-1], 0.1]}, r"t\[29\]"),
        ({"t": np.arange(T) * 16.7}, "milliseconds or frame numbers"),
        ({"t": np.r_[np.nan, times()[1:]]}, "NaN at index 0"),
        ({"t": [0.0]}, "at least two times"),
        ({"t": "now"}, "numbers"),
        ({"points": 1e3 * places()}, "millimetres or pixels"),
        ({"points": places()[:, :1]}, "shape"),
        ({"points": np.full((T, 2, 2), np.nan)}, "not missing"),
        ({"points": np.where(np.isnan(places()), np.inf, 0)}, "finite"),
        ({"markers": ("tip", "tip")}, "all different"),
        ({"sigma": 0.0}, "> 0 m"),
        ({"sigma": np.ones(7)}, "broadcasts"),
        ({"t_points": times()[:, None] + 9}, "within 1 s"),
        ({"exposure": -1}, "span"),
        ({"joints_q": np.full((50, 2), 90.0)}, "degrees"),
        ({"joints_q": None}, "both or neither"),
        ({"joints_t": np.zeros(50)}, "later than"),
        ({"target": (1.0,)}, "2 or 3 coordinates"),
        ({"controller": {"law": "x", "f": object()}}, "finite numbers"),
        ({"controller": {"a": 1}}, "law"),
    ],
)
def test_broken_rules(change, said):
    with pytest.raises(InputError, match=said) as caught:
        dataclasses.replace(full(), **change)
    assert "\n" not in str(caught.value)


def test_npz_round_trip(tmp_path):
    full().save(tmp_path / "a.npz")
    same(StrikeRecording.load(tmp_path / "a.npz"), full())
    same(read_recording(tmp_path / "a.npz"), full())
    np.savez(tmp_path / "b.npz", t=times(), points=places(), markers=["tip", "handle"])  # by hand
    b = read_recording(tmp_path / "b.npz")
    assert b.source == str(tmp_path / "b.npz")
    assert len(b.sha256) == 64


def test_npz_never_unpickles(tmp_path):
    class Bomb:
        def __reduce__(self):
            return (open, (str(tmp_path / "exploded"), "w"))

    np.savez(tmp_path / "a.npz", t=times(), points=places(), markers=np.array([Bomb(), Bomb()], object))
    with pytest.raises(InputError, match="allow_pickle"):
        read_recording(tmp_path / "a.npz")
    (tmp_path / "b.npz").write_bytes(pickle.dumps(Bomb()))
    with pytest.raises(InputError):
        read_recording(tmp_path / "b.npz")
    assert not (tmp_path / "exploded").exists()


@pytest.mark.parametrize(
    ("arrays", "said"),
    [
        ({"t": times(), "points": places()}, "markers"),
        ({"t": times(), "points": places(), "markers": ["a", "b"], "colour": 1}, "colour"),
        ({"t": times(), "points": places(), "markers": ["a", "b"], "format": 2}, "another version"),
        ({"t": times(), "points": places(), "markers": ["a", "b"], "strike": [1.0, 2.0]}, "strike"),
        ({"t": times(), "points": places(), "markers": ["a", "b"], "controller": "{"}, "JSON"),
    ],
)
def test_npz_damage(tmp_path, arrays, said):
    np.savez(tmp_path / "a.npz", **arrays)
    with pytest.raises(InputError, match=said):
        read_recording(tmp_path / "a.npz")


# ---------------------------------------------------------------- CSV


def write_rows(path, rows) -> None:
    with path.open("w", newline="") as file:
        csv.writer(file).writerows(rows)


def plain_rows(d: int = 2) -> list[list]:
    names = [f"{m}_{a}" for m in ("tip", "handle") for a in "xyz"[:d]]
    return [["t", *names]] + [[t, *p.ravel()] for t, p in zip(times(), places(d=d))]


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
        (lambda rows: [*rows[:9], *rows[8:]], r"t\[8\].*later than"),
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


@pytest.mark.parametrize(
    ("side", "said"),
    [
        ({"colour": 1}, "colour.*one of the keys"),
        ({"units": "ft"}, "one of m, cm, mm, in"),
        ({"strike": {"q_i": [1.0], "D": 1.0}}, "q_i, q_f and D"),
        ({"strike": {**TABLE, "D": -1.0}}, "strike.D"),
        ({"strike": {**TABLE, "q_i": "now"}}, "strike"),
        ({"joints": "../a.csv"}, "without folders"),
        ({"joints": "absent.csv"}, "absent.csv"),
        ({"axes": ["x", "x"]}, "different axes"),
        ({"axes": ["z", "x"]}, "axes"),
        ({"start": "soon"}, "a number"),
        ({"target": "there"}, "target"),
        ({"controller": 3}, "a table"),
        ({"exposure": "long"}, "exposure"),
    ],
)
def test_sidecar_damage(tmp_path, side, said):
    write_rows(tmp_path / "a.csv", plain_rows())
    (tmp_path / "a.toml").write_text(tomli_w.dumps(side))
    with pytest.raises(InputError, match=said):
        read_recording(tmp_path / "a.csv")
    (tmp_path / "a.toml").write_text("units =")
    with pytest.raises(InputError, match="TOML"):
        read_recording(tmp_path / "a.csv")


# ---------------------------------------------------------------- DeepLabCut


def to_pixels(points: np.ndarray) -> np.ndarray:
    h = np.concatenate([points, np.ones((*points.shape[:-1], 1))], -1) @ np.linalg.inv(H).T
    return h[..., :2] / h[..., 2:]


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
        (lambda r: [*r[:5], r[4], *r[5:]], {"homography": H, "fps": FPS}, "later than"),
        (lambda r: [*r[:5], [*r[5][:-1], "high"], *r[6:]], {"homography": H, "fps": FPS}, "row 6, column 7"),
    ],
)
def test_deeplabcut_damage(tmp_path, damage, options, said):
    write_rows(tmp_path / "a.csv", damage(deeplabcut_rows()))
    with pytest.raises(InputError, match=said):
        read_recording(tmp_path / "a.csv", **options)


def test_homography_from_points():
    metres = np.array([[0, 0], [1, 0.1], [1.1, 1], [-0.1, 0.9]])
    np.testing.assert_allclose(
        plane.to_plane(plane.homography_from_points(to_pixels(metres), metres), [[300, 200]]),
        plane.to_plane(H, [[300, 200]]),
    )
    around = 300 + 1e-4 * np.array([[0, 0], [1, 0], [0, 1]])
    p = plane.to_plane(H, around)
    stretch = np.sqrt(((p[1:] - p[0]) ** 2).sum() / 2) / 1e-4
    np.testing.assert_allclose(plane.metres_per_pixel(H, around[0]), stretch, rtol=1e-5)
    with pytest.raises(InputError, match="one line"):
        plane.homography_from_points(np.array([[0, 0], [1, 1], [2, 2], [5, 0]]), metres)
    assert np.isnan(plane.to_plane(np.array([[1, 0, 0], [0, 1, 0], [0, -1, 100.0]]), [[0.0, 101.0]])).all()


# ---------------------------------------------------------------- MAT


def test_mat(tmp_path):
    from scipy.io import savemat

    q = np.zeros((9, 2))
    struct = {
        "t": times()[:, None], "points": 1e3 * places(), "units": "mm", "sigma": 2.0, "target": [[1.2, 0.1]],
        "markers": np.array(["tip", "handle"], object), "strike": TABLE, "joints_t": np.arange(9) / 9, "joints_q": q,
    }  # fmt: skip
    savemat(tmp_path / "a.mat", {"recording": struct, "other": 3.0}, do_compression=True)
    r = read_recording(tmp_path / "a.mat", camera="D435")
    np.testing.assert_allclose(r.points, places())
    np.testing.assert_allclose(r.sigma, 2e-3)
    assert (r.markers, r.strike, r.target, r.camera) == (("tip", "handle"), STRIKE, (1.2, 0.1), "D435")
    np.testing.assert_array_equal(r.joints_q, q)

    x, y = places()[:, :1].transpose(2, 1, 0)  # rows, as MATLAB's users write them
    savemat(tmp_path / "b.mat", {"x": x, "y": y, "fps": FPS})
    b = read_recording(tmp_path / "b.mat")
    np.testing.assert_array_equal(b.points, places()[:, :1])
    assert b.markers == ("tip",)
    np.testing.assert_allclose(b.t, times())


@pytest.mark.parametrize(
    ("variables", "said"),
    [
        ({"y": 1.0}, "points, or x and y"),
        ({"a": {"x": 1.0}, "b": {"x": 1.0}}, "exactly one struct"),
        ({"points": places()}, "the variable t"),
        ({"points": places()[:, :1], "t": times()[::-1]}, "later than"),
        ({"points": places(), "t": times()}, "2 names"),
        ({"points": places(), "t": times(), "markers": np.array([1.0, "a"], object)}, "cell array of texts"),
        ({"points": 1e3 * places()[:, :1], "t": times()}, "millimetres"),
        ({"points": places()[:, :1] + 1j, "t": times()}, "real numbers"),
    ],
)
def test_mat_damage(tmp_path, variables, said):
    from scipy.io import savemat

    savemat(tmp_path / "a.mat", variables)
    with pytest.raises(InputError, match=said):
        read_recording(tmp_path / "a.mat")


def test_mat_versions(tmp_path):
    (tmp_path / "a.mat").write_bytes(b"MATLAB 7.3 MAT-file".ljust(512) + b"\x89HDF\r\n\x1a\n" + bytes(99))
    with pytest.raises(InputError, match=r"7\.3 .HDF5.*-v7"):
        read_recording(tmp_path / "a.mat")
    (tmp_path / "a.mat").write_bytes(b"\x00" * 200)
    with pytest.raises(InputError, match="MAT version 5"):
        read_recording(tmp_path / "a.mat")


# ---------------------------------------------------------------- C3D


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


# ---------------------------------------------------------------- video


def images(count: int = T, shape: tuple[int, int] = (48, 64)) -> list[np.ndarray]:
    """A white square that moves two pixels an image, over black."""
    made = [np.zeros((*shape, 3), np.uint8) for _ in range(count)]
    for k, image in enumerate(made):
        image[20:28, k : k + 8] = 255
    return made


def write_video(path, made, fourcc="MJPG") -> None:
    import cv2

    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*fourcc), FPS, made[0].shape[1::-1])
    for image in made:
        writer.write(image)
    writer.release()


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
    np.testing.assert_allclose(video.time_of(3, [0, 47]), times()[3] + 0.002 + np.array([0, 0.015]))
    for _ in range(2):  # as often as one likes
        for k, (_, image) in enumerate(video):
            assert np.argwhere(image[..., 0] > 127).mean(axis=0)[1] == pytest.approx(k + 3.5, abs=0.5)
    with pytest.raises(InputError, match="track"):
        read_recording(tmp_path / name)


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


def test_lerobot(tmp_path):
    write_lerobot(tmp_path)
    (tmp_path / "whiptool.toml").write_text(tomli_w.dumps({"camera": "front", "episode": {"1": {"strike": TABLE}}}))
    r = read_recording(tmp_path, episode=1)
    np.testing.assert_allclose(r.points, places(), rtol=1e-6)
    np.testing.assert_allclose(r.t, times(), atol=1e-6)
    assert (r.markers, r.strike, r.camera) == (("tip", "handle"), STRIKE, "front")
    assert r.joints_q is not None
    np.testing.assert_allclose(r.joints_q[:, 0], np.arange(T, 2 * T) / 50, rtol=1e-6)
    assert read_recording(tmp_path, episode=0).strike is None
    assert set(lerobot_episode(tmp_path, 1).columns) >= {"action", "observation.state"}


def test_lerobot_video(tmp_path):
    write_lerobot(tmp_path, whip=False)
    write_video(tmp_path / "videos/observation.images.front/chunk-000/file-000.mp4", images(T) + images(T), "mp4v")
    with pytest.raises(InputError, match=r"track one of its cameras: observation\.images\.front"):
        read_recording(tmp_path, episode=1)
    video = lerobot_video(tmp_path, episode=1, homography=H)
    np.testing.assert_allclose(video.times, times(), atol=1e-6)
    columns = [np.argwhere(image[..., 0] > 127).mean(axis=0)[1] for _, image in video]
    np.testing.assert_allclose(columns, np.arange(T) + 3.5, atol=0.5)
    assert video.about["joints_q"].shape == (T, 2)
    assert len(open_video(tmp_path, episode=0)) == T
    write_video(tmp_path / "videos/observation.images.front/chunk-000/file-000.mp4", images(T + 5), "mp4v")
    with pytest.raises(InputError, match="cut off"):
        list(lerobot_video(tmp_path, episode=1).frames())


@pytest.mark.parametrize(
    ("written", "options", "said"),
    [
        ({"info": {"codebase_version": "v2.1"}}, {}, "v3.0"),
        ({"info": {"fps": 0}}, {}, "rows per second"),
        ({"info": {"features": 3}}, {}, "table of features"),
        ({"info": {"data_path": "../{chunk_index}.parquet"}}, {}, "inside the dataset"),
        ({"info": {"data_path": "{chunk_index.real}.parquet"}}, {}, "template"),
        ({"info": {"data_path": "gone/{file_index}.parquet"}}, {}, "gone"),
        ({"episodes": {"length": [T, T + 1]}}, {}, "31"),
        ({"episodes": {"data/file_index": [-1, -1]}}, {}, "two indices"),
        ({"data": {"timestamp": np.zeros(2 * T)}}, {}, "later than"),
        ({"data": {"observation.state": [[90.0, 90.0]] * 2 * T}}, {}, "degrees"),
        ({"data": {"observation.whip": [[900.0] * 4] * 2 * T}}, {}, "millimetres"),
        ({"data": {"observation.whip": [[1.0] * 3] * 2 * T}}, {}, "3 names"),
        ({}, {"episode": 7}, "one of 2 episodes"),
        ({}, {"episode": -1}, "an index"),
        ({}, {"colour": 1}, "colour"),
    ],
)
def test_lerobot_damage(tmp_path, written, options, said):
    write_lerobot(tmp_path, **written)
    with pytest.raises(InputError, match=said):
        read_recording(tmp_path, **{"episode": 1, **options})


# ---------------------------------------------------------------- ROS 2 bags


def coloured(count: int = T) -> list[np.ndarray]:
    return [image // np.array([1, 2, 4], np.uint8) for image in images(count)]


def write_bag(folder, *, encoding="bgr8", metadata=False, compress=False, stamps=None, count=T):
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
            writer.write(topic, ns, pack(store.serialize_cdr(message, Image.__msgtype__)))
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


def test_db3_of_realsense(tmp_path):
    """Compressed message by message, the camera's own clock in a metadata topic."""
    video = open_video(write_bag(tmp_path / "bag", metadata=True, compress=True))
    np.testing.assert_allclose(video.times, 1.01 * times(), atol=1e-6)
    np.testing.assert_array_equal(list(video.frames()), coloured())


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


# ---------------------------------------------------------------- all formats


def test_registry(tmp_path):
    (tmp_path / "a.xyz").write_text("?")
    with pytest.raises(InputError) as caught:
        read_recording(tmp_path / "a.xyz")
    assert all(form.what in str(caught.value) for form in READERS.values())
    for path in (tmp_path / "absent.csv", tmp_path, "a\0b"):
        with pytest.raises(InputError):
            read_recording(path)
    with pytest.raises(InputError, match="one of deeplabcut"):
        read_recording(tmp_path / "a.xyz", format="xyz")
    full().save(tmp_path / "a.npz")
    with pytest.raises(InputError, match="fps"):
        read_recording(tmp_path / "a.npz", fps=60)
    with pytest.raises(InputError, match="read_recording"):
        open_video(tmp_path / "a.npz")
    for suffix in ("csv", "npz", "mat", "c3d", "db3", "mp4"):
        (tmp_path / f"empty.{suffix}").touch()
        with pytest.raises(InputError, match="an empty file"):
            (open_video if suffix in ("db3", "mp4") else read_recording)(tmp_path / f"empty.{suffix}")


def test_missing_packages(tmp_path, monkeypatch):
    import sys

    for module in ("ezc3d", "pyarrow.parquet", "rosbags.rosbag2", "cv2"):
        monkeypatch.setitem(sys.modules, module, None)
    (tmp_path / "d/meta").mkdir(parents=True)
    (tmp_path / "d/meta/info.json").write_text("{}")
    for name in ("a.c3d", "a.mp4", "a.db3"):
        (tmp_path / name).write_bytes(b"x")
    for path, reader, extra in (
        (tmp_path / "a.c3d", read_recording, "io"),
        (tmp_path / "d", read_recording, "io"),
        (tmp_path / "a.db3", open_video, "io"),
        (tmp_path / "a.mp4", open_video, "vision"),
    ):
        with pytest.raises(InputError, match=rf"pip install 'whiptool\[{extra}\]'"):
            reader(path)


@st.composite
def damage(draw):
    """Cut off, some bytes changed (often near the head or the tail, where the structure is), or anything at all."""
    kind = draw(st.sampled_from(["cut", "flip", "flip", "random"]))
    if kind == "random":
        junk = draw(st.binary(max_size=600))
        keep = draw(st.sampled_from([0, 0, 16, 128, 512]))
        return lambda data: data[:keep] + junk
    if kind == "cut":
        share = draw(st.floats(0, 1))
        return lambda data: data[: int(share * len(data))]
    changes = draw(st.lists(st.tuples(st.floats(0, 1), st.sampled_from([0, 1, 2]), st.integers(0, 255)), min_size=1))

    def flip(data):
        made = bytearray(data)
        for share, where, value in changes:
            reach = len(made) if where == 0 else min(len(made), 700)
            i = min(int(share * reach), reach - 1)
            made[i if where < 2 else len(made) - 1 - i] = value
        return bytes(made)

    return flip


FUZZ = {"deadline": None, "database": None, "suppress_health_check": list(HealthCheck)}


def survives(read) -> None:
    """It reads, or says in one line why not."""
    said = ""
    try:
        read()
    except WhiptoolError as error:
        said = str(error)
    assert "\n" not in said


def fuzz(file, examples: int, read) -> None:
    whole = file.read_bytes()
    read()  # undamaged it reads

    @settings(max_examples=examples, **FUZZ)
    @given(change=damage())
    def run(change):
        file.write_bytes(change(whole))
        survives(read)

    run()


def test_fuzz_csv(tmp_path):
    write_csv(full(), tmp_path / "a.csv")
    fuzz(tmp_path / "a.csv", 150, lambda: read_recording(tmp_path / "a.csv"))


@pytest.mark.parametrize("name", ["a.toml", "a.joints.csv"])
def test_fuzz_sidecars(tmp_path, name):
    write_csv(full(), tmp_path / "a.csv")
    fuzz(tmp_path / name, 100, lambda: read_recording(tmp_path / "a.csv"))


def test_fuzz_npz(tmp_path):
    full().save(tmp_path / "a.npz")
    fuzz(tmp_path / "a.npz", 150, lambda: read_recording(tmp_path / "a.npz"))
    np.savez(tmp_path / "b.npz", t=times(), points=places(), markers=["tip", "handle"])  # not compressed
    fuzz(tmp_path / "b.npz", 150, lambda: read_recording(tmp_path / "b.npz"))


def test_fuzz_deeplabcut(tmp_path):
    write_rows(tmp_path / "a.csv", deeplabcut_rows())
    read = lambda: read_recording(tmp_path / "a.csv", format="deeplabcut", fps=FPS, homography=H)  # noqa: E731
    fuzz(tmp_path / "a.csv", 150, read)


@pytest.mark.parametrize("compressed", [False, True])
def test_fuzz_mat(tmp_path, compressed):
    from scipy.io import savemat

    savemat(tmp_path / "a.mat", {"t": times(), "points": places()[:, :1], "units": "m"}, do_compression=compressed)
    fuzz(tmp_path / "a.mat", 12, lambda: read_recording(tmp_path / "a.mat"))


def test_fuzz_c3d(tmp_path):
    write_c3d(tmp_path / "a.c3d")
    fuzz(tmp_path / "a.c3d", 20, lambda: read_recording(tmp_path / "a.c3d"))


@pytest.mark.parametrize(
    "name", ["meta/info.json", "meta/episodes/chunk-000/file-000.parquet", "data/chunk-000/file-000.parquet"]
)
def test_fuzz_lerobot(tmp_path, name):
    write_lerobot(tmp_path)
    fuzz(tmp_path / name, 60, lambda: read_recording(tmp_path, episode=1))


def test_fuzz_db3(tmp_path):
    file = write_bag(tmp_path / "bag", metadata=True, count=3)
    fuzz(file, 50, lambda: list(open_video(file).frames()))


@pytest.mark.parametrize(("name", "fourcc"), [("a.avi", "MJPG"), ("a.mp4", "mp4v")])
def test_fuzz_video(tmp_path, name, fourcc):
    write_video(tmp_path / name, images(6), fourcc)
    fuzz(tmp_path / name, 40, lambda: list(open_video(tmp_path / name, fps=FPS)))
