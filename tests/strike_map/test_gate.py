"""The gate learns the odds of data whose odds are known, and sees what it should."""

from __future__ import annotations

import numpy as np
import pytest

torch = pytest.importorskip("torch")

from planar_map import AIMED, random_strikes, striker  # noqa: E402

from whiptool.strike_map.answers import Front  # noqa: E402
from whiptool.strike_map.building import passages_of  # noqa: E402
from whiptool.strike_map.strike_map import (  # noqa: E402
    Gate,
    candidates,
    features,
)


def test_odds_are_those_that_the_data_were_drawn_from():
    rng = np.random.default_rng(0)
    seen = rng.normal(3, 2, (3000, 4))
    truth = 1.5 * (seen[:, 0] - 3) / 2 - 1
    hit = rng.random(3000) < 1 / (1 + np.exp(-truth))
    gate = Gate.trained(seen, hit, seed=0)
    fresh = rng.normal(3, 2, (1000, 4))
    expected = 1.5 * (fresh[:, 0] - 3) / 2 - 1
    probability, wanted = (1 / (1 + np.exp(-x)) for x in (gate.odds(fresh), expected))
    assert np.corrcoef(gate.odds(fresh), expected)[0, 1] > 0.8
    assert np.abs(probability - wanted).mean() < 0.15


def test_the_same_seed_gives_the_same_gate():
    rng = np.random.default_rng(1)
    seen, hit = rng.normal(size=(300, 3)), rng.random(300) < 0.5
    first, same, other = (Gate.trained(seen, hit, seed=seed).odds(seen) for seed in (1, 1, 2))
    np.testing.assert_array_equal(first, same)
    assert np.abs(first - other).max() > 1e-3


def test_it_sees_goal_strike_change_and_what_is_left():
    one = striker()
    answers = passages_of(one, random_strikes(one, 8), np.arange(8), np.full(8, 200))
    goal = AIMED.goals_of(answers.tips[[3]] + 0.01, answers.velocities[[3]])
    found = candidates(one, answers, Front(one.rollout.model), goal)
    seen = features(one, Front(one.rollout.model), goal, found)
    assert goal.directions is not None
    np.testing.assert_allclose(seen[:, :2], np.tile(goal.positions / one.rollout.model.reach, (8, 1)))
    np.testing.assert_allclose(seen[:, 2:4], np.tile(goal.directions, (8, 1)))
    box = 2 * (found.strikes - one.lower) / one.widths - 1
    np.testing.assert_allclose(seen[:, 4:9], box)
    np.testing.assert_allclose(seen[:, 9:15], np.tanh(found.change))
    assert seen.shape == (8, 17)
