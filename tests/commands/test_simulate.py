"""A strike from the command line, and the model that is exported."""

from __future__ import annotations

import json

import mujoco
import pytest
from command_line import assert_one_line, called
from robot_files import WEIGHTLESS


def test_simulate_replays_the_strike_that_was_found(tmp_path):
    strike = ["-1.2", "0.9", "1.2", "0.3", "0.7"]
    results = {}
    for simulator in ("compiled", "reference"):
        done = called("simulate", "--strike", *strike, "--simulator", simulator, "--json", "--no-video", cwd=tmp_path)
        assert done.returncode == 0, done.stderr
        results[simulator] = json.loads(done.stdout)
    assert results["compiled"]["miss_distance"] == pytest.approx(results["reference"]["miss_distance"], abs=3e-4)
    assert results["compiled"]["engine"] in ("simd", "scalar")
    assert len(list((tmp_path / "runs").iterdir())) == 2


def test_export_writes_mjcf_that_mujoco_loads(tmp_path):
    done = called("simulate", "--export", "model.xml", "--target", "1.1", "0.2", cwd=tmp_path)
    assert done.returncode == 0
    assert "does not hold the controller" in done.stderr
    assert mujoco.MjModel.from_xml_path(str(tmp_path / "model.xml")).nq == 14


def test_a_strike_whose_simulation_diverges_ends_with_1(tmp_path):
    """Two turns there and back in 10 ms, which no step makes right; in degrees the strike is refused by name."""
    strike = ["--strike", "-12", "12", "12", "-12", "0.01"]
    done = called("simulate", *strike, "--json", "--no-video", cwd=tmp_path)
    assert (done.returncode, json.loads(done.stdout)["diverged"]) == (1, True)
    done = called("simulate", "--strike", "-78", "27", "99", "81", "0.95", cwd=tmp_path)
    assert_one_line(done, "--strike", "-78 rad of shoulder", "are these degrees?")


@pytest.mark.slow
def test_an_arm_whose_file_tells_no_inertia_is_searched_simulated_and_exported(tmp_path):
    """Its mass matrix is singular: the equations of the whip alone are solved."""
    (tmp_path / "arm.urdf").write_text(WEIGHTLESS)
    model = ("--model", "arm.urdf", "--nodes", 5, "--target", 1.2, 0.2, 0.8, "--no-video", "--json")
    found = called("optimize", *model, "--max-trials", 300, "--seed", 0, "--out", "run", cwd=tmp_path)
    assert found.returncode == 0, found.stderr
    best = json.loads(found.stdout)
    assert best["hit"]
    assert best["reference"]["miss_distance"] == pytest.approx(best["miss_distance"], abs=3e-4)
    played = ("run", "--simulator", "reference", "--export-trajectory", "strike.csv", "--no-video", "--json")
    again = called("simulate", *played, cwd=tmp_path)
    assert again.returncode == 0, again.stderr
    assert json.loads(again.stdout)["miss_distance"] == pytest.approx(best["miss_distance"], abs=3e-4)
    assert (tmp_path / "strike.csv").is_file()
