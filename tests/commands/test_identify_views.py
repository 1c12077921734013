"""A whip in space from two cameras' tables of pixels, on the command line."""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from space_films import LEFT, RIGHT, ROBOT, STRIKES, WHIP, filmed_by_two

from whiptool.commands import identify
from whiptool.models import write_model
from whiptool.recording.camera_files import write_cameras
from whiptool.recording.readers import write_csv

pytestmark = pytest.mark.slow
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
    assert "--cameras: got 'cameras.toml'; allowed: nothing: no recording is in pixels" in capsys.readouterr().err
