"""Goals with a direction and a speed: angles, frames, hits, costs and their derivatives."""

from __future__ import annotations

import math

import numpy as np
import pytest

from whiptool.errors import InputError
from whiptool.goals.goals import (
    PACE,
    Goals,
    angle_probability,
    arrival_angles,
    arrival_directions,
    direction_error,
    probability_within,
)
from whiptool.models.trajectory import Approach

RADIUS, CONE, SPEED = 0.05, math.radians(10), 6.0


def random_goals(d: int, count: int = 200, *, seed: int = 0, sight: bool = False, speed: float | None = SPEED) -> Goals:
    rng = np.random.default_rng(seed)
    positions = rng.normal(size=(count, d))
    if sight:
        directions, sights = arrival_directions(positions, rng.uniform(-math.pi, math.pi, count))
    else:
        directions, sights = rng.normal(size=(count, d)), None
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return Goals(positions, RADIUS, directions, CONE, speed, sights)


def test_the_arrival_angle_is_that_of_the_published_frame():
    """z' from target to base, x' up, y' = z' x x', angle = atan2(v y', v x'), written out for each target."""
    rng = np.random.default_rng(1)
    positions, angles = rng.normal(size=(50, 3)), rng.uniform(-math.pi, math.pi, 50)
    directions, sights = arrival_directions(positions, angles)
    assert sights is not None
    for position, angle, direction, sight in zip(positions, angles, directions, sights, strict=True):
        z = -position / math.hypot(*position)
        x = np.array([0, 0, 1.0]) - z[2] * z
        x /= math.hypot(*x)
        y = np.cross(z, x)
        assert math.atan2(direction @ y, direction @ x) == pytest.approx(angle)
        assert direction @ direction == pytest.approx(1)
        np.testing.assert_allclose(sight, z)
        assert abs(direction @ sight) < 1e-12


def test_upward_and_leftward_at_a_target_straight_ahead():
    ahead = np.tile([1.5, 0.0, 0.0], (3, 1))
    directions, _ = arrival_directions(ahead, np.radians([0, 90, 180]))
    np.testing.assert_allclose(directions, [[0, 0, 1], [0, 1, 0], [0, 0, -1]], atol=1e-15)
    directions, sights = arrival_directions(np.ones((2, 2)), np.radians([0, 90]))
    np.testing.assert_allclose(directions, [[1, 0], [0, 1]], atol=1e-15)
    assert sights is None


def test_a_target_above_the_base_has_no_arrival_angle():
    for place in ([0.0, 0.0, 1.3], [0.0, 0.0, -1.3], [1e-7, 0.0, 1.3]):
        with pytest.raises(InputError, match=r"^target of an arrival angle: got .*not straight above or below"):
            arrival_directions(np.array([[1.0, 0.0, 0.0], place]), np.zeros(2))
    directions, _ = arrival_directions(np.array([[0.0, 1.3, 0.0], [1e-3, 0.0, 1.3]]), np.zeros(2))
    np.testing.assert_allclose(directions, [[0, 0, 1], [-1, 0, 0]], atol=1e-3)


@pytest.mark.parametrize("d", [2, 3])
def test_angle_and_speed_are_those_of_the_velocity(d: int):
    goals, rng = random_goals(d), np.random.default_rng(2)
    assert goals.directions is not None
    v = 5 * rng.normal(size=(200, d))
    along = (v * goals.directions).sum(axis=1)
    np.testing.assert_allclose(np.cos(goals.angle(v)), along / np.linalg.norm(v, axis=1), atol=1e-12)
    np.testing.assert_allclose(goals.arrival_speed(v), along)
    fast = Goals(goals.positions, RADIUS, speed=SPEED)
    np.testing.assert_allclose(fast.arrival_speed(v), np.linalg.norm(v, axis=1))
    assert np.isnan(fast.angle(v)).all()


def test_motion_along_the_line_of_sight_does_not_count_for_the_angle():
    goals, rng = random_goals(3, sight=True), np.random.default_rng(3)
    assert goals.sights is not None
    v = rng.normal(size=(200, 3))
    moved = v + rng.normal(size=(200, 1)) * goals.sights
    np.testing.assert_allclose(goals.angle(moved), goals.angle(v), atol=1e-9)
    np.testing.assert_allclose(goals.arrival_speed(moved), goals.arrival_speed(v), atol=1e-12)


