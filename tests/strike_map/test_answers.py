"""Answers: places, velocities and derivatives against rollouts of strikes that differ a little."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from planar_map import random_strikes, striker

from whiptool.goals.arrival_rule import ArrivalRule
from whiptool.goals.goals import Goals
from whiptool.goals.zone import Disc, Sector
from whiptool.impedance import Controller, PositionControl
from whiptool.models import default_bounds, preset
from whiptool.models.mount import turns_as_a_whole
from whiptool.rollout import CompiledRollout
from whiptool.strike_map import GoalRegion
from whiptool.strike_map.answers import Answers, Front, bounds_all_around
from whiptool.strike_map.building import RATE, passages_of, paths_of

STEP = 1e-5


@pytest.fixture(scope="module")
def made():
    one = striker()
    strikes = random_strikes(one, 12)
    which, when = np.repeat(np.arange(12), 3), np.tile([60, 150, 260], 12)
    return one, strikes, which, when, passages_of(one, strikes, which, when)


def test_a_passage_is_where_the_tip_is_at_its_instant(made):
    one, strikes, which, when, found = made
    for k in range(0, len(found), 5):
        path = one.rollout.trajectory(strikes[which[k]])
        t = when[k] / RATE
        tip = [np.interp(t, path.t, path.tip[:, c]) for c in range(2)]
        velocity = [np.interp(t, path.t, path.tip_velocity[:, c]) for c in range(2)]
        np.testing.assert_allclose(found.tips[k], tip, atol=1e-4)
        np.testing.assert_allclose(found.velocities[k], velocity, atol=0.01 * (1 + np.abs(velocity).max()))
    np.testing.assert_array_equal(found.strikes, strikes[which])


def test_derivatives_by_the_strike_against_differences_at_the_same_instant(made):
    one, strikes, which, when, found = made
    for j in range(5):
        moved = [strikes.copy() for _ in range(2)]
        for sign, some in zip((1, -1), moved, strict=True):
            some[:, j] += sign * STEP
        (_, up, up_velocity), (_, down, down_velocity) = (paths_of(one, some) for some in moved)
        by_tip = (up - down)[which, when] / (2 * STEP)
        by_velocity = (up_velocity - down_velocity)[which, when] / (2 * STEP)
        scale = np.abs(by_tip).max()
        np.testing.assert_allclose(found.tip_slopes[:, :, j], by_tip, atol=1e-4 * scale, rtol=1e-4)
        np.testing.assert_allclose(found.velocity_slopes[:, :, j], by_velocity, atol=1e-3 * np.abs(by_velocity).max())


def test_the_last_column_is_the_motion_along_the_path(made):
    one, strikes, which, when, found = made
    kept, paths, velocities = paths_of(one, strikes)
    ahead, behind = (velocities[which, when + step] for step in (1, -1))
    np.testing.assert_array_equal(kept, np.arange(len(strikes)))
    np.testing.assert_allclose(found.tip_slopes[:, :, -1], velocities[which, when])
    acceleration = (ahead - behind) * RATE / 2  # of velocities, over twice as far as the answers' own differences
    error = np.abs(found.velocity_slopes[:, :, -1] - acceleration)
    assert np.median(error) < 0.05 * np.median(np.abs(acceleration))
    assert np.isnan(velocities[:, 0]).all()
    np.testing.assert_allclose(velocities[0, 5], (paths[0, 6] - paths[0, 4]) * RATE / 2)


def test_the_shortlist_is_what_leaves_least_of_a_goal(made):
    found = made[-1]
    goal = Goals(np.array([[1.0, -0.3]]), 0.03, np.array([[0.6, 0.8]]))
    left = [np.linalg.norm(goal.residuals(found.tips[[k]], found.velocities[[k]])) for k in range(len(found))]
    order = found.shortlist(goal, 7)
    np.testing.assert_array_equal(order, np.argsort(left, kind="stable")[:7])
    assert len(found.shortlist(goal, 1000)) == len(found)


def test_parts_join_and_split(made):
    found = made[-1]
    again = Answers.joined([found.take(slice(0, 10)), found.take(np.arange(10, len(found)))])
    np.testing.assert_array_equal(again.velocity_slopes, found.velocity_slopes)
    assert repr(again) == f"Answers({len(found)} passages)"


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
