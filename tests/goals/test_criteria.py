"""Criteria on lemon2024 against differences, draws, and closed forms."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from linear_rollout import BOUNDS, LinearRollout
from rich_model import everything
from slopes import compare

from whiptool.errors import InputError
from whiptool.goals.criteria import (
    CRITERIA,
    Effort,
    Robustness,
    StrikesAtGoal,
    find_criterion,
    hit_excess,
    hit_excess_slopes,
)
from whiptool.goals.target import Target
from whiptool.impedance import ConstantImpedance, Controller
from whiptool.models import preset
from whiptool.models.strike import default_bounds
from whiptool.rollout import CompiledRollout

LEMON = preset("lemon2024")
LEMON_BOUNDS = default_bounds(LEMON.arm)
GOALS = Target((1.3, 0.0), 0.06, direction=(0.3, 1.0), cone=0.4, speed=9.0).goals
STRIKES = LEMON_BOUNDS.sample(np.random.default_rng(21), 24)
NOISE = (0.01, 0.02, 0.03, 0.01, 0.005)


@pytest.fixture(scope="module")
def rollout() -> CompiledRollout:
    return CompiledRollout(everything(), Controller(ConstantImpedance()), timestep=1e-3)


def agree(found: np.ndarray, seen, numbers: int) -> None:
    """Slopes (B, k, m) against differences of `seen`, (B, k), by so many numbers of a strike."""
    compared = 0
    for j in range(numbers):
        for part in range(found.shape[1]):

            def at(by: float, j: int = j, part: int = part) -> np.ndarray:
                shifted = STRIKES.copy()
                shifted[:, j] += by
                return seen(shifted)[:, part]

            wrong, still = compare(found[:, part, j], at, 3e-6)
            assert not wrong.any(), (j, part)
            compared += int(still.sum())
    assert compared > 0.7 * numbers * found.shape[1] * len(STRIKES)


@pytest.mark.parametrize("name", CRITERIA)
def test_derivatives_of_measures_against_differences(name, rollout):
    criterion = find_criterion(name, LEMON_BOUNDS, noise=NOISE if name == "robustness" else (0.01,))
    found = criterion.measure_slopes(StrikesAtGoal(rollout, STRIKES, GOALS, 0.3))
    numbers = 4 if name == "speed" else 5  # the step that holds the closest approach moves with D
    agree(found, lambda strikes: criterion.measures(StrikesAtGoal(rollout, strikes, GOALS, 0.3)), numbers)


def test_derivatives_of_what_is_missing_of_a_hit_against_differences(rollout):
    found = hit_excess_slopes(StrikesAtGoal(rollout, STRIKES, GOALS, 0.3))
    assert found.shape == (24, 3, 5)
    agree(found, lambda strikes: hit_excess(StrikesAtGoal(rollout, strikes, GOALS, 0.3)), 4)


def test_nothing_is_missing_of_hits_alone():
    """Strikes around a target: hits are those that a goal calls so, each part of it for itself."""
    strikes = BOUNDS.sample(np.random.default_rng(2), 4000)
    for target in (
        Target((0.3, 0.1), 0.9),
        Target((0.3, 0.1), 0.9, direction=(1.0, 0.4), cone=0.5),
        Target((0.3, 0.1), 0.9, direction=(1.0, 0.4), cone=0.5, speed=3.5),
        Target((0.3, 0.1), 0.9, speed=3.5),
    ):
        struck = StrikesAtGoal(LinearRollout(), strikes, target.goals, 0.3)
        near = struck.near
        hits = (near.distance <= 0.9) & target.goals.arrives(near.velocity)
        assert 50 < hits.sum() < 2000
        np.testing.assert_array_equal((hit_excess(struck) <= 0).all(axis=1), hits)


def test_noise_of_a_linear_tip_has_a_closed_form():
    """E |miss|^2 = |miss|^2 + the variances of the two numbers that move the tip; what has no noise takes no strike."""
    strikes, target = BOUNDS.sample(np.random.default_rng(3), 50), Target((0.3, 0.1))
    for noise in (NOISE, (0.0, 0.2, 0.0, 0.1, 0.0)):
        rollout = LinearRollout()
        struck = StrikesAtGoal(rollout, strikes, target.goals, 0.3)
        expected = struck.near.distance**2 + noise[0] ** 2 + noise[1] ** 2
        criterion, before = Robustness(noise), rollout.rolled
        np.testing.assert_allclose(criterion.values(struck) ** 2, expected, rtol=1e-12)
        criterion.measures(struck)
        assert rollout.rolled - before == 2 * np.count_nonzero(noise) * len(strikes)


@pytest.mark.parametrize("i", [0, 1])
def test_robustness_is_the_root_mean_square_of_draws_and_nearly_that_of_the_first_order(i, rollout):
    """1024 draws beside a strike through its target; |miss|^2 + trace(J S J^T) is its limit for little noise."""
    strike, sigma = STRIKES[i : i + 1], 0.003
    goals = Target(tuple(rollout.approach(strike, (1.3, 0.0)).tip[0] + [0.001, 0.0])).goals
    near, J, _ = rollout.arrival_gradient(strike, goals.positions[0])
    found = Robustness((sigma,) * 5).values(StrikesAtGoal(rollout, strike, goals, 0.3))[0]
    first_order = np.sqrt(near.distance[0] ** 2 + sigma**2 * (J**2).sum())
    assert found == pytest.approx(first_order, rel=0.05)
    assert near.distance[0] < 0.8 * found
    draws = strike + sigma * np.random.default_rng(4).normal(size=(1024, 5))
    squares = rollout.approach(draws, goals.positions[0]).distance ** 2
    assert found**2 == pytest.approx(squares.mean(), abs=4 * squares.std() / 32)


def test_costs_are_negative_and_in_order():
    for name in CRITERIA:
        criterion = find_criterion(name, BOUNDS)
        costs = [criterion.cost(value, 0.06) for value in (0.0, 1e-6, 1e-2, 1.0, 30.0, 1e5, np.inf)]
        assert all(cost <= 0 for cost in costs)
        assert sorted(set(costs), reverse=criterion.largest) == costs
        assert criterion.largest == (name == "speed")


def test_speed_counts_along_the_direction_where_there_is_one():
    strikes = BOUNDS.sample(np.random.default_rng(3), 5)
    speed = find_criterion("speed", BOUNDS)
    velocity = strikes[:, 2:4] + [3.0, 0.0]
    any_way = StrikesAtGoal(LinearRollout(), strikes, Target((0.3, 0.1)).goals, 0.3)
    np.testing.assert_allclose(speed.values(any_way), np.linalg.norm(velocity, axis=1))
    upward = StrikesAtGoal(LinearRollout(), strikes, Target((0.3, 0.1), direction=(0, 2)).goals, 0.3)
    np.testing.assert_allclose(speed.values(upward), velocity[:, 1])
    np.testing.assert_allclose(speed.measures(upward)[:, 0], -velocity[:, 1])


@pytest.mark.parametrize(
    ("noise", "allowed"),
    [((0.0,), "not all 0"), ((-0.1,), "0 or more"), ((0.1, 0.1), "5"), ((np.nan,), "finite"), ((0.3,), "for D")],
)
def test_noise_that_says_nothing_is_refused(noise, allowed):
    with pytest.raises(InputError, match=allowed):
        find_criterion("robustness", BOUNDS, noise=noise)


def test_what_is_not_known_is_refused():
    with pytest.raises(InputError, match="effort, peak-torque"):
        find_criterion("beauty", BOUNDS)

    class Blind(LinearRollout):
        def approach(self, strikes, target, *, t_stay=0.3):
            return dataclasses.replace(super().approach(strikes, target, t_stay=t_stay), effort=None)

    with pytest.raises(InputError, match="torques"):
        Effort().values(StrikesAtGoal(Blind(), STRIKES, GOALS, 0.3))
