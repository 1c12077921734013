"""Run folders, model files and policies of an early 0.2.0 are read as that version read them, or refused with one line
that says what to do.

That version wrote what is in `tests/data/written_by_early_0_2_0`, but for pictures and long recordings. The numbers
here are those that it gave itself.
"""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from command_line import assert_one_line, called
from repository import ROOT

import whiptool as wt
from papers.finished_comparison import read_run
from whiptool.comparison.search_unit import StrikeLibrary
from whiptool.errors import InputError
from whiptool.goals.zone import Region
from whiptool.identification.plant import read_bare_arm
from whiptool.impedance.controller import read_controller
from whiptool.models.joint_trajectory import JointTrajectory
from whiptool.recording.camera import read_cameras
from whiptool.recording.readers.angles import read_angles
from whiptool.rig.cyclelog import Cycles

WRITTEN = ROOT / "tests" / "data" / "written_by_early_0_2_0"
FILES = WRITTEN / "files"


@pytest.fixture
def older(tmp_path) -> Path:
    """A copy of what the older version wrote, and beside its runs the files that they name."""
    folder = shutil.copytree(WRITTEN, tmp_path / "older")
    for name in ("recording.npz", "swing.npz", "pendulum.toml"):
        shutil.copy(FILES / name, folder)
    return folder


def result_of(run: Path) -> dict:
    return json.loads((run / "result.json").read_text())


@pytest.mark.parametrize("run", ["optimize", "optimize-printed", "optimize-pareto", "simulate-short"])
def test_a_strike_is_played_again(run, older):
    """Then in equal steps, today to 0.1 mm unless a step was asked for."""
    done = called("simulate", run, "--no-video", "--json", cwd=older)
    assert done.returncode == 0, done.stderr
    again, was = json.loads(done.stdout), result_of(older / run)
    assert again["strike"] == was["strike"]
    assert again["miss_distance"] == pytest.approx(was["miss_distance"], abs=1e-12 if "short" in run else 1e-4)


@pytest.mark.slow
def test_a_robot_that_is_another_now_is_played_with_the_model_of_its_run(older):
    run, out = older / "optimize-ur5e", ("--no-video", "--json")
    kept = run / "config.toml"
    refused = called("simulate", run, *out, cwd=older)
    assert_one_line(refused, f"the model differs from when the run was made: give --model {kept}")
    parts = ("--model", kept, "--controller", kept)
    assert_one_line(called("simulate", run, *parts, *out, cwd=older), "--target", "three coordinates")
    words = ("--target", 1.3, 0, 0, "--limits", "none", "--timestep", 2.5e-4)
    done = called("simulate", run, *parts, *words, *out, cwd=older)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["miss_distance"] == pytest.approx(result_of(run)["miss_distance"], abs=1e-4)


def test_a_strike_is_looked_at(older):
    run = older / "simulate-short"
    (run / "strike.mp4").write_bytes(b"kept")
    assert called("view", run, "--json", cwd=older).returncode == 0
    assert "target at (1.300, 0.000) m" in (run / "strike.html").read_text()
    path = wt.Trajectory.load(run / "trajectory.npz")
    assert len(path.t) == 176
    np.testing.assert_allclose(path.tip[-1], [-0.23275433241712487, -1.089097514304089], rtol=1e-12)


@pytest.mark.parametrize(
    ("run", "strike"),
    [
        ("train", [-1.10880981, 0.81998848, 2.18137825, 1.80412002, 0.64139608]),
        ("train-paper", [-1.03670123, 0.94054156, 1.98817889, 1.36875730, 0.62140406]),
    ],
)
def test_a_policy_strikes_as_it_did(run, strike, older):
    pytest.importorskip("torch")
    np.testing.assert_allclose(wt.load_policy(older / run).strike((1.25, 0.05)).vector, strike, rtol=1e-5)


def test_a_map_strikes_as_it_did(older):
    np.testing.assert_allclose(
        wt.load_map(older / "map").strike((1.25, 0.05)).vector,
        [-0.8405265, 0.5508777, 1.0455207, 1.6969850, 0.7242685],
        rtol=1e-6,
    )


def test_an_adaptation_that_had_ended_is_told_again(older):
    done = called("adapt", "--resume", "adapt", "--json", cwd=older)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["miss_distance"] == result_of(WRITTEN / "adapt")["miss_distance"]
    awaits = called("adapt", "--resume", "adapt-robot", "--json", cwd=older)
    assert awaits.returncode == 3
    assert json.loads(awaits.stdout) if awaits.stdout else awaits.stderr


