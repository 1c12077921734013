"""What commands tell people of a strike: units of joints that turn and that slide, and torques that are not known."""

from __future__ import annotations

import dataclasses
import types

from whiptool.commands.optimize import outcome_lines, strike_lines
from whiptool.models import SpatialArm
from whiptool.models.spatial_arm import JointLimits, SpatialLink, without_inertia
from whiptool.objective import Arrival
from whiptool.target import Target

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


def test_a_near_miss_that_does_not_arrive_as_asked_is_told_as_such():
    aside = dataclasses.replace(Target((1.0, 0.0, 0.0)), direction=(1.0, 0.0, 0.0))
    came = types.SimpleNamespace(**vars(OUTCOME) | {"hit": False, "arrival": Arrival(2.0, 3.0, 0.05)})
    assert (
        "near enough, but missed, as it does not arrive as asked: closest 0.0100 m"
        in outcome_lines(came, aside, ARM)[0]
    )
    far = types.SimpleNamespace(**vars(came) | {"miss_distance": 0.5})
    assert "m, missed: closest 0.5000 m" in outcome_lines(far, aside, ARM)[0]
