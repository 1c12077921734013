"""Target zones of comparisons: their names and words."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from lemon_scene import scene

from whiptool.comparison.series import difficulty_sentence
from whiptool.comparison.target_scene import (
    WIDTHS,
    DifficultyUnit,
    check_zone,
    scene_seed,
    targets_hit,
    varied,
    words,
    zone_named,
)
from whiptool.errors import InputError
from whiptool.goals.arrival_rule import ArrivalRule, GoalRegion
from whiptool.goals.zone import Disc, ReachableDisc, Region
from whiptool.models import preset
from whiptool.models.strike import StrikeBounds, default_bounds
from whiptool.rl.task import StrikeTask


def test_zones_have_names_and_words():
    reach = preset("lemon2024").reach
    assert zone_named("0.2", scene(0.1), None) == Disc((1.3, 0.0), 0.2)
    wide = zone_named("0.3", scene(0.1), None)
    assert wide == ReachableDisc(Disc((1.3, 0.0), 0.3), reach)
    assert zone_named("0.2", replace(scene(0.1), zone=wide), None) == Disc((1.3, 0.0), 0.2)
    assert words(wide) == f"what is within reach ({reach:.3f} m) of a disc of radius 0.3 m around (1.3, 0) m"
    assert words(Disc((1.3, 0.0), 0.3)) == "a disc of radius 0.3 m around (1.3, 0) m"
    assert words(Region(np.zeros((50, 2)), 0.2)) == "wherever the tip can pass with 3 m/s, 2.00 m^2"
    assert difficulty_sentence({"one_strike_hits": 0.92, "random_strikes_hit": 0.086}) == (
        "One and the same strike hits 92.0 % of the targets; random strikes hit 8.6 %."
    )
    for bad in ("slow", "-1", "0", "nan"):
        with pytest.raises(InputError, match="zone"):
            check_zone(bad)


def test_hits_are_counted_as_the_rollout_counts_them():
    """100 strikes at 40 targets each: sampled paths miss no more than what passes within a millimetre of the edge."""
    where = scene(0.1)
    rollout, points = where.rollout(1), where.points()
    strikes = default_bounds(where.model.arm).sample(np.random.default_rng(0), 100)
    misses = rollout.approach(np.repeat(strikes, 40, axis=0), np.tile(points, (100, 1)), t_stay=0.3).distance
    misses = misses.reshape(100, 40)
    found = targets_hit(rollout, strikes, where)
    assert (found <= (misses <= 0.0601).sum(axis=1)).all()
    assert (found >= (misses <= 0.058).sum(axis=1)).all()
    assert found.max() > 10


def test_hits_along_directions_are_counted_as_the_rollout_counts_them():
    """As above, a target hit where the tip's velocity at the closest approach is within the cone, and fast.

    The velocity of the nearest sample differs a little from that at the closest approach.
    """
    rule = ArrivalRule(angle=(math.radians(60), math.radians(120)), cone=math.radians(25), speed=2.0)
    where = replace(scene(0.15), zone=Disc((1.0, 0.3), 0.15), arrival=rule)
    rollout, points = where.rollout(1), where.points()
    strikes = default_bounds(where.model.arm).sample(np.random.default_rng(0), 100)
    near = rollout.approach(np.repeat(strikes, 40, axis=0), np.tile(points, (100, 1)), t_stay=0.3)
    wanted = np.tile(where.goals().directions, (100, 1))
    turned = np.abs(np.angle((near.velocity @ [1, 1j]) / (wanted @ [1, 1j])))
    along = (near.velocity * wanted).sum(axis=1)

    hit = (near.distance <= 0.06) & (turned <= math.radians(25)) & (along >= 2.0)
    counted = hit.reshape(100, 40).sum(axis=1)
    task, goals = StrikeTask(rollout, GoalRegion(where.zone, rule)), where.goals().rows(np.tile(np.arange(40), 100))
    np.testing.assert_array_equal(task.judge(np.repeat(strikes, 40, axis=0), goals).hit, hit)
    found = targets_hit(rollout, strikes, where)
    assert counted.max() > 3
    assert np.abs(found - counted).max() <= 1  # a tip turns by degrees between two samples
    assert np.abs(found - counted).sum() < 0.05 * counted.sum()


@pytest.fixture(scope="module")
def found() -> dict[float, dict]:
    return {radius: DifficultyUnit(scene=scene(radius), strikes=1000).run(None, 1) for radius in (0.1, 0.3)}


def test_one_strike_does_for_the_papers_zone_and_not_for_a_wider_one(found):
    """It is played again by itself; no random strike of many hits more targets."""
    where = scene(0.1)
    rollout = where.rollout(1)
    strike = np.array(found[0.1]["one_strike"])
    again = rollout.approach(np.tile(strike, (40, 1)), where.points(), t_stay=0.3).distance <= 0.06
    assert found[0.1]["one_strike_hits"] == again.mean() >= 0.85
    others = default_bounds(where.model.arm).sample(np.random.default_rng(5), 1000)
    assert targets_hit(rollout, others, where).max() <= again.sum()
    assert found[0.3]["one_strike_hits"] < 0.6


def test_few_random_strikes_are_varied_too():
    """At least one of them, which then hits no fewer targets than itself: played again by hand."""
    where = scene(0.1)
    unit = DifficultyUnit(scene=where, strikes=20)
    drawn = default_bounds(where.model.arm).sample(np.random.default_rng(scene_seed(where)), 20)
    assert unit.run(None, 1)["one_strike_hits"] >= targets_hit(where.rollout(1), drawn, where).max() / 40 > 0


def test_random_strikes_hit_as_often_as_other_random_strikes(found):
    """Of another seed, every one at every target."""
    where = scene(0.1)
    strikes = default_bounds(where.model.arm).sample(np.random.default_rng(9), 1500)
    share = targets_hit(where.rollout(1), strikes, where).mean() / 40
    assert found[0.1]["random_strikes_hit"] == pytest.approx(share, abs=4 * np.sqrt(share / 1000))


def test_variations_spread_by_a_share_of_the_box_and_stay_in_it():
    """Sides of 1, 4 and 40 around centres that are not zero; a centre at the edge keeps its children inside."""
    bounds = StrikeBounds((1.0, -6.0, 5.0), (2.0, -2.0, 45.0))
    children = varied(np.tile([1.5, -4.0, 25.0], (400, 1)), 0.1, bounds, np.random.default_rng(0))
    assert children.shape == (10_000, 3)
    np.testing.assert_allclose(children.mean(axis=0), [1.5, -4.0, 25.0], atol=0.04 * 4)
    np.testing.assert_allclose(children.std(axis=0), [0.1, 0.4, 4.0], rtol=0.04)
    edge = varied(np.array([[1.0, -2.0, 25.0]]), 0.1, bounds, np.random.default_rng(0))
    lower, upper = bounds.box
    assert ((edge >= lower) & (edge <= upper)).all()
    assert (edge[:, 0] == 1.0).sum() > 3
    assert min(WIDTHS) > 0
    assert list(WIDTHS) == sorted(WIDTHS, reverse=True)  # ever less
