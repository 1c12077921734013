"""The units of a comparison on a tip that flies straight: targets, counts at several radii, libraries."""

from __future__ import annotations

import numpy as np
import pytest
from flights import scene

from whiptool.comparison.search_unit import SearchUnit
from whiptool.goals.arrival_rule import ArrivalRule
from whiptool.goals.target import Target
from whiptool.objective import Objective
from whiptool.optimizers import search


def test_targets_are_drawn_once_for_all():
    points = scene().points()
    assert points.shape == (7, 2)
    assert (np.linalg.norm(points - [0.8, -0.8], axis=1) <= 0.2).all()
    np.testing.assert_array_equal(points, scene().points())
    assert not np.array_equal(points, scene(target_seed=1).points())


@pytest.mark.parametrize("method", ["random", "directl"])
def test_a_search_unit_counts_to_the_first_trial_within_each_radius(method):
    s = scene()
    result = SearchUnit(scene=s, method=method, seed=3, first=2, last=6).run(None, None)
    assert [(x["convention"], x["hit_radius"]) for x in result["outcomes"]] == [("", 0.3), ("", 0.1)]
    diverged = 0
    for place, i in enumerate(range(2, 6)):
        objective = Objective(s.rollout(), Target(tuple(s.points()[i]), 0.1), max_trials=12, stop_at_hit=True)
        seed = int(np.random.SeedSequence((3, i)).generate_state(1)[0]) >> 1
        trace = search(objective, method, seed=seed).trace
        diverged += sum(trial.outcome.diverged for trial in trace)
        for outcome in result["outcomes"]:
            within = [t.number for t in trace if t.outcome.miss_distance <= outcome["hit_radius"]]
            assert outcome["trials"][place] == (within[0] if within else 12)
            assert outcome["hit"][place] is bool(within)
    hits = [sum(x["hit"]) for x in result["outcomes"]]
    assert hits[0] > 0
    assert hits[0] >= hits[1]
    assert result["n_diverged"] == diverged
    assert (result["training_trials"], result["note"]) == (0, "")
    assert result["wall_time"] > 0


@pytest.mark.parametrize("method", ["library", "random"])
def test_a_library_comes_before_the_search(method):
    unit = SearchUnit(scene=scene(), method=method, seed=1, first=0, last=3, library=400)
    result = unit.run(None, None)
    assert result["training_trials"] == 400
    assert result["outcomes"][1]["trials"] == [1, 1, 1]  # some of 400 straight lines passed there
    assert all(result["outcomes"][1]["hit"])
    assert unit.series == ("library" if method == "library" else "random+library")


def test_targets_stay_where_they_are_when_directions_are_asked_for():
    asked = scene(arrival=ArrivalRule(angle=(-1.0, 0.0)))
    np.testing.assert_array_equal(asked.points(), scene().points())
    angles = np.arctan2(*asked.goals().directions.T[::-1])
    assert ((angles >= -1) & (angles <= 0)).all()
    assert np.ptp(angles) > 0.2
    np.testing.assert_array_equal(asked.goals().directions, asked.goals().directions)
    assert asked.goals().hit_radius == 0.3


@pytest.mark.parametrize("method", ["random", "cmaes"])
def test_a_search_unit_searches_for_directions_at_each_radius(method):
    """A direction counts in hit radii, so that searches differ: each radius has its own."""
    rule = ArrivalRule(angle=(-1.2, -0.5), cone=0.3)
    s = scene(arrival=rule)
    result = SearchUnit(scene=s, method=method, seed=3, first=2, last=6).run(None, None)
    angles = np.arctan2(*s.goals().directions.T[::-1])
    found = 0
    for outcome, radius in zip(result["outcomes"], (0.3, 0.1), strict=True):
        assert outcome["hit_radius"] == radius
        for place, i in enumerate(range(2, 6)):
            target = Target.arriving(tuple(s.points()[i]), angles[i], hit_radius=radius, cone=0.3)
            objective = Objective(s.rollout(), target, max_trials=12, stop_at_hit=True)
            seed = int(np.random.SeedSequence((3, i)).generate_state(1)[0]) >> 1
            hits = [t.number for t in search(objective, method, seed=seed).trace if t.outcome.hit]
            assert outcome["trials"][place] == (hits[0] if hits else 12)
            assert outcome["hit"][place] is bool(hits)
            found += bool(hits)
    assert found > 0
