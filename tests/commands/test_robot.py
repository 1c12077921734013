"""One strike with a robot from the command line: its run folder, and what is refused before the robot hears of it."""

from __future__ import annotations

import json
import sys

import numpy as np
import pytest
from repository import ROOT

import whiptool as wt
from whiptool.commands import rig, robot, run_folders
from whiptool.commands.simulate import SimulateOptions
from whiptool.recording.strike_recording import StrikeRecording
from whiptool.rig.robots.addresses import ROBOTS
from whiptool.runs import RunFolder

sys.path.insert(0, str(ROOT / "docs" / "examples"))
from add_robot import LaggingRobot

VECTOR = (-1.63, -1.07, -0.22, -0.49, 2.16, 0.42, -2.17, -2.07, -0.33, -1.73, -0.35, 2.09, 1.5)
WORDS = [*map(str, VECTOR)]


class Counted(LaggingRobot):
    moved = recovered = 0

    def follow(self, trajectory, record, stop) -> None:
        Counted.moved += 1
        super().follow(trajectory, record, stop)

    def recover(self) -> None:
        Counted.recovered += 1


@pytest.fixture(autouse=True)
def lab(monkeypatch, tmp_path):
    """A robot at `lab://`, and a home of its own for what a stop leaves."""
    monkeypatch.setitem(ROBOTS, "lab", Counted)
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    monkeypatch.setattr(Counted, "moved", 0)
    monkeypatch.setattr(Counted, "recovered", 0)


def call(capsys, *words: str) -> tuple[int, dict, str]:
    status = robot.main(["strike", "--robot", "lab://one", "--json", "--yes", *words])
    said = capsys.readouterr()
    last = said.out.strip().splitlines()[-1:] or ["{}"]
    return status, json.loads(last[0]) if last[0].startswith("{") else {}, said.err


def test_a_strike_is_made_and_recorded(tmp_path, capsys):
    out = tmp_path / "run"
    status, result, _ = call(capsys, "--model", "ur5e", "--strike", *WORDS, "--out", str(out))
    assert status == 0
    assert (Counted.moved, result["fault"], result["torque_off"], result["hit"]) == (1, None, None, None)
    recording = StrikeRecording.load(out / "recording.npz")
    assert recording.strike == wt.Strike.from_vector(VECTOR)
    np.testing.assert_allclose(recording.joints_q[-1], VECTOR[6:12], atol=1e-6)
    assert json.loads((out / "result.json").read_text())["cycles"] == result["cycles"] > 900
    assert "lab://one" in (out / "report.html").read_text()


def test_the_strike_of_a_run_is_made_with_the_runs_model(tmp_path, capsys):
    options = SimulateOptions(model="ur5e", target=(1.0, 0.2, 0.6), strike=VECTOR)
    folder = RunFolder.create(tmp_path / "run", {"version": "1", **run_folders.configuration(options, "simulate")})
    folder.write_result({"strike": dict(zip(range(13), VECTOR, strict=True))})
    folder.close()
    status, _, error = call(capsys, str(tmp_path / "run"), "--out", str(tmp_path / "struck"))
    assert (status, Counted.moved) == (0, 1), error
    assert "1.000, 0.200, 0.600" in (tmp_path / "struck" / "report.html").read_text()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--model", "ur5e"], r"--strike: got nothing; allowed: joint angles"),
        (["--model", "panda", "--strike", *WORDS], "--strike: got"),
        (["--model", "ur5e", "--strike", *WORDS[:-1], "0.4"], "the velocity of"),
        (["--model", "ur5e", "--strike", *WORDS, "--camera", "realsense"], "--camera: got 'realsense'"),
        (["--model", "ur5e", "--strike", *WORDS, "--true-model", "ur5e"], "only with a virtual --camera"),
    ],
)
def test_what_cannot_be_struck_is_refused_in_one_line(tmp_path, capsys, words, said):
    status, _, error = call(capsys, *words, "--out", str(tmp_path / "run"))
    assert (status, Counted.moved) == (2, 0)
    assert said in error
    assert len(error.strip().splitlines()) == 1


def test_an_address_is_asked_for(capsys):
    assert robot.main(["strike", "--model", "ur5e", "--strike", *WORDS]) == 2
    assert "--robot: got nothing; allowed: franka://HOST, ur://HOST" in capsys.readouterr().err
    assert robot.main(["strike", "--robot", "192.168.0.1", "--model", "ur5e", "--strike", *WORDS]) == 2
    assert "--robot: got '192.168.0.1'; allowed: franka://HOST" in capsys.readouterr().err


def test_nothing_moves_without_a_yes(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("sys.stdin", open("/dev/null"))  # noqa: SIM115, PTH123
    words = ["strike", "--robot", "lab://one", "--model", "ur5e", "--strike", *WORDS, "--out", str(tmp_path / "run")]
    assert robot.main(words) == 2
    assert robot.main(["recover", "--robot", "lab://one"]) == 2
    assert (Counted.moved, Counted.recovered) == (0, 0)
    assert robot.main(["recover", "--robot", "lab://one", "--yes"]) == 0
    assert Counted.recovered == 1


@pytest.mark.parametrize(
    ("given", "port"),
    [
        (["--robot", "twin"], ["--port", "twin"]),
        (["--robot=twin"], ["--port", "twin"]),
        (["--robot", "dynamixel:/dev/ttyUSB0", "--yes"], ["--port", "/dev/ttyUSB0", "--yes"]),
    ],
)
def test_servos_and_their_twin_are_those_of_the_rig(monkeypatch, given, port):
    monkeypatch.setattr(rig, "main", lambda words: words)
    assert robot.main(["strike", *given, "--json"]) == ["strike", *port, "--json"]
