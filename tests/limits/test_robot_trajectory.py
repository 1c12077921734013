"""The trajectory that a robot is given for a strike: names and rate of its controller, and a whip that hangs still."""

from __future__ import annotations

import dataclasses
import re

import numpy as np
import pytest

from whiptool.limits import robot_trajectory
from whiptool.limits.all_limits import default_limits
from whiptool.limits.robot_trajectory import Execution, swing_period
from whiptool.models import preset
from whiptool.models.excess import Excess
from whiptool.models.strike import Strike
from whiptool.rollout.servo_replay import replay_trajectory

LEMON = preset("lemon2024")


@pytest.mark.parametrize(
    ("name", "rate", "first"),
    [("ur5e", 500, "shoulder_pan_joint"), ("panda", 1000, "panda_joint1"), ("nah2023", 500, "")],
)
def test_a_presets_trajectory_has_the_names_and_the_rate_of_the_robots_controller(name, rate, first):
    model = preset(name)
    middle = np.array([np.clip(np.mean(np.clip(x.position, -3, 3)), -1, 1) for x in model.arm.joint_limits])
    strike = Strike(tuple(middle), tuple(middle + 0.1), 1.0)
    found, _ = Execution(rest=0.1).of_strike(model, strike, 0.1)
    assert found.t[1] == pytest.approx(1 / rate)
    assert found.joints[0] == (first or model.arm.joints[0])
    faster, _ = Execution(rest=0.1, rate=250.0, prefix="a_").of_strike(model, strike, 0.1)
    assert faster.t[1] == pytest.approx(1 / 250)
    assert faster.joints == tuple("a_" + joint for joint in found.joints)


def test_the_slowest_swing_is_that_of_a_hanging_chain():
    """Of a thin uniform chain, 2 pi / (j / 2 sqrt(g / L)) with the Bessel function's first zero j = 2.4048."""
    chain = 4 * np.pi / 2.404826 * np.sqrt(1.0 / 9.81)
    assert swing_period(preset("ur5e")) == pytest.approx(chain, rel=5e-3)


def test_a_strike_is_judged_with_the_whip_that_was_identified():
    """Its own length counts, not that of the whip that the limits were given for."""
    model = preset("ur5e")
    long = dataclasses.replace(model, whip=dataclasses.replace(model.whip, l=model.whip.per_node("l") * 1.5))
    start = (0.1, -1.9, 1.2, -0.9, 0.3, 0.0)
    strike, limits = Strike(start, (0.12, *start[1:]), 0.6), default_limits(long, prescribed=True)
    execution = Execution(posture=start)
    assert "below the floor" in (execution.judged(long, strike, 0.2, limits)[1] or "")
    assert execution.judged(model, strike, 0.2, limits)[1] is None


def test_what_is_beyond_a_limit_is_said():
    model = preset("ur5e")
    limits = default_limits(model, prescribed=True)
    start = (0.1, -1.9, 1.2, -0.9, 0.3, 0.0)
    strike = Strike(start, (0.5, -1.2, 0.6, -1.6, -0.4, 0.2), 0.6)
    assert Execution().of_strike(model, strike, 0.2, limits)[1] is None
    assert "below the floor" in (
        Execution(posture=(0.4, 1.5, 0, 0, 0, 0)).of_strike(model, strike, 0.2, limits)[1] or ""
    )
    quick = Strike(start, strike.q_f, 0.3)
    assert "velocity" in (Execution().of_strike(model, quick, 0.2, limits)[1] or "")


def test_strikes_of_one_model_are_judged_by_one_simulator_and_one_swing(monkeypatch):
    """A planner asks of many strikes, and each simulator and each swing takes longer than a strike."""
    made = []

    def counted(name):
        make = getattr(robot_trajectory, name)
        monkeypatch.setattr(robot_trajectory, name, lambda *args, **kw: made.append(name) or make(*args, **kw))

    counted("CompiledRollout")
    counted("hanging_modes")
    model = dataclasses.replace(preset("ur5e"), gravity=9.8)  # which no other test has
    limits = default_limits(model, prescribed=True)
    start = (0.1, -1.9, 1.2, -0.9, 0.3, 0.0)
    for end in (-1.2, -1.25):
        strike = Strike(start, (0.5, end, 0.6, -1.6, -0.4, 0.2), 0.6)
        said = Execution(posture=(-1.5, -1.2, -0.2, -0.5, 2.0, 0.4)).judged(model, strike, 0.2, limits)[1]
        assert re.match(r"0\.\d\d\d s into the strike the whip's node 20 is \d+ mm below the floor", said or "")
    assert sorted(made) == ["CompiledRollout", "hanging_modes"]


def test_an_instant_is_on_the_way_to_the_start_or_in_the_strike():
    beyond = Excess("the arm is low", 2.9)
    assert str(beyond) == "at 2.900 s the arm is low"
    assert beyond.by_parts(3.0) == "on the way to the start, at 2.900 s, the arm is low"
    assert beyond.by_parts(2.75) == "0.150 s into the strike the arm is low"
    assert str(Excess("the arm is low")) == Excess("the arm is low").by_parts(3.0) == "the arm is low"


@pytest.mark.slow
def test_the_whip_hangs_still_after_the_way_to_the_start():
    """In MuJoCo, of a whip of 6 nodes of a Panda: after the fastest movement within the limits it swings by 20 cm."""
    model = preset("panda").with_whip(nodes=6)
    strike = Strike((1.0, 0.3, -0.5, -1.2, 0.5, 1.4, 0.2), (1.0, 0.3, -0.5, -1.2, 0.5, 1.4, 0.2), 1.0)
    here = (0.0, -0.3, 0.0, -1.8, 0.0, 1.6, 0.8)
    found, _ = Execution(posture=here, rate=250.0, rest=2.0).of_strike(model, strike, 0.1)
    moved = replay_trajectory(model, found)
    resting = moved.t > found.t[np.flatnonzero(found.v.any(axis=1))[-1]] + 0.1
    tip = moved.tip[resting]
    assert np.ptp(tip, axis=0).max() < 0.04