def test_a_tip_arrives_as_asked_within_the_cone_and_fast_enough():
    goals = Goals(np.zeros((1, 2)), RADIUS, np.array([[1.0, 0.0]]), CONE, SPEED)
    inside, outside = math.radians(9.9), math.radians(10.1)

    def arrives(angle: float, speed: float) -> bool:
        v = speed / abs(math.cos(angle)) * np.array([[math.cos(angle), math.sin(angle)]])
        return bool(goals.arrives(v)[0])

    assert arrives(inside, 6.01)
    assert arrives(-inside, 6.01)
    assert not arrives(outside, 6.01)
    assert not arrives(-outside, 6.01)
    assert not arrives(inside, 5.99)
    assert not arrives(inside + math.pi, 6.01)
    assert Goals(np.zeros((1, 2)), RADIUS).arrives(np.zeros((1, 2))).all()  # of a point, always


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("sight", [False, True])
def test_each_residual_is_the_hit_radius_where_a_hit_ends(d: int, sight: bool):
    """The direction's at an angle of one cone, the speed's at rest; beyond, costs grow up to the stated largest."""
    goals = random_goals(d, sight=sight and d == 3)
    assert goals.directions is not None
    rng = np.random.default_rng(4)
    across = rng.normal(size=goals.positions.shape)
    hidden = [goals.directions] if goals.sights is None else [goals.directions, goals.sights]
    for unit in hidden:
        across -= (across * unit).sum(axis=1, keepdims=True) * unit
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    v = 9 * (math.cos(CONE) * goals.directions + math.sin(CONE) * across)
    left = goals.residuals(goals.positions, v)
    np.testing.assert_allclose(np.linalg.norm(left[:, d : 2 * d], axis=1), RADIUS)
    np.testing.assert_allclose(left[:, -1], 0)  # 8.9 m/s are enough
    half = goals.residuals(goals.positions, SPEED / 2 * goals.directions)
    np.testing.assert_allclose(half[:, -1], RADIUS / 2)
    np.testing.assert_allclose(half[:, : 2 * d], 0, atol=1e-15)
    worst = goals.cost(np.zeros(200), -goals.directions)
    np.testing.assert_allclose(worst, goals.largest_cost)
    anything = goals.cost(np.zeros(200), rng.normal(size=(200, d)))
    assert (anything <= goals.largest_cost + 1e-12).all()
    assert goals.cost(np.zeros(200), np.zeros((200, d))) == pytest.approx(goals.largest_cost)  # at rest


def test_the_cost_is_the_residuals_norm_and_of_points_the_distance():
    goals, rng = random_goals(3), np.random.default_rng(5)
    tip, v = goals.positions + 0.1 * rng.normal(size=(200, 3)), rng.normal(size=(200, 3))
    distance = np.linalg.norm(tip - goals.positions, axis=1)
    np.testing.assert_allclose(goals.cost(distance, v), np.linalg.norm(goals.residuals(tip, v), axis=1))
    points = Goals(goals.positions, RADIUS)
    assert points.cost(distance, v) is distance
    assert points.only_points
    assert points.largest_cost == 0


@pytest.mark.parametrize("sight", [False, True])
@pytest.mark.parametrize("asked", ["both", "direction", "speed"])
def test_derivatives_of_residuals_against_differences(asked: str, sight: bool):
    """Of tips and velocities that move along random curves; clipped speeds have none."""
    d, m, rng = 3, 4, np.random.default_rng(6)
    goals = random_goals(d, sight=sight, speed=None if asked == "direction" else SPEED)
    if asked == "speed":
        goals = Goals(goals.positions, RADIUS, speed=SPEED)
    tip, v = rng.normal(size=(200, d)), 3 * rng.normal(size=(200, d))
    dtip, dv = rng.normal(size=(2, 200, d, m))
    slopes, h = goals.residual_slopes(v, dtip, dv), 1e-6
    for j in range(m):
        ahead = goals.residuals(tip + h * dtip[..., j], v + h * dv[..., j])
        behind = goals.residuals(tip - h * dtip[..., j], v - h * dv[..., j])
        np.testing.assert_allclose(slopes[..., j], (ahead - behind) / (2 * h), atol=2e-7, rtol=1e-6)
    if asked != "direction":
        speed = goals.arrival_speed(v)
        short = (speed > 0) & (speed < SPEED)
        assert 0.2 < short.mean() < 1  # some of each
        assert not slopes[~short, -1].any()


