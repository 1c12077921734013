"""What commands tell people of a strike: units of joints that turn and that slide, and torques that are not known."""

from __future__ import annotations

import dataclasses
import math
import types

import pytest

from whiptool.commands.strike_lines import missed_by, outcome_lines, strike_lines
from whiptool.goals.target import Target
from whiptool.models import SpatialArm
from whiptool.models.spatial_arm import JointLimits, SpatialLink, without_inertia
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
