"""Strikes that arrive along a direction, and strikes for robots, from the command line."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest
import yaml

from whiptool.commands import optimize, simulate
from whiptool.models import preset
from whiptool.models.joint_trajectory import JointTrajectory
from whiptool.optimizers.trial_log import TrialLog

ASKED = ["--direction", "0.3", "1", "--cone", "8", "--least-speed", "8", "--hit-radius", "0.02"]
STRIKE = ["--strike", "-1.2", "0.9", "1.2", "0.3", "0.7"]


@pytest.fixture(autouse=True)
def in_a_folder(tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)


def said(capsys) -> dict:
    return json.loads(capsys.readouterr().out)


@pytest.mark.slow
def test_a_search_hits_along_a_direction_and_mujoco_agrees(capsys):
    words = ["--method", "gradient", *ASKED, "--max-trials", "2000", "--no-video", "--json", "--out", "run"]
    assert optimize.main(words) == 0
    result = said(capsys)
    arrival, reference = result["arrival"], result["reference"]
    assert result["hit"]
    assert arrival["angle"] <= arrival["cone"] == pytest.approx(math.radians(8))
    assert arrival["speed"] >= arrival["least_speed"] == 8
    assert arrival["direction"] == pytest.approx([0.3 / math.hypot(0.3, 1), 1 / math.hypot(0.3, 1)])
    assert reference["angle"] == pytest.approx(arrival["angle"], abs=1e-3)
    assert reference["speed"] == pytest.approx(arrival["speed"], abs=1e-2)
    log = TrialLog(Path("run/trials.csv"), preset("lemon2024").arm, arriving=True).read()
    best = min((trial.outcome for trial in log), key=lambda outcome: outcome.cost)
    assert best.arrival is not None
    assert best.arrival.angle == arrival["angle"]
    assert best.cost >= best.miss_distance == result["miss_distance"]
    assert optimize.main(["--resume", "run", "--json", "--no-video"]) == 0  # nothing is rolled out again
    again = said(capsys)
    assert (again["strike"], again["arrival"]) == (result["strike"], arrival)


def test_people_are_told_how_the_tip_arrives(capsys):
    assert simulate.main([*STRIKE, "--arrival-angle", "90", "--least-speed", "2", "--no-video"]) == 0
    lines = capsys.readouterr().out.splitlines()
    line = next(line for line in lines if line.strip().startswith("arrival"))
    assert "degrees (at most 10), " in line
    assert "m/s along it (at least 2)" in line


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--direction", "0", "0"], "--direction: got (0.0, 0.0); allowed: a vector that is not zero"),
        (["--direction", "1", "0", "--cone", "0"], "--cone: got 0.0; allowed: a finite number > 0 and <= 180"),
        (["--cone", "5"], "--cone: got 5.0; allowed: only with --direction or --arrival-angle"),
        (["--direction", "1", "0", "0"], "--direction: got (1.0, 0.0, 0.0); allowed: 2 finite numbers"),
        (
            ["--direction", "1", "0", "--arrival-angle", "3"],
            "--arrival-angle: got 3.0; allowed: only without --direction",
        ),
        (["--least-speed", "0"], "--least-speed: got 0.0; allowed: a finite number > 0"),
        (["--target", "1.514", "0", "--direction", "1", "0"], "--direction: got (1.0, 0.0); allowed: at right angles"),
        (["--export-trajectory", "x.txt"], "--export-trajectory: got 'x.txt'; allowed: a file named .csv"),
        (["--rest", "1"], "--rest: got 1.0; allowed: only with --export-trajectory"),
    ],
)
def test_contradictory_goals_get_one_line(words, message, capsys):
    assert optimize.main([*words, "--no-video"]) == 2
    error = capsys.readouterr().err
    assert error.startswith(f"whiptool: {message}")
    assert error.count("\n") == 1
    assert not list(Path().iterdir())


@pytest.mark.slow
def test_a_strike_for_a_robot_is_written_and_played_back(capsys):
    words = ["--controller", "position", "--no-video", "--posture", "0", "0.2", "--rest", "0.5"]
    assert simulate.main([*STRIKE, *words, "--export-trajectory", "strike.csv", "--json", "--out", "one"]) == 0
    asked = said(capsys)
    assert simulate.main([*STRIKE, *words, "--export-trajectory", "strike.yaml", "--json", "--out", "two"]) == 0
    capsys.readouterr()
    commanded = JointTrajectory.load_csv(Path("strike.csv"))
    assert commanded.q[0] == pytest.approx([0.0, 0.2])
    loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
    points = yaml.load(Path("strike.yaml").read_text(), Loader=loader)["trajectory"]["points"]
    assert points[-1]["positions"] == commanded.q[-1].tolist()
    words = ["--export-trajectory", "still.csv", "--controller", "position", "--no-video", "--rest", "0.1"]
    assert simulate.main([*STRIKE, *words, "--out", "three"]) == 0
    capsys.readouterr()
    assert simulate.main(["--trajectory", "still.csv", "--no-video", "--json", "--out", "four"]) == 0
    played = said(capsys)
    assert played["miss_distance"] == pytest.approx(asked["miss_distance"], abs=2e-3)
    assert played["tracking_error"] < 2e-3


def test_what_cannot_be_a_trajectory_gets_one_line(capsys):
    Path("no.csv").write_text("time,angle\n0,1\n")
    assert simulate.main(["--trajectory", "no.csv", "--no-video"]) == 2
    assert capsys.readouterr().err.startswith("whiptool: --trajectory: got 'no.csv'; allowed: the columns time, ")
    assert simulate.main(["--trajectory", "no.csv", "--timestep", "1e-4"]) == 2
    assert "only without --trajectory" in capsys.readouterr().err
    assert simulate.main(["--trajectory", "none.csv"]) == 2
    assert capsys.readouterr().err.startswith("whiptool: --trajectory: got 'none.csv'")
    assert [file.name for file in Path().iterdir()] == ["no.csv"]


def test_a_strike_beyond_the_arms_limits_is_not_written(capsys):
    strike = ["--strike", "-3", "-1.6", *["0"] * 4, "3", "-1.6", *["0"] * 4, "0.4"]
    words = ["--model", "ur5e", "--controller", "position", "--no-video", "--target", "0.9", "0", "0.3"]
    assert simulate.main([*words, *strike, "--export-trajectory", "strike.csv"]) == 2
    error = capsys.readouterr().err
    assert (
        "whiptool: --export-trajectory: got 'strike.csv'; allowed: only for a strike within limits; 0.200 s into"
        in error
    )
    assert "the velocity of shoulder_pan_joint is" in error
    assert not list(Path().iterdir())  # refused before anything is written
