"""A whip in space from two cameras' tables of pixels, or from their films, on the command line."""

from __future__ import annotations

import dataclasses
import json
import tomllib

import numpy as np
import pytest
import tomli_w
from command_line import assert_one_line, called
from scipy.spatial.transform import Rotation
from space_films import LATE, LEFT, RIGHT, ROBOT, STRIKES, WHIP, filmed_by_two

from whiptool.commands import identify
from whiptool.impedance import Controller, PositionControl
from whiptool.impedance.controller import controller_to_table
from whiptool.models import write_model
from whiptool.models.strike import Strike
from whiptool.recording.camera import write_cameras
from whiptool.recording.readers import open_video, write_csv
from whiptool.recording.readers.footage import video_frames
from whiptool.rollout import CompiledRollout

TRUE = {"whip.k": 0.05, "whip.b": 0.004}
WORDS = ["--drive", "joints", "--model", "guess.toml", "--starts", "1", "--free", "k", "b", "--per-recording", "delay"]


@pytest.fixture(scope="module")
def lab(tmp_path_factory):
    """Two strikes, each seen by two cameras: tables of pixels, sidecars that name no file of cameras, a guess."""
    folder = tmp_path_factory.mktemp("lab")
    for i, strike in enumerate(STRIKES):
        for film in filmed_by_two(ROBOT, strike, i):
            table = write_csv(film, folder / f"strike{i}-{film.camera}.csv")[1]
            told = [line for line in table.read_text().splitlines() if not line.startswith("cameras =")]
            table.write_text("\n".join(told) + "\n")
    write_cameras(folder / "cameras.toml", {"left": LEFT, "right": RIGHT})
    write_model(dataclasses.replace(ROBOT, whip=dataclasses.replace(WHIP, k=0.07, b=0.006)), folder / "guess.toml")
    return folder


