"""Strikes at the one target that methods find."""

from __future__ import annotations

import numpy as np
import pytest
from human_data import BLOCKS, PEOPLE, TRIALS, write_made_up

from papers.human.machine_strikes import METHODS, StrikeUnit, by_method, curve, machine, people_misses, target_of
from papers.human.reading import read_people


@pytest.mark.parametrize("method", ["gradient", "CMA-ES"])
def test_a_unit_keeps_the_best_of_its_trials(method):
    found = StrikeUnit(method=method, seed=1, hit_radius=0.04, trials=40).run(None, 1)
    assert len(found["misses"]) <= 40
    assert found["miss_distance"] == pytest.approx(min(found["misses"]))
    near = machine(1).approach(np.array([found["strike"]]), target_of(0.04).position)
    assert near.distance[0] == pytest.approx(found["miss_distance"])


def test_by_method():
    found = [{"method": "SAC", "strike": [1.0, 2]}, {"method": "CMA-ES", "strike": [3.0, 4]}]
    assert list(by_method(found)) == [x for x in METHODS if x in ("SAC", "CMA-ES")]


def test_a_law_of_practice_is_found():
    trial = np.arange(1, 101)
    misses = [(1 + 0.1 * k) * trial**-0.5 for k in range(-2, 3)]
    found = curve("practice", misses)
    np.testing.assert_allclose(found.median, found.trial**-0.5, rtol=0.1)
    assert (found.low <= found.median).all()
    assert (found.median <= found.high).all()
    assert found.learners == 5


def test_bins_that_few_reach_are_left_out():
    found = curve("some", [[0.1, 0.2, None], [0.1], [0.1]])
    assert found.trial.tolist() == [1.0]
    assert found.median[0] == pytest.approx(0.1)


def test_throws_of_people_are_in_order(tmp_path):
    people = read_people(write_made_up(tmp_path))
    misses = people_misses(people, "rhythmic")
    assert [len(one) for one in misses] == [BLOCKS * TRIALS] * PEOPLE
    throws = people.throws[(people.throws["style"] == "rhythmic") & (people.throws["person"] == 1)]
    assert misses[0] == throws["min_distance"].tolist()
