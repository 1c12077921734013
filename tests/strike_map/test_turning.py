"""Turning to the front: which arms turn, and that a turned strike does the same elsewhere."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from whiptool.goals.arrival_rule import ArrivalRule
from whiptool.goals.zone import Disc, Sector
from whiptool.impedance import Controller, PositionControl
from whiptool.models import default_bounds, preset
from whiptool.models.mount import turns_as_a_whole
from whiptool.rollout import CompiledRollout
from whiptool.strike_map import GoalRegion
from whiptool.strike_map.turning import Front, bounds_all_around


def ur5e():
    model = preset("ur5e")
    return replace(model, whip=replace(model.whip, joints="rod", node_inertia=0.0))


def test_robots_on_a_turntable_turn_and_others_do_not():
    assert turns_as_a_whole(preset("ur5e").arm)
    assert turns_as_a_whole(preset("panda").arm)
    assert not turns_as_a_whole(preset("nah2023").arm)
    assert not turns_as_a_whole(preset("lemon2024").arm)
    arm = preset("ur5e").arm
    aside = replace(arm.links[0], position=(0.1, 0.0, 0.1625))
    assert not turns_as_a_whole(replace(arm, links=(aside, *arm.links[1:])))
    tilted = replace(arm.links[0], rotation=((0, 0, 1), (0, 1, 0), (-1, 0, 0)))
    assert not turns_as_a_whole(replace(arm, links=(tilted, *arm.links[1:])))


def test_a_joint_that_turns_the_arm_has_room_all_around():
    arm = preset("ur5e").arm
    lower, upper = bounds_all_around(arm).box
    usual_lower, usual_upper = default_bounds(arm).box
    turned, others = [0, 6], [1, 2, 3, 4, 5, 7, 8, 9, 10, 11, 12]
    np.testing.assert_array_equal(upper[turned], 2 * np.pi)
    np.testing.assert_array_equal(lower[turned], -2 * np.pi)
    np.testing.assert_array_equal(np.c_[lower, upper][others], np.c_[usual_lower, usual_upper][others])
    assert bounds_all_around(preset("panda").arm) == default_bounds(preset("panda").arm)  # 2.9 rad, as its joint has
    assert bounds_all_around(preset("nah2023").arm) == default_bounds(preset("nah2023").arm)


def test_what_does_not_turn_is_left_alone():
    front, rng = Front(preset("nah2023")), np.random.default_rng(0)
    vectors, strikes = rng.normal(size=(5, 3)), rng.normal(size=(5, 9))
    np.testing.assert_array_equal(front.angles(vectors), 0)
    np.testing.assert_array_equal(front.vectors(vectors, np.ones(5)), vectors)
    np.testing.assert_array_equal(front.strikes(strikes, np.ones(5)), strikes)


def test_to_the_front_and_back():
    front, rng = Front(preset("ur5e")), np.random.default_rng(0)
    points = rng.normal(size=(50, 3))
    angles = front.angles(points)
    ahead = front.vectors(points, -angles)
    np.testing.assert_allclose(ahead[:, 1], 0, atol=1e-12)
    assert (ahead[:, 0] > 0).all()
    np.testing.assert_array_equal(ahead[:, 2], points[:, 2])
    np.testing.assert_allclose(front.vectors(ahead, angles), points)
    quarter = front.vectors(np.array([[1.0, 0.0, 0.0]]), np.array([np.pi / 2]))
    np.testing.assert_allclose(quarter, [[0, 1, 0]], atol=1e-15)
    columns = rng.normal(size=(50, 3, 4))
    for j in range(4):
        np.testing.assert_allclose(front.vectors(columns, angles)[:, :, j], front.vectors(columns[:, :, j], angles))


def test_a_zone_lies_in_its_azimuths():
    front = Front(preset("ur5e"))
    found = front.azimuths(Sector(1.0, 2.0, -0.5, 0.5, 0.4), np.random.default_rng(0))
    assert -0.4 <= found.min() < -0.38
    assert 0.38 < found.max() <= 0.4


@pytest.mark.slow
def test_a_turned_strike_hits_the_turned_goal_in_the_same_way():
    model = ur5e()
    rollout = CompiledRollout(model, Controller(PositionControl()), timestep=1.5e-3)
    strikes = np.array([[0.2, -1.6, 0.4, -0.5, 0.3, 0.1, 0.9, -1.1, 0.9, -0.2, 0.5, 0.2, 0.7]])
    region = GoalRegion(Disc((1.0, 0.3, 0.5), 0.5), ArrivalRule(angle=(-np.pi, np.pi)))
    goals = region.rule.goals(np.array([[1.0, 0.3, 0.5]]), 0.06, np.array([[0.7]]))
    front, angle = Front(model), np.array([0.6])
    turned = front.goals(goals, angle)
    here = rollout.approach(strikes, goals.positions)
    there = rollout.approach(front.strikes(strikes, angle), turned.positions)
    np.testing.assert_allclose(there.distance, here.distance, atol=1e-9)
    np.testing.assert_allclose(turned.angle(there.velocity), goals.angle(here.velocity), atol=1e-8)
    np.testing.assert_allclose(there.velocity, front.vectors(here.velocity, angle), atol=1e-8)