@pytest.mark.slow
@pytest.mark.figures
def test_a_table_for_each_camera_and_their_file_give_the_whip(lab, monkeypatch, capsys, tmp_path):
    monkeypatch.chdir(lab)
    files = [f"strike{i}-{name}.csv" for i in range(2) for name in ("left", "right")]
    how = ["--cameras", "cameras.toml", "--held-out", "2", "--out", str(tmp_path / "out")]
    assert identify.main([*files, *WORDS, *how, "--json"]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert summary["warning"] is None
    for found in summary["parameters"]:
        low, high = found["interval"]
        assert low <= TRUE[found["name"]] <= high, found
    assert summary["rmse_pixels"] == pytest.approx(0.3, rel=0.15)
    assert summary["held_out_rmse_pixels"] < 0.36
    assert summary["held_out_rmse"] == pytest.approx(7e-3 * summary["held_out_rmse_pixels"], rel=0.3)
    assert [r["camera"] for r in summary["recordings"]] == ["left", "right"] * 2
    assert summary["recordings"][0]["similarity"] is None
    report = (tmp_path / "out" / "report.html").read_text()
    assert "in the camera's image" in report or "in the camera&#39;s image" in report
    assert "RMS [pixels]" in report


def test_a_camera_that_was_moved_is_refused(lab, monkeypatch, capsys, tmp_path):
    monkeypatch.chdir(lab)
    turn = Rotation.from_euler("x", 3, degrees=True).as_matrix()
    moved = dataclasses.replace(RIGHT, rotation=turn @ RIGHT.rotation)
    write_cameras(tmp_path / "cameras.toml", {"left": LEFT, "right": moved})
    files = ["strike0-left.csv", "strike0-right.csv"]
    out = tmp_path / "out"
    assert identify.main([*files, *WORDS, "--cameras", str(tmp_path / "cameras.toml"), "--out", str(out)]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "left and right by" in said
    assert "calibrate again" in said
    assert not out.exists()


def test_pixels_need_their_cameras(lab, monkeypatch, capsys):
    monkeypatch.chdir(lab)
    assert identify.main(["strike0-left.csv", *WORDS]) == 2
    assert "cameras: got None; allowed: the file of cameras in space" in capsys.readouterr().err
    np.savetxt("plain.csv", np.zeros((3, 3)), delimiter=",", header="t,tip_x,tip_y", comments="")
    assert identify.main(["plain.csv", *WORDS, "--cameras", "cameras.toml"]) == 2
    assert "--cameras: got 'cameras.toml'; allowed: only with films or recordings in pixels" in capsys.readouterr().err


FAST = Strike(STRIKES[0].q_i, (0.1, -0.9, 1.4, -0.9, 0.3, 0.0), 0.3)
FILMS = ["--model", "guess.toml", "--starts", "1", "--free", "k", "b", "--per-recording", "delay"]


@pytest.fixture(scope="module")
def films(tmp_path_factory):
    """One strike as two virtual cameras filmed it, each by its own clock; sidecars that name no file of cameras."""
    render = pytest.importorskip("whiptool.vision.render")
    from whiptool.vision.film_files import write_video
    from whiptool.vision.source import frames_of

    folder, controller = tmp_path_factory.mktemp("films"), Controller(PositionControl())
    path = CompiledRollout(ROBOT, controller, timestep=5e-4).trajectory(FAST, t_stay=0.3)
    lens = np.array([[322.0, 0, 318], [0, 324.0, 178], [0, 0, 1]])
    small = {"camera_matrix": lens, "width": 640, "height": 360, "distortion": (), "fps": 60.0}
    cameras = {c.name: dataclasses.replace(c, **small) for c in (LEFT, RIGHT)}
    write_cameras(folder / "cameras.toml", cameras)
    write_model(dataclasses.replace(ROBOT, whip=dataclasses.replace(WHIP, k=0.07, b=0.006)), folder / "guess.toml")
    for seed, (name, camera) in enumerate(cameras.items()):
        virtual = render.VirtualCamera(camera, ROBOT, path, np.random.default_rng(seed), start=-0.03)
        try:
            virtual.open()
        except Exception as error:  # a machine without OpenGL
            pytest.skip(f"no OpenGL: {error}")
        film = folder / f"{name}.mkv"
        side = write_video(film, frames_of(virtual), synthetic=True, in_space=True, strike=FAST, t_stay=0.3)
        view = open_video(film).view
        assert (view.exposure, view.readout) == (camera.exposure, pytest.approx(camera.readout))
        np.testing.assert_array_equal(view.rotation, camera.rotation)
        table = tomllib.loads(side.read_text()) | {"start": -LATE[name], "controller": controller_to_table(controller)}
        side.write_text(tomli_w.dumps({key: x for key, x in table.items() if key != "cameras"}))
    return folder


@pytest.mark.slow
def test_films_of_two_cameras_give_the_whip(films, tmp_path):
    """Each is tracked in pixels; the clocks come out as they were set, and the run says that it is synthetic."""
    words = ["left.mkv", "right.mkv", "--cameras", "cameras.toml", *FILMS, "--out", tmp_path / "out", "--json"]
    done = called("identify", *words, cwd=films)
    assert done.returncode == 0, done.stderr
    summary = json.loads(done.stdout)
    assert summary["warning"] is None
    for found in summary["parameters"]:
        low, high = found["interval"]
        assert low <= TRUE[found["name"]] <= high, found
        assert high - low < 0.1 * TRUE[found["name"]]
    assert summary["rmse_pixels"] < 0.12
    assert summary["rmse_depth"] is None
    assert summary["synthetic"]
    assert [r["camera"] for r in summary["recordings"]] == ["left (virtual)", "right (virtual)"]
    clocks = [r["own"]["delay"] for r in summary["recordings"]]
    np.testing.assert_allclose(clocks, [LATE["left"], LATE["right"]], atol=1e-3)  # the whip's end hides some light


def test_slips_with_films_are_told_in_one_line(films, tmp_path):
    """Before anything is tracked, which takes minutes with a real film."""
    side, film = (films / "left.toml").read_text(), tmp_path / "slip.mkv"
    film.write_bytes((films / "left.mkv").read_bytes())
    write_cameras(films / "small.toml", {"left": dataclasses.replace(LEFT, width=320)})
    homography = "homography = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]\n"
    given, small = ["--cameras", "cameras.toml"], ["--cameras", "small.toml"]
    for told, cameras, parts in (
        (side.replace('"left"', '"top"'), given, ("slip.toml: camera: got 'top'", "one of left, right")),
        (side.replace('camera = "left"', ""), given, ("slip.toml: camera: got None", "one of left, right")),
        (side, small, ("slip.toml: images: got '640 x 360 pixels'", "320 x 480, as left has in the file of cameras")),
        (homography + side, [], ("slip.mkv", "a film of a camera in space, for a model in space", "--cameras FILE")),
    ):
        film.with_suffix(".toml").write_text(told)
        assert_one_line(called("identify", film, *FILMS, *cameras, "--out", tmp_path / "out", cwd=films), *parts)
    planar = ["left.mkv", "--model", "lemon2024", "--cameras", "cameras.toml", "--out", tmp_path / "out"]
    assert_one_line(called("identify", *planar, cwd=films), "left.mkv", "for a model in the plane")
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_films_of_different_strikes_are_refused(films, tmp_path):
    """The right one shows another strike than its sidecar says: this one, backwards."""
    import cv2

    frames = list(video_frames(films / "right.mkv"))
    writer = cv2.VideoWriter(str(films / "other.mkv"), cv2.VideoWriter.fourcc(*"FFV1"), 60.0, (640, 360))
    for frame in frames[::-1]:
        writer.write(frame)
    writer.release()
    (films / "other.toml").write_text((films / "right.toml").read_text())
    words = ["left.mkv", "other.mkv", "--cameras", "cameras.toml", *FILMS, "--out", tmp_path / "out"]
    done = called("identify", *words, cwd=films)
    assert done.returncode == 2
    (said,) = [line for line in done.stderr.splitlines() if line.startswith("whiptool: ")]  # beside a progress bar
    assert "left and right by" in said
    assert "or they saw different strikes" in said
    assert not (tmp_path / "out").exists()