@pytest.mark.parametrize(
    ("command", "run"),
    [
        ("optimize", "optimize"),
        ("optimize", "optimize-printed"),
        ("optimize", "optimize-pareto"),
        ("optimize", "optimize-ur5e"),
        ("train", "train"),
        ("train", "train-paper"),
        ("compare", "compare"),
        ("identify", "identify"),
        ("identify", "identify-free"),
    ],
)
def test_a_run_whose_defaults_are_others_now_does_not_go_on(command, run, older):
    refused = called(command, "--resume", run, "--json", cwd=older)
    assert_one_line(refused, f"whiptool: --resume: got '{run}'", "begin a new run", "with version 0.2.0+87107b8")


def test_trials_of_a_rig_in_other_columns_say_what_to_do(older):
    pytest.importorskip("dynamixel_sdk")
    assert_one_line(called("rig", "learn", "--resume", "rig-learn", cwd=older), "trials.csv", "move it away")


def test_results_of_a_comparison_are_refused(older):
    with pytest.raises(InputError, match="--resume"):
        read_run(older / "compare")


@pytest.mark.parametrize(
    ("name", "coordinates", "mass", "stiffness"),
    [
        ("lemon2024", 14, 0.14400000000000002, 2.662),
        ("nah2023", 54, 0.30000000000000004, 5.808),
        ("of-profile", 10, 0.03574682655494819, 0.13389994201647376),
        ("profile", 10, 0.03574682655494819, 0.13389994201647376),
        ("rich", 14, 0.14400000000000002, 2.662),
        ("ur5e", 46, 0.08645696362101055, 0.097050633548067),
        ("panda", 47, 0.08645696362101055, 0.097050633548067),
    ],
)
def test_a_model_is_read(name, coordinates, mass, stiffness):
    model = wt.read_model(FILES / f"model-{name}.toml")
    assert model.n == coordinates
    assert model.whip.per_node("m").sum() == pytest.approx(mass, rel=1e-12)
    assert model.whip.per_node("k").sum() == pytest.approx(stiffness, rel=1e-12)


def test_fitted_models_are_read():
    fitted, found = wt.read_model(WRITTEN / "identify" / "identified.toml"), result_of(WRITTEN / "identify")
    assert fitted.whip.k == found["parameters"][0]["value"]
    assert read_bare_arm(WRITTEN / "identify-free" / "identified.toml").arm.links[1].com == 0.09000715550990601


def test_controllers_are_read():
    assert read_controller(FILES / "controller-oiac.toml") == wt.Controller(wt.oiac_preset("table4"))
    assert read_controller(FILES / "controller-constant.toml") == wt.Controller(wt.ConstantImpedance())
    assert read_controller(FILES / "controller-position.toml").prescribed


def test_recordings_are_read():
    strike = wt.StrikeRecording.load(FILES / "recording.npz")
    assert np.nansum(strike.points) == pytest.approx(-24.228634166658146)
    assert strike.joints_q is not None
    assert strike.joints_q.shape == (125, 2)
    assert np.nansum(wt.StrikeRecording.load(WRITTEN / "rig" / "recording.npz").points) == pytest.approx(
        -71.5987266672264
    )
    cycles = Cycles.load(WRITTEN / "rig" / "cycles.log")
    assert (len(cycles), cycles.t[-1]) == (44, pytest.approx(0.086))
    assert read_angles(FILES / "swing.npz").points.shape == (150, 2, 1)


def test_other_files_are_read():
    seen = read_cameras(FILES / "cameras.toml")["left"].project(np.array([[0.1, 0.2, 0.3]]))
    np.testing.assert_allclose(seen, [[472.3785846737438, 243.9508077134228]], rtol=1e-12)
    assert read_bare_arm(FILES / "pendulum.toml").arm.links[1].com == 0.09
    assert Region.load(FILES / "region.npz").corners.shape == (4, 2)
    assert Region.load(FILES / "region-space.npz").corners.shape == (4, 3)
    strikes, distance = StrikeLibrary.load(FILES / "library.npz").nearest((1.0, 0.5), 3)
    np.testing.assert_allclose(distance, [0.5, 0.5, np.inf])
    assert strikes[1].tolist() == [10.0, 11.0, 12.0, 13.0, 14.0]
    assert len(JointTrajectory.load_csv(FILES / "joints.csv").t) == 80
