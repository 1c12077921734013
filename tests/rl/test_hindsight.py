"""Relabelled targets: where a path passes them, and where new ones are drawn."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from whiptool.goals.arrival_rule import ArrivalRule
from whiptool.goals.goals import arrival_angles
from whiptool.goals.zone import Disc
from whiptool.rl import hindsight


def test_the_nearest_point_of_a_path():
    rng = np.random.default_rng(0)
    paths, targets = np.cumsum(rng.normal(0, 0.1, (20, 15, 2)), axis=1), rng.normal(0, 0.3, (20, 2))
    paths[3, 8:], paths[4, 1:], paths[5, 6] = np.nan, np.nan, paths[5, 5]  # ended early, at once; stood still
    distance, point, i = hindsight.nearest(paths, targets)
    along = np.linspace(0, 1, 2001)[:, None]
    for lane, path in enumerate(paths):
        dense = np.concatenate([a + along * (b - a) for a, b in itertools.pairwise(path)])
        miss = np.hypot(*(dense - targets[lane]).T)
        if lane == 4:
            assert distance[lane] == np.inf
            continue
        assert distance[lane] == pytest.approx(np.nanmin(miss), abs=1e-4)
        assert distance[lane] == pytest.approx(math.dist(point[lane], targets[lane]))
        assert i[lane] == np.nanargmin(miss) // 2001 or np.isclose(miss[2001 * i[lane] :][:2001].min(), np.nanmin(miss))


def test_new_targets_lie_in_the_zone_and_near_the_path():
    zone, rng = Disc((0.0, 0.0), 0.5), np.random.default_rng(0)
    paths = np.cumsum(rng.normal(0, 0.05, (300, 40, 2)), axis=1)
    paths[:50] += 3  # never in the zone
    targets = hindsight.new_targets(paths, zone, 0.06, rng.random((300, 6)))
    assert zone.contains(targets).all()
    distance = hindsight.nearest(paths, targets)[0]
    assert (distance[:50] > 1).all()
    assert (distance[50:] <= 0.12 + 1e-9).mean() > 0.8
    assert (distance[50:] <= 0.06).any()


def test_new_targets_by_their_numbers():
    """A path of nine points, five of them inside: the number says which, the next ones offset and direction."""
    zone, radius = Disc((0.0, 0.0), 0.5), 0.1
    x = np.linspace(-0.8, 0.8, 9)
    path = np.stack([x, np.zeros(9)], axis=1)
    inside = x[np.abs(x) <= 0.5]
    assert len(inside) == 5
    for i, (offset, which) in itertools.product(range(5), ((0.0, 0.1), (0.5, 0.4), (2.0, 0.9))):
        for angle in (0.25, 0.6):
            uniform = np.array([[0.3, 0.2, 0.1, (i + 0.5) / 5, which, angle]])
            shift = offset * radius * np.array([math.cos(2 * math.pi * angle), math.sin(2 * math.pi * angle)])
            near = np.array([inside[i], 0.0]) + shift
            expected = near if np.hypot(*near) <= 0.5 else zone.place(uniform[:, :3])[0]
            np.testing.assert_allclose(hindsight.new_targets(path[None], zone, radius, uniform)[0], expected)
    away = hindsight.new_targets(path[None] + 5, zone, radius, uniform)
    np.testing.assert_allclose(away, zone.place(uniform[:, :3]))


def test_new_targets_in_space_lie_around_the_path():
    """Two hit radii from it where they are not anywhere in the ball, to all sides alike."""
    zone, rng = Disc((0.0, 0.0, 0.0), 0.5), np.random.default_rng(0)
    path = np.zeros((2000, 3, 3))  # stays in the middle
    uniform = rng.random((2000, 8))
    targets = hindsight.new_targets(path, zone, 0.1, uniform)
    distance = np.linalg.norm(targets, axis=1)
    shares = [np.mean(np.isclose(distance, 0.1 * offset)) for offset in hindsight.NEAR]
    assert shares == pytest.approx([1 / 3] * 3, abs=0.04)
    outer = targets[np.isclose(distance, 0.2)] / 0.2
    assert np.abs(outer.mean(axis=0)).max() < 0.08
    np.testing.assert_allclose((outer**2).mean(axis=0), 1 / 3, atol=0.04)
    away = hindsight.new_targets(path + 5, zone, 0.1, uniform)
    np.testing.assert_array_equal(away, zone.place(uniform[:, :4]))
    missed, point, i = hindsight.nearest(np.array([[[0.0, 0, 1], [0, 2, 1], [3, 2, 1]]]), np.array([[1.0, 1.5, 0]]))
    assert (missed[0], point[0].tolist(), i[0]) == (pytest.approx(math.sqrt(1.25)), [1.0, 2.0, 1.0], 1)


def test_a_path_passes_between_its_samples():
    """A right angle: feet within each stretch, the corner, both ends; a path of a single point is none."""
    path = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 1.0]])
    for target, foot, i in (
        ((0.5, 0.3), (0.5, 0.0), 0),
        ((2.4, 0.75), (2.0, 0.75), 1),
        ((3.0, -1.0), (2.0, 0.0), 0),
        ((-1.0, 1.0), (0.0, 0.0), 0),
        ((2.5, 4.0), (2.0, 1.0), 1),
    ):
        distance, point, found = hindsight.nearest(path[None], np.array([target]))
        assert distance[0] == pytest.approx(math.dist(target, foot))
        assert (tuple(point[0]), found[0]) == (pytest.approx(foot), i)
    alone = np.array([[[0.0, 0.0], [np.nan, np.nan]]])
    assert hindsight.nearest(alone, np.zeros((1, 2)))[0] == np.inf


def turn(radius: float = 0.3) -> np.ndarray:
    """A path once around the origin in a second, anticlockwise, (1, 501, 2)."""
    t = np.linspace(0, 1, 501)
    angle = 2 * np.pi * t
    return radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)[None]


def test_new_directions_are_those_of_the_tip_or_off_by_half_a_cone_or_two():
    rule, zone = ArrivalRule(angle=(-math.pi, math.pi), cone=0.1), Disc((0.0, 0.0), 0.5)
    uniform = np.random.default_rng(0).random((600, hindsight.uniforms(zone, rule)))
    paths = np.tile(turn(), (600, 1, 1))
    goals = hindsight.new_goals(paths, zone, rule, 0.02, uniform)
    np.testing.assert_array_equal(goals.positions, hindsight.new_targets(paths[:, :-1], zone, 0.02, uniform[:, :6]))
    across = np.arctan2(goals.positions[:, 1], goals.positions[:, 0]) + np.pi / 2  # how the tip passes there
    off = np.remainder(arrival_angles(goals.positions, goals.directions) - across + np.pi, 2 * np.pi) - np.pi
    on_path = np.abs(np.linalg.norm(goals.positions, axis=1) - 0.3) < 1e-4
    half_a_sample = np.pi / 500
    shares = [np.mean(np.abs(off[on_path] - x - half_a_sample) < 1e-4) for x in (0.0, 0.05, -0.05, 0.2, -0.2)]
    assert shares == pytest.approx([1 / 3, *[1 / 6] * 4], abs=0.1)
    assert sum(shares) > 0.98  # a few lie on the path though they are off by half a hit radius, along it
    away = hindsight.new_goals(paths + 5, zone, rule, 0.02, uniform)
    expected = rule.goals(zone.place(uniform[:, :3]), 0.02, uniform[:, 6:7])
    np.testing.assert_array_equal(away.positions, expected.positions)
    np.testing.assert_array_equal(away.directions, expected.directions)


@pytest.mark.parametrize("rule", [ArrivalRule(direction=(0.0, 1.0), cone=0.3), ArrivalRule(angle=(1.4, 1.8), cone=0.1)])
def test_new_targets_lie_where_the_tip_moves_as_is_asked(rule):
    """Upward: the turn does so on its right side alone; where it never does, anywhere on it."""
    zone = Disc((0.0, 0.0), 0.5)
    uniform = np.random.default_rng(1).random((300, hindsight.uniforms(zone, rule)))
    goals = hindsight.new_goals(np.tile(turn(), (300, 1, 1)), zone, rule, 0.01, uniform)
    assert (np.abs(np.arctan2(goals.positions[:, 1], goals.positions[:, 0])) < 0.4).all()
    across = np.arctan2(goals.directions[:, 1], goals.directions[:, 0])
    assert ((across >= 1.4 - 1e-9) & (across <= 1.8 + 1e-9)).all()
    down = np.stack([np.zeros(100), np.linspace(0.4, -0.4, 100)], axis=1)
    goals = hindsight.new_goals(np.tile(down, (300, 1, 1)), zone, rule, 0.01, uniform)
    assert np.ptp(goals.positions[:, 1]) > 0.6


def test_new_targets_lie_where_the_tip_is_fast_enough():
    """Twice around, slowly and then quickly, on two radii: only the quick one is as asked."""
    rule, zone = ArrivalRule(speed=3.0), Disc((0.0, 0.0), 0.5)
    slow, fast = turn(0.2)[0], turn(0.4)[0][::4]  # at 500 samples a second 1.3 and 10 m/s
    path = np.vstack([slow, np.full((1, 2), np.nan), fast])
    uniform = np.random.default_rng(2).random((200, hindsight.uniforms(zone, rule)))
    goals = hindsight.new_goals(np.tile(path, (200, 1, 1)), zone, rule, 0.01, uniform)
    assert goals.directions is None
    assert (np.linalg.norm(goals.positions, axis=1) > 0.35).all()
