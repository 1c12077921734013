"""The heat map counts the paths that pass each cell, and follows the model."""

from __future__ import annotations

import numpy as np
import pytest

import whiptool as wt
from whiptool.live_page.heat_map import RATE, Sampled, heat_map
from whiptool.live_page.session import Session


@pytest.fixture(scope="module")
def session():
    return Session(wt.preset("lemon2024"))


def test_shares_are_those_of_the_paths(session):
    found, heat = session.random_strikes(), session.heat_map()
    assert len(found.strikes) == 512  # a planar arm has no limits
    dense = wt.CompiledRollout(session.model).tip_path(found.strikes[:100], rate=2000.0)[1]
    partly = heat_map(session.striker, Sampled(found.strikes[:100], found.paths[:100]), np.zeros(2)).shares
    rows, columns = heat.shares.shape
    for x, y in ((1.2, 0.1), (0.9, -0.8), (-0.6, 0.6), (1.5, 1.5)):
        column, row = (int((v - heat.low[i]) // heat.cell) for i, v in enumerate((x, y)))
        low = heat.low + heat.cell * np.array([column, row])
        inside = ((dense >= low) & (dense < low + heat.cell)).all(axis=2).any(axis=1)
        assert partly[rows - 1 - row, column] == pytest.approx(inside.mean(), abs=0.03)
    assert columns == rows == 80


def test_a_longer_whip_reaches_farther(session):
    before = session.heat_map()
    session.turn_whip("length", 1.3)
    after = session.heat_map()
    session.reset_whip()

    def farthest(heat) -> float:
        centres = heat.low[0] + heat.cell * (np.arange(heat.shares.shape[1]) + 0.5)
        return float(centres[heat.shares.any(axis=0)].max())

    assert farthest(after) > farthest(before) + 0.2


def test_a_robot_that_turns_has_one_map_all_around():
    session = Session(wt.preset("ur5e"))
    heat = session.heat_map()
    place = (-0.3, 1.2, 0.5)
    session.move_target(wt.Target(place))
    turned, kept = heat_map(session.striker, session.random_strikes(), np.array(place)), session.heat_map()
    assert kept.shares is heat.shares  # which the page shows already
    assert kept.azimuth == turned.azimuth
    np.testing.assert_array_equal(turned.shares, heat.shares)
    assert turned.azimuth == pytest.approx(np.arctan2(1.2, -0.3))
    low = heat.low[1] + heat.cell * (heat.shares.shape[0] - 1 - np.flatnonzero(heat.shares.any(axis=1)).max())
    assert low >= -heat.cell  # no tip of a strike within the limits goes below the floor


def test_the_nearest_strikes_pass_the_target(session):
    goal = wt.Target((1.2, 0.1)).goals
    best = session.random_strikes().nearest(goal, 3)
    near = session.striker.rollout.approach(best, np.array([1.2, 0.1]))
    every = session.striker.rollout.approach(session.random_strikes().strikes, np.array([1.2, 0.1]))
    fastest = 30.0
    assert near.distance[0] <= every.distance.min() + fastest / RATE
    assert (np.sort(near.distance) <= np.sort(every.distance)[:20].max() + 0.1).all()
