"""Candidates: first order means that the error is of second, and that nothing leaves the box."""

from __future__ import annotations

import numpy as np
import pytest
from planar_map import AIMED, random_strikes, striker

from whiptool.strike_map.answers import Answers, Front
from whiptool.strike_map.building import passages_of
from whiptool.strike_map.strike_map import candidates


@pytest.fixture(scope="module")
def made():
    one = striker()
    strikes = random_strikes(one, 64, seed=2)
    which = np.arange(64)
    return one, passages_of(one, strikes, which, np.full(64, 200))


def goal_beside(answer: Answers, away: float):
    """The goal that an answer reaches, but for a distance across its path and an angle that belongs to it."""
    speed = np.linalg.norm(answer.velocities, axis=1)
    across = np.stack([-answer.velocities[:, 1], answer.velocities[:, 0]], axis=1) / speed[:, None]
    turned = answer.velocities + away * speed[:, None] * across
    return AIMED.goals_of(answer.tips + away * across, turned)


def test_what_is_missed_falls_with_the_square_of_the_distance(made):
    one, answers = made
    front, errors = Front(one.rollout.model), []
    for away in (0.01, 0.005):
        missed = []
        for k in range(len(answers)):
            answer = answers.take(np.array([k]))
            goal = goal_beside(answer, away)
            found = candidates(one, answer, front, goal)
            inside = (found.strikes[0] > one.lower).all() and (found.strikes[0] < one.upper).all()
            nearest = one.strike(found.strikes, goal)
            missed.append(nearest.cost[0] if inside and found.left[0] < 1e-3 else np.nan)
        errors.append(missed)
    coarse, fine = (np.array(x) for x in errors)
    known = np.isfinite(coarse) & np.isfinite(fine)
    assert known.sum() > 20
    assert np.median(fine[known] / coarse[known]) == pytest.approx(0.25, abs=0.08)
    assert np.median(coarse[known]) < 0.3 * 0.01


def test_they_come_in_the_order_of_doubt_and_stay_in_the_box(made):
    one, answers = made
    found = candidates(one, answers, Front(one.rollout.model), goal_beside(answers.take(np.array([5])), 0.02))
    assert len(found.strikes) == 64
    assert (np.diff(found.doubt) >= 0).all()
    assert one.inside(found.strikes).all()
    np.testing.assert_allclose(found.doubt, np.linalg.norm(found.change, axis=1) / 0.2 + found.left)


def test_their_slopes_are_those_of_the_closest_approach(made):
    """At a goal that an answer hits, derivatives at the moving closest approach are the rollout's exact ones."""
    one, answers = made
    front, near = Front(one.rollout.model), []
    for k in range(0, 64, 4):
        answer = answers.take(np.array([k]))
        goal = AIMED.goals_of(answer.tips, answer.velocities)
        found = candidates(one, answer, front, goal)
        exact = one.derivatives(answer.strikes, goal)
        near.append(np.abs(found.slopes[0, :2] - exact[0, :2]).max() / np.abs(exact[0, :2]).max())
    assert np.median(near) < 0.02