@pytest.mark.parametrize(("d", "sight"), [(2, False), (3, True)])
def test_arrival_angles_are_those_of_the_directions(d, sight):
    rng = np.random.default_rng(3)
    positions, angles = rng.normal(size=(40, d)), rng.uniform(-math.pi, math.pi, 40)
    directions, sights = arrival_directions(positions, angles)
    along = 0.0 if sights is None else rng.normal(size=(40, 1)) * sights  # what moves along the line of sight
    np.testing.assert_allclose(arrival_angles(positions, 7.0 * directions + along), angles, atol=1e-9)
    assert (sights is not None) == sight


def test_a_tip_at_rest_arrives_along_no_direction():
    goals = random_goals(2, 3, speed=None)
    still = np.zeros((3, 2))
    np.testing.assert_allclose(goals.angle(still), math.pi)
    assert not goals.arrives(still).any()
    seen = random_goals(3, 3, sight=True, speed=None)
    assert seen.sights is not None
    assert not seen.arrives(2.0 * seen.sights).any()  # moves along the line of sight alone


@pytest.mark.parametrize(("d", "sight"), [(2, False), (3, True)])
def test_goals_of_some_strikes(d, sight):
    first, second = (random_goals(d, 6, seed=seed, sight=sight) for seed in (1, 2))
    mask = np.array([True, False, False, True, True, False])
    some, mixed = first.rows(mask), first.with_rows(mask, second.rows(mask))
    for name in ("positions", "directions", "sights"):
        one, other, chosen, both = (getattr(x, name) for x in (first, second, some, mixed))
        if one is None:
            assert chosen is both is None
            continue
        np.testing.assert_array_equal(chosen, one[[0, 3, 4]])
        np.testing.assert_array_equal(both, np.where(mask[:, None], other, one))
    assert (some.hit_radius, some.cone, some.speed) == (first.hit_radius, first.cone, first.speed)
    assert not np.array_equal(mixed.positions, first.positions)  # the first stay as they are


def test_a_hit_is_near_and_as_asked_and_did_not_diverge():
    """Counted by hand: (0.03, 0.04) m away is 0.05 m; the cone is 10 degrees, the least speed along it 6 m/s."""
    goals = Goals(np.zeros((1, 2)), RADIUS, np.array([[1.0, 0.0]]), CONE, SPEED)
    turned = np.deg2rad([9.9, 10.1, 0, 0, 0])
    speeds = np.array([6.2, 6.2, 5.9, 6.1, 6.1])
    velocity = speeds[:, None] * np.stack([np.cos(turned), np.sin(turned)], axis=1)
    distance = np.array([0.05, 0.01, 0.01, 0.0501, np.nan])
    assert goals.hit(distance, velocity).tolist() == [True, False, False, False, False]
    point = Goals(np.zeros((1, 2)), RADIUS)
    assert point.hit(distance, velocity).tolist() == [True, True, True, False, False]
    # Measured at 0.01 m: P(-0.05 < x < 0.05) = Phi(1) - Phi(-1.5) = 0.77 with an error of 0.04 m, 0.98 with 0.02 m
    assert point.hit(np.array([0.01, 0.01]), velocity[:2], np.array([0.04, 0.02])).tolist() == [False, True]
    nothing = np.zeros((1, 2))
    for diverged in (False, True):
        near = Approach(distance[:1], *np.zeros((1, 1)), velocity[:1], *[nothing] * 3, np.array([diverged]))
        assert bool(goals.hit_by(near)[0]) == (not diverged)


