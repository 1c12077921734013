"""From a found strike to a learned rope, one command each, on robots that speak their makers' protocols.

The rope is simulated on the measured joints and filmed by virtual cameras; the controllers are `franka-sim`, which was
not written here, and the emulated UR, both in lock-step.
"""

from __future__ import annotations

import functools
import json
from pathlib import Path

import numpy as np
import pytest
from franka_server import franka_server
from ur_robot import PATIENCE, emulated

from whiptool.commands import adapt, optimize, robot
from whiptool.recording.strike_recording import StrikeRecording
from whiptool.rig.cyclelog import Cycles
from whiptool.rig.robots import addresses
from whiptool.rig.robots.ur import UniversalRobot

RAISED = (0.0, -1.2, 0.0, -2.0, 0.0, 2.8, 0.8)  # [rad] of an FR3, so that the rope hangs clear of the floor
TARGETS = {"ur5e": ("1.0", "0.2", "0.6"), "fr3": ("0.9", "0.2", "0.7")}


@pytest.fixture
def home(monkeypatch, tmp_path) -> Path:
    """A home of its own for what a stop leaves."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    return tmp_path


@pytest.fixture
def ur(home, monkeypatch):
    """The address of an emulated UR, whose driver waits longer for a busy machine than for a robot."""
    pytest.importorskip("rtde_control", reason="ur-rtde is not installed, or has no wheel here")
    patient = functools.partial(UniversalRobot, patience=PATIENCE)
    monkeypatch.setitem(addresses.ROBOTS, "ur", lambda host, model: patient(host, model.arm.joint_limits))
    with emulated() as emulator:
        yield f"ur://{emulator.host}"


@pytest.fixture
def franka(home):
    with franka_server(home / "server.log", RAISED) as server:
        yield f"franka://{server.host}"


def struck(model: str, address: str, folder: Path, capsys, camera: str) -> dict:
    """Find a strike, and make it; return the result."""
    target = ["--target", *TARGETS[model]]
    assert optimize.main(["--model", model, *target, "--out", str(folder / "found"), "--no-video", "--json"]) == 0
    capsys.readouterr()
    words = [str(folder / "found"), "--robot", address, "--camera", camera, "--yes", "--json"]
    status = robot.main(["strike", *words, "--out", str(folder / "struck")])
    said = capsys.readouterr()
    assert status == 0, said.err
    return json.loads(said.out.strip().splitlines()[-1])


def check_struck(result: dict, folder: Path) -> None:
    """The strike was carried out, filmed, and recorded as the robot reports it."""
    assert result["fault"] is None
    assert result["miss_distance"] == pytest.approx(result["true_miss_distance"], abs=0.01)
    recording, cycles = StrikeRecording.load(folder / "recording.npz"), Cycles.load(folder / "cycles.log")
    assert "tip" in recording.markers
    assert recording.joints_q is not None
    assert np.isfinite(cycles.current if result["robot"] == "ur" else cycles.tau).all()


def learned(model: str, address: str, folder: Path, capsys, *words: str) -> dict:
    """Learn an unknown rope; return the result."""
    out = ["--out", str(folder / "learned"), "--yes", "--json"]
    status = adapt.main(["--model", model, "--port", address, "--target", *TARGETS[model], *words, *out])
    said = capsys.readouterr()
    assert status == 0, said.err
    summary = json.loads(said.out.strip().splitlines()[-1])
    assert summary["hit"]
    assert not any(summary["refused_strikes"])
    return summary


@pytest.mark.hours
def test_a_strike_on_a_ur_is_filmed_and_a_rope_is_learned_from_rendered_pictures(ur, home, capsys):
    result = struck("ur5e", ur, home, capsys, "d435-infrared")
    check_struck(result | {"robot": "ur"}, home / "struck")
    summary = learned("ur5e", ur, home, capsys, "--camera", "twin", "--family", "kin", "--seed", "1")
    assert summary["strikes"] <= 2
    assert summary["miss_distance"][-1] < 0.06  # the true one


@pytest.mark.hours
def test_a_strike_on_a_franka_is_filmed_and_a_rope_is_learned(franka, home, capsys):
    result = struck("fr3", franka, home, capsys, "points")
    check_struck(result | {"robot": "franka"}, home / "struck")
    summary = learned("fr3", franka, home, capsys, "--camera", "points", "--seed", "3")
    assert summary["strikes"] <= 2
    assert summary["miss_distance"][-1] < 0.06
