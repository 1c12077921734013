"""The best hit near a strike, where it has a closed form."""

from __future__ import annotations

import numpy as np
import pytest
from linear_rollout import BASE, BOUNDS, LEAST, LinearRollout

from whiptool.goals.criteria import Effort, Miss, PeakTorque, Robustness, Speed
from whiptool.goals.target import Target
from whiptool.objective import Objective, SearchStopped
from whiptool.optimizers import search
from whiptool.optimizers.constrained import STEPS, Cap, descend

START = np.array([-0.6, 0.7, 1.0, -1.0, 1.9])
PLACE = np.array([0.2, -0.1])
AWAY = np.linalg.norm(LEAST[:2] - PLACE)  # of the strike without effort from the target


def objective(criterion, target=None, rollout=None, **options) -> Objective:
    return Objective(
        rollout or LinearRollout(),
        target or Target(tuple(PLACE), 0.3),
        bounds=BOUNDS,
        criteria=[criterion],
        check_reach=False,
        **options,
    )


def best(found: Objective):
    assert found.best is not None
    assert found.best.outcome.hit
    return found.best


def test_least_effort_lies_where_the_circle_of_hits_is_nearest_to_it():
    found = objective(Effort())
    descend(found, START, Effort())
    expected = LEAST.copy()
    expected[:2] = PLACE + 0.3 * (LEAST[:2] - PLACE) / AWAY
    np.testing.assert_allclose(best(found).strike, expected, atol=2e-4)
    assert best(found).outcome.values[0] == pytest.approx((AWAY - 0.3) ** 2, rel=1e-4)
    assert len(found.trials) <= STEPS


def test_a_cap_is_kept_beside_the_hit():
    found = objective(Effort())
    descend(found, START, Effort(), [Cap(Miss(), 0.1)])
    kept = [trial.outcome for trial in found.trials if trial.outcome.miss_distance <= 0.1]
    assert min(outcome.values[0] for outcome in kept) == pytest.approx((AWAY - 0.1) ** 2, rel=1e-3)


def test_the_largest_of_several_torques_is_least_where_they_meet():
    found = objective(PeakTorque())
    descend(found, START, PeakTorque())
    assert best(found).outcome.values[0] == pytest.approx(BASE.mean(), abs=1e-6)
    assert best(found).strike[2] == pytest.approx((BASE[1] - BASE[0]) / 2, abs=1e-6)


def test_speed_grows_to_the_bounds_and_keeps_its_direction():
    found = objective(Speed())
    descend(found, START, Speed())
    assert best(found).outcome.values[0] == pytest.approx(np.hypot(5, 2), rel=1e-6)  # both components at a bound
    cone, along = 0.2, np.array([1.0, -0.2]) / np.hypot(1, 0.2)
    directed = objective(Speed(), Target(tuple(PLACE), 0.3, direction=tuple(along), cone=cone))
    descend(directed, START, Speed())
    velocity = np.array(best(directed).outcome.tip_velocity)
    grid = np.stack(np.meshgrid(np.linspace(1, 5, 801), np.linspace(-2, 2, 801)), axis=-1).reshape(-1, 2)
    within = grid @ along >= np.cos(cone) * np.linalg.norm(grid, axis=1)
    assert velocity @ along == pytest.approx((grid[within] @ along).max(), abs=5e-3)


def test_robust_strikes_of_a_linear_tip_hit_the_middle():
    found = objective(Robustness((0.1,) * 5))
    descend(found, START, Robustness((0.1,) * 5))
    np.testing.assert_allclose(best(found).strike[:2], PLACE, atol=1e-4)
    assert best(found).outcome.values[0] == pytest.approx(0.1 * np.sqrt(2), rel=1e-6)


def test_a_start_that_diverges_is_left_and_one_beside_it_turns_back():
    lost = objective(Effort(), rollout=LinearRollout(wild=-0.7))
    descend(lost, START, Effort())
    assert len(lost.trials) == 1
    walled = objective(Effort(), rollout=LinearRollout(wild=0.3))  # the best hit without a wall is beyond it
    descend(walled, np.array([0.0, 0.0, 1.0, -1.0, 1.9]), Effort())
    assert any(trial.outcome.diverged for trial in walled.trials)
    assert best(walled).strike[0] <= 0.3
    assert best(walled).outcome.values[0] < 0.7 * walled.trials[0].outcome.values[0]


@pytest.mark.parametrize("criterion", [Effort(), PeakTorque(), Speed()])
def test_the_gradient_search_finds_it_and_ends_by_its_budget(criterion):
    found = objective(criterion, max_trials=200)
    result = search(found, "gradient", seed=1)
    assert (result.status.value, result.n_trials) == ("max_trials", 200)
    expected = {"effort": (AWAY - 0.3) ** 2, "peak-torque": BASE.mean(), "speed": np.hypot(5, 2)}[criterion.name]
    assert best(found).outcome.values[0] == pytest.approx(expected, rel=1e-3)


def test_a_strike_is_rolled_out_once_beside_its_derivatives():
    rollout = LinearRollout()
    found = objective(Effort(), rollout=rollout)
    for strike in (START, START + 0.1):
        outcome, struck = found.struck(strike)
        assert struck.near.distance[0] == outcome.miss_distance
        assert Effort().measures(struck)[0] == np.log1p(outcome.values[0])
    assert rollout.rolled == len(found.trials) == 2


def test_the_budget_ends_a_descent():
    found = objective(Effort(), max_trials=4)
    with pytest.raises(SearchStopped, match="trials"):
        descend(found, START, Effort())
    assert len(found.trials) == 4


@pytest.mark.parametrize("method", ["cmaes", "ga", "random", "directl", "nlopt:GN_CRS2_LM"])
def test_every_search_prefers_hits_and_then_better_hits(method):
    found = objective(Effort(), max_trials=800)
    search(found, method, seed=1)
    hits = [trial.outcome.values[0] for trial in found.trials if trial.outcome.hit]
    assert best(found).outcome.values[0] == min(hits)
    assert min(hits) < (2.0 if method == "random" else 0.1) + (AWAY - 0.3) ** 2
