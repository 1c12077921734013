"""A search from the command line: results, run folders, kills, resumes."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from command_line import assert_one_line, called
from processes import HANG

from whiptool.models import preset, read_model, write_model
from whiptool.models.trajectory import Trajectory
from whiptool.optimizers.trial_log import TrialLog

KEYS = {
    "method",
    "status",
    "message",
    "target",
    "hit_radius",
    "space",
    "strike",
    "miss_distance",
    "hit",
    "hit_time",
    "tip_speed",
    "arrival",
    "judged",
    "throw",
    "missed_by",
    "n_trials",
    "n_diverged",
    "wall_time",
    "reference",
    "warning",
    "controller",
    "model",
    "seed",
    "version",
}


@pytest.mark.figures
def test_optimize_hits_the_default_target(tmp_path):
    """The main job, with figures and video."""
    done = called("optimize", "--json", "--out", "run", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)
    assert set(result) == KEYS
    assert result["hit"]
    assert result["status"] == "hit"
    assert result["n_trials"] <= 100
    assert result["miss_distance"] <= result["hit_radius"] == 0.06
    assert abs(result["reference"]["difference"]) < 3e-4
    assert list(result["strike"]) == ["q_si", "q_ei", "q_sf", "q_ef", "D"]
    run = tmp_path / "run"
    assert json.loads((run / "result.json").read_text()) == result
    log = TrialLog(run / "trials.csv", preset("lemon2024").arm).read()
    assert len(log) == result["n_trials"]
    assert list(log[-1].strike) == list(result["strike"].values())
    path = Trajectory.load(run / "trajectory.npz")
    assert path.approach(np.array([1.3, 0.0])).distance[0] == pytest.approx(result["miss_distance"], abs=1e-4)
    for name in ("convergence", "strike", "tracking", "gains", "distance"):
        assert (run / f"{name}.png").read_bytes()[:4] == b"\x89PNG"
    video = (run / "strike.mp4").read_bytes()
    assert video[4:8] == b"ftyp"
    assert b"avc1" in video  # H.264


def test_summary_for_people(tmp_path):
    done = called("optimize", "--no-video", "--method", "random", "--seed", 1, cwd=tmp_path)
    assert done.returncode == 0
    for text in ("rad (", "deg)", "within -1.5708 .. -0.3142", "m/s", "difference of", "runs/random-"):
        assert text in done.stdout


def test_a_model_file_is_taken(tmp_path):
    write_model(preset("nah2020-n10"), tmp_path / "mine.toml")
    assert read_model(tmp_path / "mine.toml") == preset("nah2020-n10")
    done = called("optimize", "--model", "mine.toml", "--controller", "constant", "--target", "1.2", "-0.4", "--json",
                    "--no-video", "--max-trials", "20", "--out", "run", cwd=tmp_path)  # fmt: skip
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)
    assert (result["model"], result["controller"]["law"]) == ("nah2020-n10", "constant")


def outcome_of(run) -> tuple:
    result = json.loads((run / "result.json").read_text())
    del result["wall_time"]
    return result, (run / "trials.csv").read_text()


@pytest.mark.slow
@pytest.mark.parametrize("method", ["directl", "nlopt:GN_CRS2_LM"])
def test_a_killed_run_resumes_to_the_same_end(tmp_path, method):
    """SIGKILL in mid-search, half a line torn off, then --resume: the same trials and result as without the kill."""
    options = ["--method", method, "--target", "1.25", "0.05", "--no-stop-at-hit", "--max-trials", "500", "--no-video",
               "--timestep", "0.002", "--preset", "printed"]  # fmt: skip
    assert called("optimize", *options, "--out", "whole", cwd=tmp_path).returncode == 0
    command = [sys.executable, "-m", "whiptool.optimize", *options, "--out", "killed"]
    process = subprocess.Popen(command, cwd=tmp_path, stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL)
    trials = tmp_path / "killed" / "trials.csv"
    while not (trials.exists() and trials.read_text().count("\n") > 100):
        assert process.poll() is None
        time.sleep(0.005)
    process.send_signal(signal.SIGKILL)
    process.wait()
    assert not (tmp_path / "killed" / "result.json").exists()
    with trials.open("a") as file:
        file.write("999,0.1,0.")
    done = called("optimize", "--resume", "killed", "--no-video", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert outcome_of(tmp_path / "killed") == outcome_of(tmp_path / "whole")


@pytest.mark.slow
def test_interruption_saves_and_summarises(tmp_path):
    command = [sys.executable, "-m", "whiptool.optimize", "--no-stop-at-hit", "--max-trials", "100000", "--no-video",
               "--json", "--out", "run"]  # fmt: skip
    process = subprocess.Popen(
        command,
        cwd=tmp_path,
        stderr=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # background jobs inherit it as ignored
    )
    trials = tmp_path / "run" / "trials.csv"
    while not (trials.exists() and trials.read_text().count("\n") > 20):
        assert process.poll() is None
        time.sleep(0.01)
    process.send_signal(signal.SIGINT)
    out, _ = process.communicate(timeout=HANG)
    assert process.returncode == 130
    result = json.loads(out)
    assert result["status"] == "interrupted"
    assert result["n_trials"] >= 20
    assert (tmp_path / "run" / "strike.png").exists()


def test_resume_refuses_another_configuration(tmp_path):
    assert called("optimize", "--no-video", "--out", "run", "--max-trials", "50", cwd=tmp_path).returncode == 0
    for options, name in ((["--target", "1.2", "0.1"], "--target"), (["--seed", "4"], "--seed"),
                          (["--out", "other"], "--out")):  # fmt: skip
        done = called("optimize", "--resume", "run", *options, cwd=tmp_path)
        assert_one_line(done, name)
    config = (tmp_path / "run" / "config.toml").read_text()
    (tmp_path / "run" / "config.toml").write_text(config.replace("m = 0.012", "m = 0.013"))
    assert_one_line(called("optimize", "--resume", "run", cwd=tmp_path), "--resume", "same model")


def test_a_search_of_which_every_strike_is_refused_says_so_early(tmp_path):
    """Half a turn in 0.3 s is beyond the motors of the emulated rig: said once, at the 30th strike."""
    box = ["--lower", -1.5, 0, 1.4, 0, 0.3, "--upper", -1.4, 0.1, 1.5, 0.1, 0.31]
    words = ["--limits", "xm430", "--method", "random", "--max-trials", "31", "--no-video", "--json"]
    done = called("optimize", *words, *box, cwd=tmp_path)
    said = [line for line in done.stderr.replace("\r", "\n").splitlines() if line.startswith("whiptool: ")]
    assert len(said) == 1
    for part in (
        "all of the first 30 strikes were refused",
        "beyond the motors' limits (30)",
        "N m; give other --limits",
    ):
        assert part in said[0]
    assert json.loads(done.stdout)["miss_distance"] is None  # a penalty is no distance
    assert "all refused so far" in done.stderr
    assert "closest" not in done.stderr.replace(said[0], "")


def test_a_whip_that_no_posture_holds_above_the_floor_is_refused_with_the_options_that_help(tmp_path):
    assert_one_line(
        called("optimize", "--model", "ur5e", "--whip-length", "3", cwd=tmp_path),
        "--whip-length and --mount: got 'a whip of 3 m on an arm whose hand rises to 1.",
        "a shorter whip, such as 0.",
        "or a base higher above the floor, such as 3 m",
    )
    assert not (tmp_path / "runs").exists()


def test_the_option_that_leaves_the_joints_no_range_is_named_first(tmp_path):
    """A hundredth of its range holds no UR5e upright; half of it does."""
    words = ["optimize", "--model", "ur5e", "--max-trials", 1, "--no-video"]
    said = "--keep-free, --whip-length and --mount: got 'a whip of 1 m"
    assert_one_line(called(*words, "--keep-free", 0.99, cwd=tmp_path), said, "give a smaller --keep-free")
    assert called(*words, "--keep-free", 0.5, "--method", "random", cwd=tmp_path).returncode == 0


def test_a_thing_that_the_arm_cannot_even_hold_is_refused_by_its_mass(tmp_path):
    """The arm alone holds itself and the whip."""
    words = ["optimize", "--throw", "--limits", "xm430", "--box", 1.8, -0.5, 0.2, "--thing-mass", 50]
    assert_one_line(called(*words, cwd=tmp_path), "none that the arm can hold", "give a lighter thing (--thing-mass)")
    assert not (tmp_path / "runs").exists()


def test_a_search_that_takes_long_because_of_the_drag_says_so(tmp_path):
    words = ["optimize", "--throw", "--box", 1.8, -0.5, 0.2, "--method", "random", "--max-trials", 1, "--no-video"]
    said = "with a drag per mass of 35.4 1/m a flight is simulated in many steps: the search takes"
    light = called(*words, "--thing-mass", 1e-5, cwd=tmp_path)
    assert light.returncode == 0
    assert said in light.stderr
    assert "drag per mass" not in called(*words, cwd=tmp_path).stderr


def test_joints_that_move_as_commanded_need_the_torques_to_hold_the_arm_all_the_same(tmp_path):
    words = ["optimize", "--model", "ur5e", "--keep-free", 0.9]
    said = ("none that the arm can hold: the easiest of 1025 needs", "give a smaller --keep-free, or start")
    assert_one_line(called(*words, cwd=tmp_path), *said)


@pytest.mark.slow
def test_strikes_that_are_refused_for_several_reasons_come_with_the_cure_of_the_most_frequent(tmp_path):
    words = ["--throw", "--model", "ur5e", "--box", 1.8, 0, 0, 0.2, "--thing-mass", 5, "--max-trials", 31, "--no-video"]
    said = called("optimize", *words, cwd=tmp_path).stderr
    assert "(1); the least of the first: at 0.286 s the torque of wrist_2 is +43.10 N m" in said
    assert "give a lighter thing (--thing-mass), or other --lower and --upper" in said
