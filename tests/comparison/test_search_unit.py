"""The units of a comparison on a tip that flies straight: targets, counts at several radii, libraries."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from fake_rollout import SPEED, StraightFlight, StraightFlightInSpace
from flights import scene

from whiptool.comparison.search_unit import RATE, SearchUnit, StrikeLibrary, library_search, warm_search
from whiptool.comparison.units import Store, unit_file
from whiptool.errors import InputError
from whiptool.goals.arrival_rule import ArrivalRule
from whiptool.goals.target import Target
from whiptool.models.strike import StrikeBounds
from whiptool.objective import Objective
from whiptool.optimizers import search


def outcomes(**changes) -> dict:
    """What a unit of two targets stores for its hit radii, the first of them changed."""
    found = [{"convention": "", "hit_radius": x, "trials": [3, 1], "hit": [True, False]} for x in scene().radii]
    return {"outcomes": [found[0] | changes, *found[1:]]}


FOUND = {**outcomes(), "training_trials": 0, "n_diverged": 0, "wall_time": 1.0, "note": ""}
DAMAGES = [
    *({"outcomes": x} for x in ([], None, [{}])),
    *(outcomes(**x) for x in ({"trials": [3]}, {"trials": [3, "x"]}, {"hit": [1, 0]}, {"hit_radius": 9.0})),
    {"n_diverged": "x"},
    {"wall_time": []},
    {"wall_time": math.nan},
]


@pytest.mark.parametrize("damage", DAMAGES, ids=str)
def test_a_damaged_result_is_refused_by_its_file_and_kept(damage, tmp_path):
    unit = SearchUnit(scene=scene(), method="random", seed=0, first=0, last=2)
    store = Store(tmp_path)
    path = unit_file(store.units, unit.key)
    path.write_text(json.dumps(FOUND))
    assert store.results([unit]) == {unit.key: FOUND}
    path.write_text(text := json.dumps(FOUND | damage))
    with pytest.raises(InputError, match=f"{unit.key}.*delete it"):
        store.results([unit])
    assert path.read_text() == text


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
    assert unit.series[0] == ("library" if method == "library" else "random+library")


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


BOUNDS = StrikeBounds((-1.0, 0.0, 0.1, 0.2, 0.4), (1.0, 0.5, 0.3, 0.8, 1.0))


def library(count: int = 200, seed: int = 0) -> StrikeLibrary:
    return StrikeLibrary.random(StraightFlight(), BOUNDS, count, seed=seed)


def test_paths_are_those_of_the_strikes():
    kept = library(5000)
    assert kept.paths.shape == (5000, int(1.3 * RATE) + 1, 2)
    assert kept.paths.dtype == np.float32
    for i in (0, 4095, 4096, 4999):
        path = StraightFlight().tip_path(kept.strikes[[i]], t_stay=0.3, rate=RATE)[1][0]
        np.testing.assert_allclose(kept.paths[i, : len(path)], path, atol=1e-6)
        assert np.isnan(kept.paths[i, len(path) :]).all()
    assert (kept.strikes.min(axis=0) >= BOUNDS.lower).all()
    assert not np.array_equal(library(5, seed=1).strikes, kept.strikes[:5])


@pytest.mark.parametrize("target", [(1.0, 0.2), (0.3, -0.4), (-0.5, 0.1), (3.0, 0.3)])
def test_the_nearest_in_closed_form(target):
    kept = library(1200)
    direction = np.stack([np.cos(kept.strikes[:, 0]), np.sin(kept.strikes[:, 0])], axis=1)
    ends = SPEED * np.floor((kept.strikes[:, -1] + 0.3) * RATE) / RATE
    along = np.clip(direction @ target, 0, ends)
    distance = np.linalg.norm(along[:, None] * direction - target, axis=1)
    strikes, found = kept.nearest(target, 7)
    np.testing.assert_allclose(found, np.sort(distance)[:7], atol=2e-6)
    nearest = np.linalg.norm(strikes[:, None] - kept.strikes[None], axis=2).argmin(axis=1)
    np.testing.assert_allclose(distance[nearest], found, atol=2e-6)
    assert len(kept.nearest(target)[0]) == 1


def test_the_nearest_in_space():
    box = StrikeBounds((-1.0, 0.0, -1.0, *(0.0,) * 5, 0.4), (1.0, 0.5, 1.0, *(0.1,) * 5, 1.0))
    kept = StrikeLibrary.random(StraightFlightInSpace(), box, 500, seed=3)
    target = np.array([0.5, 0.2, -0.3])
    along = np.clip(StraightFlightInSpace().directions(kept.strikes) @ target, 0, None)
    distance = np.linalg.norm(along[:, None] * StraightFlightInSpace().directions(kept.strikes) - target, axis=1)
    strikes, found = kept.nearest(target, 3)
    np.testing.assert_allclose(found, np.sort(distance)[:3], atol=2e-6)
    np.testing.assert_array_equal(strikes, kept.strikes[np.argsort(distance)[:3]])


def test_paths_that_stand_still_or_are_no_paths():
    paths = np.array([[[1.0, 1.0]] * 3, [[np.nan] * 2] * 3, [[0.0, 0.0], [2.0, 0.0], [np.nan, np.nan]]], np.float32)
    kept = StrikeLibrary(np.arange(15.0).reshape(3, 5), paths)
    strikes, distance = kept.nearest((1.0, 0.5), 3)
    np.testing.assert_allclose(distance, [0.5, 0.5, np.inf])
    np.testing.assert_array_equal(strikes, kept.strikes[[0, 2, 1]])


def test_a_library_comes_back_from_a_file(tmp_path):
    kept = library(9)
    kept.save(tmp_path / "library.npz")
    back = StrikeLibrary.load(tmp_path / "library.npz")
    np.testing.assert_array_equal(back.strikes, kept.strikes)
    np.testing.assert_array_equal(back.paths, kept.paths)


def objective(angle: float, **options) -> Objective:
    target = Target((1.2 * math.cos(angle), 1.2 * math.sin(angle)), options.pop("radius", 1e-9))
    return Objective(StraightFlight(), target, bounds=BOUNDS, **options)


@pytest.mark.parametrize("angle", [0.3, 0.999])
def test_a_warm_search_stays_near_the_librarys_strike(angle):
    kept, o = library(50), objective(angle, max_trials=40)
    first = kept.nearest(o.target.position)[0][0]
    result = warm_search(o, "random", kept, seed=1, width=0.2)
    assert result.trace[0].strike == pytest.approx(tuple(first))
    lower, upper = o.bounds.box
    whole_lower, whole_upper = BOUNDS.box
    np.testing.assert_allclose(upper - lower, 0.2 * (whole_upper - whole_lower))
    assert (lower >= whole_lower - 1e-12).all()
    assert (upper <= whole_upper + 1e-12).all()
    inside = (first - whole_lower > 0.1 * (whole_upper - whole_lower)) & (
        whole_upper - first > 0.1 * (whole_upper - whole_lower)
    )
    np.testing.assert_allclose(((lower + upper) / 2)[inside], first[inside])


def test_the_library_is_struck_in_order():
    kept, o = library(30), objective(0.2)
    result = library_search(o, kept)
    misses = [trial.outcome.miss_distance for trial in result.trace]
    assert len(misses) == 30
    assert misses == sorted(misses)
    assert result.method == "library"
