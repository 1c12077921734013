"""`simulate RUN` plays a run's strike again."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from command_line import assert_one_line, called

SEARCH = ("--method", "random", "--max-trials", 5, "--target", "1.25,0.05", "--timestep", 0.002, "--preset", "printed",
          "--t-stay", 0.2, "--no-video", "--no-stop-at-hit")  # fmt: skip


@pytest.fixture(scope="module")
def run(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("played")
    assert called("optimize", *SEARCH, "-o", "run", cwd=folder).returncode == 0
    return folder / "run"


def test_a_run_is_played_again_as_it_was(run, tmp_path):
    done = called("simulate", run, "--no-video", "--json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    again, was = json.loads(done.stdout), json.loads((run / "result.json").read_text())
    for name in ("strike", "target", "hit_radius", "miss_distance", "controller"):
        assert again[name] == was[name]
    assert again["timestep"] == 0.002


def test_options_may_be_given_anew(run, tmp_path):
    done = called("simulate", run, "--target", "0.9,0.9", "--preset", "table4", "--no-video", "--json", cwd=tmp_path)
    again, was = json.loads(done.stdout), json.loads((run / "result.json").read_text())
    assert again["target"] == [0.9, 0.9]
    assert again["strike"] == was["strike"]
    assert again["controller"] != was["controller"]


def test_what_was_played_is_played_again(run, tmp_path):
    assert called("simulate", run, "--no-video", "-o", "once", cwd=tmp_path).returncode == 0
    done = called("simulate", "once", "--no-video", "--json", cwd=tmp_path)
    assert json.loads(done.stdout)["miss_distance"] == json.loads((run / "result.json").read_text())["miss_distance"]


def test_folders_without_a_strike_are_refused(run, tmp_path):
    assert_one_line(called("simulate", tmp_path, cwd=tmp_path), "run folder", "config.toml")
    other = tmp_path / "other"
    other.mkdir()
    text = (run / "config.toml").read_text()
    (other / "config.toml").write_text(text)
    assert_one_line(called("simulate", other, cwd=tmp_path), "RUN", "ended with a strike", "optimize --resume")
    (other / "config.toml").write_text(text.replace('command = "optimize"', 'command = "identify"'))
    assert_one_line(called("simulate", other, cwd=tmp_path), "RUN", "optimize", "whiptool identify")
    for name in ("result.json",):
        (other / name).write_bytes((run / name).read_bytes())
    (other / "config.toml").write_text(text.replace("gravity = 9.81", "gravity = 1.62"))
    assert_one_line(called("simulate", other, cwd=tmp_path), "RUN", "the same model", "give --model")
