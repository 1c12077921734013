"""Answers: places, velocities and derivatives against rollouts of strikes that differ a little."""

from __future__ import annotations

import numpy as np
import pytest
from planar_map import random_strikes, striker

from whiptool.goals.goals import Goals
from whiptool.strike_map.answers import Answers
from whiptool.strike_map.harvest import RATE, passages_of, paths_of

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
