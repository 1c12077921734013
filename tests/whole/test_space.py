"""Searches, trainings and comparisons of models in space, from the command line."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time

import mujoco
import numpy as np
import pytest
from command_line import assert_one_line, called

from whiptool.limits.arm_limits import ArmLimits
from whiptool.models import preset
from whiptool.models.trajectory import Trajectory
from whiptool.optimizers.trial_log import TrialLog

UR5E = ["--model", "ur5e"]
NAH = ["--model", "nah2023", "--controller", "constant", "--timestep", "0.001"]


@pytest.mark.slow
def test_a_killed_search_in_space_resumes_to_the_same_trials(tmp_path):
    """SIGKILL in mid-search of a robot with limits, half a line torn off, then --resume."""
    options = [*UR5E, "--target", "1.2", "0.3", "0.5", "--timestep", "0.001", "--no-stop-at-hit", "--no-video"]
    options += ["--method", "ga", "--max-trials", "150", "--seed", "3", "--floor", "none"]
    done = called("optimize", *options, "--json", "--out", "whole", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    command = [sys.executable, "-m", "whiptool.optimize", *options, "--out", "killed"]
    process = subprocess.Popen(command, cwd=tmp_path, stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL)
    trials = tmp_path / "killed" / "trials.csv"
    while not (trials.exists() and trials.read_text().count("\n") > 50):
        assert process.poll() is None
        time.sleep(0.002)
    process.send_signal(signal.SIGKILL)
    process.wait()
    assert trials.read_text().count("\n") < 150
    with trials.open("a") as file:
        file.write("999,0.1,0.")
    assert called("optimize", "--resume", "killed", "--no-video", cwd=tmp_path).returncode == 0
    assert trials.read_text() == (tmp_path / "whole" / "trials.csv").read_text()
    results = [json.loads((tmp_path / run / "result.json").read_text()) for run in ("whole", "killed")]
    for result in results:
        del result["wall_time"]
    assert results[0] == results[1]
    assert json.loads(done.stdout)["joint_usage"] <= 1

    model = preset("ur5e")
    log = TrialLog(trials, model.arm, limited=True).read()
    best = min(log, key=lambda trial: trial.outcome.miss_distance)
    assert list(results[0]["strike"].values()) == list(best.strike)
    path = Trajectory.load(tmp_path / "killed" / "trajectory.npz")
    assert ArmLimits.of(model.arm).violation(path) <= 0
    assert path.approach(np.array([1.2, 0.3, 0.5])).distance[0] == pytest.approx(best.outcome.miss_distance, abs=1e-9)
    assert abs(results[0]["reference"]["difference"]) < 1e-3
    assert 0 < results[0]["n_refused"] < 100


@pytest.mark.slow
def test_a_strike_in_space_for_people_and_as_mjcf(tmp_path):
    done = called("optimize", *NAH, "--target", "1.995", "0", "0", "--no-video", "--out", "run", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    for text in ("q_shoulder_flexion_i", "(1.995, 0.000, 0.000) m, hit", "shoulder_rotation", "in MuJoCo"):
        assert text in done.stdout
    assert "limits" not in done.stdout  # the person's arm has none
    strike = json.loads((tmp_path / "run" / "result.json").read_text())["strike"].values()
    played = called("simulate", *NAH, "--target", "1.995", "0", "0", "--strike", *map(repr, strike), "--json",
                      "--no-video", "--out", "again", cwd=tmp_path)  # fmt: skip
    assert played.returncode == 0, played.stderr
    assert json.loads(played.stdout)["hit"]
    done = called("simulate", "--model", "nah2023", "--target", "2", "0", "0", "--export", "arm.xml", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert mujoco.MjModel.from_xml_path(str(tmp_path / "arm.xml")).nv == 54


@pytest.mark.slow
def test_a_policy_and_a_comparison_in_space(tmp_path):
    few = ["--episodes", "3", "--random-episodes", "1", "--trials", "8", "--hindsight", "1"]
    ball = [*NAH, "--target", "1.7", "0.3", "0.2", "--hit-radius", "1.0"]  # soon hit
    done = called("train", *ball, *few, "--tests", "4", "--no-video", "--json", "--out", "policy", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)
    assert result["zone_volume"] == pytest.approx(4 / 3 * np.pi * 0.1**3)
    assert "zone_area" not in result
    compared = [
        "--methods",
        "cmaes",
        "--targets",
        "2",
        "--seeds",
        "1",
        "--max-trials",
        "12",
        "--tighter",
        "--workers",
        "1",
    ]
    done = called("compare", *ball, *compared, "--json", "--out", "compared", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert {row["method"] for row in json.loads(done.stdout)["rows"]} == {"cmaes", "random"}
    assert "a ball of radius 0.1 m around (1.7, 0.3, 0.2) m" in (tmp_path / "compared" / "table.md").read_text()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (
            ["--model", "ur5e", "--target", "1.2", "0.3"],
            "three coordinates x y z in m, for the model ur5e",
        ),
        (["--target", "1.2", "0.3", "0.4"], "two coordinates x y in m, for the model lemon2024, which is in the plane"),
        (["--model", "ur5e", "--target", "9", "0", "0"], "within the model's reach"),
        (["--limits", "arm"], "--limits: got 'an arm whose joints have no limits'; allowed: an arm"),
        (["--arm", "nowhere.urdf", "--target", "1", "0", "0"], "nowhere.urdf"),
        (["--arm", "nobody"], "--arm: got 'nobody'"),
        (["--model", "ur5e", "--target", "1", "0", "0", "--lower", "0", "0"], "13 numbers, q_shoulder_pan_i"),
    ],
)
def test_bad_input_in_space_is_one_line(words, said, tmp_path):
    done = called("optimize", *words, "--controller", "constant", cwd=tmp_path)
    assert_one_line(done, said)
    assert not (tmp_path / "runs").exists()
