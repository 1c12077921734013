"""Limits from the command line: what a strike uses of them, what is refused and why, and exports within them."""

from __future__ import annotations

import json
from html import unescape
from pathlib import Path

import numpy as np
import pytest

from whiptool.commands import optimize, simulate
from whiptool.commands.limits_told import limits_table, refuse_unheld, with_cure
from whiptool.impedance import Controller
from whiptool.limits.all_limits import AllLimits
from whiptool.limits.arm_limits import XM430, ArmLimits
from whiptool.models import JointLimits, Strike, preset
from whiptool.models.files import write_model
from whiptool.models.joint_trajectory import JointTrajectory
from whiptool.models.strike import StrikeBounds
from whiptool.models.trajectory import Trajectory

STRIKE = ["--strike", "-1.2", "0.9", "1.2", "0.3", "0.7"]
UR5E = [
    "--model",
    "ur5e",
    "--target",
    "1.2",
    "0.2",
    "0.1",
    "--timestep",
    "0.001",
    "--no-video",
]
GOOD = ["-1.27", "0.83", "-2.04", "-3.1", "-0.51", "1.67", "0.25", "-0.78", "-0.07", "-1.06", "1.48", "1.74", "1.35"]


@pytest.fixture(autouse=True)
def in_a_folder(tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)


def said(capsys) -> dict:
    return json.loads(capsys.readouterr().out)


def test_a_strike_above_and_through_a_floor_in_the_plane(capsys):
    """Its clearance is as much less as the floor is higher; what goes through it is told, and not exported."""
    assert simulate.main([*STRIKE, "--floor", "-2", "--no-video", "--json", "--out", "above"]) == 0
    told = said(capsys)
    assert told["beyond"] is None
    assert simulate.main([*STRIKE, "--floor", f"{-2 + told['clearance'] + 0.05}", "--no-video", "--out", "low"]) == 0
    lines = capsys.readouterr().out
    assert "  clearance      -50 mm at least; the distance from arm and whip to the arm and the floor" in lines
    assert "is 50 mm below the floor" in lines
    words = [*STRIKE, "--floor", "-0.5", "--no-video", "--export-trajectory", "x.csv", "--out", "no"]
    assert simulate.main(words) == 2
    assert "allowed: a strike within limits; at" in capsys.readouterr().err
    assert not Path("x.csv").exists()
    assert not Path("no").exists()


def test_a_search_that_no_strike_comes_through_says_why(capsys):
    words = ["--method", "random", "--max-trials", "20", "--hit-radius", "0.01", "--no-video", "--floor", "-0.2"]
    assert optimize.main([*words, "--out", "none"]) == 0
    lines = capsys.readouterr().out
    assert "refused, like all other strikes; the best: at 0.000 s" in lines
    assert "below the floor" in lines
    assert "refused        20 strikes: 20 would collide" in lines
    result = json.loads(Path("none/result.json").read_text())
    assert (result["n_refused"], result["hit"]) == (20, False)
    assert result["clearance"] < 0
    assert result["beyond"].endswith("below the floor")
    page = Path("none/strike.html").read_text()
    assert f"Beyond its limits, and so no hit: {result['beyond']}" in unescape(page)
    assert "Hits" not in page


@pytest.mark.slow
def test_a_strike_of_a_robot_is_exported_within_what_is_left(capsys):
    robot = preset("ur5e")
    words = [*UR5E, "--strike", *GOOD, "--export-trajectory", "strike.csv", "--json"]
    assert simulate.main([*words, "--floor", "-1.5", "--out", "whole"]) == 0
    told = said(capsys)
    assert 0 < told["joint_usage"] < 1
    assert told["clearance"] > 0
    commanded = JointTrajectory.load_csv(Path("strike.csv"))
    assert commanded.beyond(ArmLimits.of(robot.arm).joints) is None
    free = 1.0 - float(np.abs(commanded.v).max() / np.pi) + 0.01  # a little more than is left
    assert simulate.main([*words, "--keep-free", f"{free}", "--out", "no"]) == 2
    assert "the velocity of" in capsys.readouterr().err


@pytest.mark.parametrize(("by_joints", "used"), [(True, 4.0), (False, 0.5)])
def test_what_is_commanded_is_judged_of_strikes_of_joints_alone(by_joints, used):
    """A speed of 1 of 2 rad/s; commanded, 4 times the acceleration: over 1 rad in 1 s, 10/sqrt(3) rad/s2."""
    joint = JointLimits(velocity=2.0, acceleration=10 / np.sqrt(3) / 4)
    limits = AllLimits(ArmLimits((joint,)), by_joints=by_joints)
    v, strike = np.array([[0.0], [-1.0]]), Strike((0.0,), (1.0,), 1.0)
    moved = Trajectory(
        np.array([0, 1e-3]), v, v, v, v, v, v[..., None], v[..., None], np.zeros((2, 3)), np.zeros((2, 3))
    )
    table = limits_table(limits, moved, strike, ("a",))
    assert table["joint_usage"] == pytest.approx(used)
    assert (table["beyond"] is None) == (not by_joints)


def test_shapes_that_are_taken_to_touch_are_told_with_their_cure():
    words = "at 0.000 s the link of j1 is 3 mm inside the link of j3"
    assert with_cure(words) == f"{words}; if they never meet: arm.never_touch in a model file, or --ignore-collisions"
    for others in (None, "at 0.1 s the torque of j1 is +9.00; its limit is 5.00"):
        assert with_cure(others) == others


@pytest.mark.parametrize("end", ["start", "end"])
def test_limits_within_which_no_start_or_no_end_can_be_held_are_refused_at_once(end, capsys):
    """Held level, a point mass m at the tip of two links asks the shoulder for (m (l1 + l2) + ...) g."""
    heavy = preset("lemon2024").with_parameters({"whip.m": 0.1})
    write_model(heavy, Path("heavy.toml"))
    held, other = (["1.4", "-0.1"], ["1.7", "0.1"]), (["-0.2", "0.1"], ["1.5", "1.0"])
    first, last = (held, other) if end == "start" else (other, held)
    level = ["--lower", *first[0], *last[0], "0.5", "--upper", *first[1], *last[1], "1.0"]
    words = ["--model", "heavy.toml", "--limits", "xm430", *level, "--no-video", "--out", "held"]
    assert optimize.main(words) == 2
    assert not Path("held").exists()
    said = capsys.readouterr().err
    arm, weight = heavy.arm, 9.81
    moments = [arm.per_link(name) for name in ("mass", "com", "length")]
    (m1, m2), (c1, c2), (l1, l2) = (x.tolist() for x in moments)
    level_torque = weight * (m1 * c1 + m2 * (l1 + c2) + heavy.whip.mass * (l1 + l2))
    asked = float(said.split("shoulder ")[1].split(" N m")[0])
    assert 4.1 < 0.93 * level_torque < asked < level_torque
    assert f"{end} postures: got 'all beyond the arm: " in said
    down = ["--lower", "-0.1", "-0.1", "0.2", "0.1", "0.5", "--upper", "1.7", "0.1", "1.5", "1.0", "1.0"]
    limits = AllLimits(XM430)
    bounds = StrikeBounds(*(tuple(map(float, x)) for x in (down[1:6], down[7:])))
    refuse_unheld(heavy, Controller(), limits, bounds)  # hanging, it needs no torque
