"""What commands tell people of a strike: units of joints that turn and that slide, and torques that are not known."""

from __future__ import annotations

import dataclasses
import json
import math
import types
from html import unescape
from pathlib import Path

import numpy as np
import pytest

from whiptool.commands import optimize, simulate
from whiptool.commands.options.search_options import refuse_unheld
from whiptool.commands.strike_lines import limits_table, missed_by, outcome_lines, strike_lines, with_cure
from whiptool.goals.target import Target
from whiptool.impedance import Controller
from whiptool.limits.all_limits import AllLimits
from whiptool.limits.arm_limits import XM430, ArmLimits
from whiptool.models import ArmLink, ArmParameters, SpatialArm, Strike, preset
from whiptool.models.files import write_model
from whiptool.models.joint_trajectory import JointTrajectory
from whiptool.models.spatial_arm import JointLimits, SpatialLink, without_inertia
from whiptool.models.strike import StrikeBounds
from whiptool.models.trajectory import Trajectory
from whiptool.objective import Arrival

BODY = (1.0, (0, 0, 0), (1, 1, 1, 0, 0, 0))
RAIL = SpatialLink(*BODY, (0, 1, 0), (0, 0, 0), kind="prismatic", limits=JointLimits((-1, 1)))
ARM = SpatialArm((RAIL, SpatialLink(*BODY, (0, 1, 0), (0, 0, 0.5))), ("rail", "swing"))
OUTCOME = types.SimpleNamespace(
    diverged=False, hit=True, miss_distance=0.01, time=0.5, tip_speed=9.0, arrival=None, max_joint_speed=(0.5, 2.0),
    max_torque=(30.0, 4.0),
)  # fmt: skip


def test_joints_that_slide_have_metres_and_newtons():
    assert [
        line.split() for line in strike_lines({"q_ri": 0.1, "q_si": 1.0, "q_rf": 0.2, "q_sf": 0.0, "D": 1}, ARM)
    ] == [
        ["q_ri", "+0.1000", "m"],
        ["q_si", "+1.0000", "rad", "(+57.3", "deg)"],
        ["q_rf", "+0.2000", "m"],
        ["q_sf", "+0.0000", "rad", "(+0.0", "deg)"],
        ["D", "1.0000", "s"],
    ]
    told = outcome_lines(OUTCOME, Target((1.0, 0.0, 0.0)), ARM)
    assert told[-2].split() == ["rail", "at", "most", "0.5", "m/s,", "30.0", "N"]
    assert told[-1].split() == ["swing", "at", "most", "2.0", "rad/s,", "4.0", "N", "m"]


def test_torques_of_an_arm_of_unknown_inertia_are_not_told():
    told = outcome_lines(OUTCOME, Target((1.0, 0.0, 0.0)), without_inertia(ARM, ["swing"]))
    assert [line.split(", ")[1] for line in told[-2:]] == ["force not known", "torque not known"]


@pytest.mark.parametrize(
    ("miss", "angle", "speed", "words", "numbers"),
    [
        (0.01, math.radians(22.5), 9.0, "the direction by 12.5 degrees", (None, math.radians(12.5), None)),
        (0.01, math.radians(3), 3.0, "the speed by 1.5 m/s", (None, None, 1.5)),
        (0.0725, math.radians(3), 9.0, "the point by 12.5 mm", (0.0125, None, None)),
        (
            0.56,
            math.radians(100),
            -4.0,
            "the point by 500 mm, the direction by 90 degrees, the speed by 8.5 m/s",
            (0.5, math.radians(90), 8.5),
        ),
    ],
)
def test_a_miss_says_what_was_missed_and_by_how_much(miss, angle, speed, words, numbers):
    """Asked for are 0.06 m, 10 degrees and 4.5 m/s."""
    asked = dataclasses.replace(Target((1.0, 0.0, 0.0)), direction=(1.0, 0.0, 0.0), speed=4.5)
    velocity = (speed, abs(speed * math.tan(angle)), 0.0)
    came = {"hit": False, "lost": False, "miss_distance": miss, "tip_velocity": velocity}
    came |= {"arrival": Arrival(angle, speed, 0.05)}
    outcome = types.SimpleNamespace(**vars(OUTCOME) | came)
    assert f"m, missed {words}: closest {miss:.4f} m" in outcome_lines(outcome, asked, ARM)[0]
    missed = missed_by(outcome, asked)
    assert missed == dict(zip(("point", "direction", "speed"), map(pytest.approx, numbers), strict=True))


