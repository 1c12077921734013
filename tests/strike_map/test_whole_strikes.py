"""Limits that are judged on whole strikes: in landings, in answers, and after refinement."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from planar_map import POINTS, random_strikes, striker
from short_strikes import ShortStrikes

pytest.importorskip("torch")

from whiptool.strike_map import Building, MapPlan, StrikeMap
from whiptool.strike_map.building import Harvest
from whiptool.strike_map.strike_map import TRIED
from whiptool.strike_map.striker import refine

LONGEST = 1.1  # [s]


def test_only_would_be_hits_are_judged_and_only_short_ones_are_hits():
    free, limit = striker(), ShortStrikes(LONGEST)
    short = striker(limit)
    strikes = random_strikes(free, 40)
    goals = POINTS.rule.goals_at(np.full((40, 2), [1.3, 0.0]), 0.4)
    landed, struck = free.strike(strikes, goals), short.strike(strikes, goals)
    assert 3 < landed.hit.sum() < 40
    assert limit.judged == landed.hit.sum()
    lasts = strikes[:, -1] + short.t_stay
    np.testing.assert_array_equal(struck.hit, landed.hit & (lasts <= LONGEST))
    assert 0 < struck.hit.sum() < landed.hit.sum()
    np.testing.assert_allclose(struck.beyond[landed.hit], np.maximum(lasts - LONGEST, 0)[landed.hit], atol=1e-3)
    np.testing.assert_array_equal(short.land(strikes, goals).hit, landed.hit)


def test_answers_are_of_strikes_that_keep_them():
    short = striker(ShortStrikes(LONGEST))
    strikes = random_strikes(short, 300)
    found = Harvest(short, POINTS, np.random.default_rng(0)).pick(strikes, room=1)
    free = Harvest(striker(), POINTS, np.random.default_rng(0)).pick(strikes, room=1)
    assert len(found) > 30
    assert found.strikes[:, -1].max() <= LONGEST - short.t_stay + 1e-3
    assert free.strikes[:, -1].max() > LONGEST


def test_a_gate_is_trained_without_judging_whole_strikes():
    limit = ShortStrikes(LONGEST)
    building = Building(striker(limit), POINTS, MapPlan(gate_strikes=60, per_goal=6), seed=0)
    rng = np.random.default_rng(0)
    answers = Harvest(striker(), POINTS, rng).pick(random_strikes(building.striker, 300), room=1)
    gate = building.gate(answers)
    assert limit.judged == 0
    assert np.isfinite(gate.odds(np.zeros((1, len(gate.mean)))))


def test_the_first_candidate_that_keeps_them_is_chosen():
    limit = ShortStrikes(LONGEST)
    answers = Harvest(striker(), POINTS, np.random.default_rng(0)).pick(random_strikes(striker(), 300), room=2)
    made = StrikeMap(striker(limit), POINTS, answers)
    goals = POINTS.draw(30, np.random.default_rng(1))
    chosen, best = made.kept(goals), made.strikes(goals)
    for i in range(30):
        strikes = made.candidates(goals.rows(np.array([i]))).strikes[:TRIED]
        short = strikes[:, -1] + made.striker.t_stay <= LONGEST
        np.testing.assert_array_equal(chosen[i], strikes[short.argmax()])  # the first, if none is
    same = (chosen == best).all(axis=1)
    assert 0 < same.sum() < 30
    target = (float(goals.positions[0, 0]), float(goals.positions[0, 1]))
    with warnings.catch_warnings(action="ignore"):  # of a goal none of whose candidates is short
        np.testing.assert_array_equal(made.strike(target, refined=False).vector, chosen[0])
    np.testing.assert_array_equal(StrikeMap(striker(), POINTS, answers).kept(goals), best)


def test_refinement_goes_its_way_and_is_judged_at_its_end():
    """As without them, but that what is beyond them is no hit."""
    limit = ShortStrikes(LONGEST)
    free, short = striker(), striker(limit)
    strikes = random_strikes(free, 12)
    near = free.rollout.approach(strikes, np.array([1.3, 0.0]))
    goals = POINTS.rule.goals_at(near.tip + 0.03, 0.02)
    one, other = refine(free, goals, strikes), refine(short, goals, strikes)
    np.testing.assert_array_equal(one.strikes, other.strikes)
    assert limit.judged == one.struck.hit.sum()
    lasts = one.strikes[:, -1] + short.t_stay
    np.testing.assert_array_equal(other.struck.hit, one.struck.hit & (lasts <= LONGEST))
    assert 0 < other.struck.hit.sum() < one.struck.hit.sum()