def test_a_hit_is_what_exceeds_no_part_of_its_goal():
    """The parts beyond a goal, by their definitions, and nothing else decide."""
    goals, rng = random_goals(3, sight=True), np.random.default_rng(3)
    directions, sights = goals.directions, goals.sights
    assert directions is not None
    assert sights is not None
    velocity = 8.0 * directions + 2.0 * rng.normal(size=(200, 3)) + 3.0 * sights
    distance = rng.uniform(0, 2 * RADIUS, 200)
    seen = velocity - (velocity * sights).sum(axis=1, keepdims=True) * sights
    along = (velocity * directions).sum(axis=1)
    angle = np.arccos(np.clip(along / np.linalg.norm(seen, axis=1), -1, 1))
    excess = goals.excess(distance, velocity)
    expected = {"point": distance - RADIUS, "direction": angle - CONE, "speed": SPEED - along}
    for name, by in expected.items():
        np.testing.assert_allclose(excess.pop(name), by, atol=1e-7)
    assert not excess
    hit = np.logical_and.reduce([by <= 0 for by in expected.values()])
    assert 20 < hit.sum() < 150
    np.testing.assert_array_equal(goals.hit(distance, velocity), hit)
    assert list(Goals(np.zeros((1, 2)), RADIUS).excess(distance, velocity)) == ["point"]


def test_of_an_unknown_velocity_only_points_are_hit():
    near, point = np.array([[0.01, 0.06]]), Goals(np.zeros((1, 2)), RADIUS)
    for goal, hit in ((point, True), (Goals(np.zeros((1, 2)), RADIUS, speed=1.0), False)):
        assert goal.hit(near).tolist() == [[hit, False]]
        assert goal.hit(near, None, np.array([1e-3, 1e-3])).tolist() == [[hit, False]]
        assert goal.hit_probability(near, None, 1e-3)[0].tolist() == pytest.approx([1.0 if hit else 0.5, 0.0])


def test_the_probability_of_a_hit_is_that_of_its_parts():
    """By the point, the direction, which errs as the place does over what the tip moves on, and the speed."""
    goal = Goals(np.zeros((1, 2)), RADIUS, np.array([[1.0, 0.0]]), CONE, SPEED)
    angle, speed = np.deg2rad([[0, 8], [8, 0]]), np.array([[6.5, 7.0], [8.0, 5.9]])
    velocity = speed[..., None] * np.stack([np.cos(angle), np.sin(angle)], axis=2)
    distance, error = np.array([[0.0, 0.03], [0.045, 0.0]]), np.array([[0.01, 0.02], [0.01, 0.01]])
    turned = np.arctan(error / (PACE * speed))
    parts = probability_within(RADIUS, distance, error) * angle_probability(angle, CONE, turned)
    parts[1, 1] = 0.0  # too slow
    np.testing.assert_allclose(goal.hit_probability(distance, velocity, error), parts, atol=1e-12)
    claimed = goal.hit(distance[0], velocity[0], error[0])
    np.testing.assert_array_equal(claimed, parts[0] >= 0.9)


@pytest.mark.parametrize(("angle", "cone", "error"), [(0.0, 0.17, 0.1), (0.15, 0.17, 0.05), (0.4, 0.17, 0.2)])
def test_the_probability_of_a_cone_is_that_of_draws(angle, cone, error):
    draws = angle + error * np.random.default_rng(0).standard_normal(1_000_000)
    found = angle_probability(np.array([angle]), cone, np.array([error]))[0]
    assert found == pytest.approx((np.abs(draws) <= cone).mean(), abs=2e-3)


def test_a_direction_errs_by_what_the_path_is_off_over_what_the_tip_moves_on():
    """A path that is off by a sine of the pace's size turns the velocity by about as much; a fast tip by less."""
    speed, off = 5.0, 0.004
    t = np.linspace(0, PACE, 2001)
    across = off * np.sin(t / PACE)  # its slope at first is off / PACE
    turned = np.arctan2(np.gradient(across, t), speed)[0]
    assert direction_error(off, np.array([speed]))[0] == pytest.approx(turned, rel=1e-3)
    assert direction_error(off, np.array([10 * speed]))[0] == pytest.approx(turned / 10, rel=1e-3)
    assert direction_error(off, np.array([0.0]))[0] < np.pi / 2