def test_what_misses_nothing_and_is_no_hit_is_not_known_well_enough():
    asked = dataclasses.replace(Target((1.0, 0.0, 0.0)), direction=(1.0, 0.0, 0.0))
    came = {"hit": False, "lost": False, "miss_distance": 0.0599, "tip_velocity": (5.0, 0.0, 0.0)}
    outcome = types.SimpleNamespace(**vars(OUTCOME) | came | {"arrival": Arrival(0.0, 5.0, 0.0599)})
    assert "m, missed by less than the uncertainty: closest 0.0599 m" in outcome_lines(outcome, asked, ARM)[0]
    assert missed_by(outcome, asked) == {"point": None, "direction": None, "speed": None}


def test_a_hit_and_a_strike_that_was_lost_miss_nothing():
    assert missed_by(OUTCOME, Target()) is None
    assert missed_by(types.SimpleNamespace(hit=False, lost=True), Target()) is None


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
    assert "allowed: only for a strike within limits; " in capsys.readouterr().err
    assert not Path("x.csv").exists()
    assert not Path("no").exists()


TABLE = """<mujoco><worldbody><geom name="table" type="box" size=".3 .5 .47" pos=".6 0 .47"/>
  <body name="a" pos="0 0 1"><joint name="j" axis="0 1 0" range="-170 170"/>
    <geom type="capsule" fromto="0 0 .1 0 0 .4" size=".05"/><site name="tip" pos="0 0 .6"/></body>
</worldbody></mujoco>"""


def test_what_the_smallest_distance_is_between_is_said(capsys):
    """Held out level, the link of j is 1 cm above a table of the world."""
    Path("world.xml").write_text(TABLE)
    words = ["--model", "world.xml", "--whip-length", "0.02", "--strike", "1.57", "1.5707963", "1"]
    assert simulate.main([*words, "--no-video", "--out", "level"]) == 0
    line = next(x for x in capsys.readouterr().out.splitlines() if x.startswith("  clearance"))
    assert "the distance from arm and whip to the arm, table and the floor at 0 m; nearest are the " in line
    result = json.loads(Path("level/result.json").read_text())
    assert result["nearest"] == ["the link of j", "table"]


def test_a_search_that_no_strike_comes_through_says_why(capsys):
    words = ["--method", "random", "--max-trials", "20", "--hit-radius", "0.01", "--no-video", "--floor", "-0.87"]
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
    table = limits_table(limits, moved, strike, ArmParameters((ArmLink(mass=0.3, length=0.5),)))
    assert table["joint_usage"] == pytest.approx(used)
    assert (table["beyond"] is None) == (not by_joints)


def test_shapes_that_are_taken_to_touch_are_told_with_their_cure():
    words = "at 0.000 s the link of j1 is 3 mm inside the link of j3"
    cured = f"{words}; if they never meet: arm.never_touch in a model file, or --ignore-collisions"
    assert with_cure(words, True) == cured
    for others in (None, words):
        assert with_cure(others, False) == others
    assert with_cure(None, True) is None


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
    assert f"{end} postures: got 'none that the arm can hold: " in said
    down = ["--lower", "-0.1", "-0.1", "0.2", "0.1", "0.5", "--upper", "1.7", "0.1", "1.5", "1.0", "1.0"]
    limits = AllLimits(XM430)
    bounds = StrikeBounds(*(tuple(map(float, x)) for x in (down[1:6], down[7:])))
    refuse_unheld(heavy, Controller(), limits, bounds)  # hanging, it needs no torque
