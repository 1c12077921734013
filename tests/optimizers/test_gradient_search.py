"""The gradient search on a bowl: which strikes are refined, by which slope, and when it ends."""

from __future__ import annotations

from importlib import import_module

import numpy as np
import pytest
import scipy.optimize
from linear_rollout import BASE, LEAST, LinearRollout
from linear_rollout import BOUNDS as LINEAR_BOUNDS
from toy_objectives import BOUNDS, MINIMUM, Bowl, Enough

from whiptool.goals.criteria import Effort, Miss, PeakTorque, Robustness, Speed
from whiptool.goals.target import Target
from whiptool.limits.clearance import Clearance
from whiptool.limits.limits import CommandLimits
from whiptool.models import JointLimits, preset
from whiptool.objective import Objective, SearchStopped
from whiptool.optimizers import search
from whiptool.optimizers.gradient_search import BATCH, COLLISIONS, REFINED, STEPS, Cap, descend, gradient_search, refine
from whiptool.rollout import CompiledRollout


def test_a_round_is_64_strikes_of_which_8_are_refined():
    assert (BATCH, REFINED, STEPS) == (64, 8, 60)


def test_one_refinement_finds_the_minimum():
    bowl = Bowl()
    start = np.array([0.9, -0.8, 5.5, 0.4, 0.5])
    assert refine(bowl, start)
    np.testing.assert_allclose(bowl.refined[0], start)
    assert bowl.miss(bowl.refined[-1]) <= 1e-6
    assert len(bowl.refined) < 30
    assert not refine(Bowl(floor=1e-3), start)
    assert refine(Bowl(floor=1e-3), start, tolerance=2e-3)
    lower, upper = BOUNDS.box
    assert all((lower <= x).all() and (x <= upper).all() for x in bowl.refined)


def test_it_stops_as_soon_as_it_is_near_enough():
    steps = {}
    for tolerance in (0.5, 1e-6):
        bowl = Bowl()
        assert refine(bowl, np.array([0.9, -0.8, 5.5, 0.4, 0.5]), tolerance=tolerance)
        assert (bowl.miss(np.array(bowl.refined[:-1])) > tolerance).all()
        steps[tolerance] = len(bowl.refined)
    assert steps[0.5] < steps[1e-6]


def test_a_refinement_has_its_number_of_steps():
    class Crooked(Bowl):
        def gradient(self, strike):  # a slope that leads nowhere
            outcome, slope = super().gradient(strike)
            return outcome, np.sin(1e4 * strike) * np.abs(slope)

    bowl = Crooked(floor=0.1)
    refine(bowl, np.array([0.9, -0.8, 5.5, 0.4, 0.5]))
    assert len(bowl.refined) <= STEPS


def test_the_nearest_of_a_round_are_refined_first():
    bowl = Bowl(floor=0.01, most=10_000)
    starts = []

    def remember(objective, start, **_):
        starts.append(np.array(start))
        if len(starts) == 2 * REFINED:
            raise Enough
        return False

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(import_module("whiptool.optimizers.gradient_search"), "refine", remember)
        with pytest.raises(Enough):
            gradient_search(bowl, seed=5)
    assert [len(x) for x in bowl.batches] == [BATCH, BATCH]
    assert not np.array_equal(*bowl.batches)
    for strikes, some in zip(bowl.batches, (starts[:REFINED], starts[REFINED:]), strict=True):
        nearest = strikes[np.argsort(bowl.miss(strikes))[:REFINED]]
        np.testing.assert_array_equal(some, nearest)


def test_it_ends_at_the_target_and_where_it_is_told():
    bowl = Bowl()
    gradient_search(bowl, seed=0)
    assert len(bowl.batches) == 1
    with pytest.raises(Enough):
        gradient_search(Bowl(floor=0.01, most=7), seed=0)


@pytest.mark.parametrize("fastest", [0.1, 1.0])
def test_a_refinement_keeps_the_commanded_speeds(fastest):
    """The nearest strike to the minimum among the admissible ones: a quadratic program, by SciPy."""
    bowl = Bowl()
    bowl.smooth = (
        CommandLimits((JointLimits(), JointLimits(velocity=fastest)), share=1.0),
    )  # of the elbow alone, which the minimum moves by -0.4 in 1.1 s
    start = np.array([0.9, 0.3, 5.5, 0.3, 0.5])
    refine(bowl, start)
    strikes = np.array(bowl.refined)
    assert (15 / 8 * np.abs(strikes[:, 3] - strikes[:, 1]) / strikes[:, 4] <= fastest * (1 + 1e-6)).all()
    lower, upper = BOUNDS.box
    expected = scipy.optimize.minimize(
        lambda x: ((x - MINIMUM) ** 2).sum(),
        start,
        bounds=list(zip(lower, upper, strict=True)),
        constraints={"type": "ineq", "fun": lambda x: fastest * x[4] - 15 / 8 * np.array([x[3] - x[1], x[1] - x[3]])},
    )
    best = strikes[bowl.miss(strikes).argmin()]
    np.testing.assert_allclose(best, expected.x, atol=2e-3)
    assert (bowl.miss(best) > 1e-3) == (fastest == 0.1)


def test_strikes_in_which_something_touches_are_not_refined():
    class Half(Bowl):
        def clear(self, strike):
            return bool(strike[0] < 0.5)

    bowl = Half(floor=0.01, most=3000)
    with pytest.raises(Enough):
        gradient_search(bowl, seed=5)
    starts = [x for x in bowl.refined if any(np.array_equal(x, y) for y in bowl.batches[0])]
    assert starts
    assert all(start[0] < 0.5 for start in starts)


def test_a_refinement_into_a_collision_is_given_up():
    """Nearer than 0.2 to the minimum all strikes would collide."""

    class Wall(Bowl):
        penalty = 10.0

        def gradient(self, strike):
            outcome, slope = super().gradient(strike)
            if outcome.cost < 0.2:
                outcome.miss_distance = outcome.cost = self.penalty
                outcome.refused = Clearance.judges
                return outcome, 0 * slope
            return outcome, slope

    bowl = Wall()
    assert not refine(bowl, np.array([0.9, -0.8, 5.5, 0.4, 0.5]))
    assert sum(bowl.miss(x) < 0.2 for x in bowl.refined) == COLLISIONS


@pytest.mark.slow
@pytest.mark.parametrize("name", ["nah2023", "ur5e", "panda"])
def test_who_gives_no_options_hits_the_usual_target_of_an_arm_in_space_after_few_trials(name):
    result = search(CompiledRollout(preset(name)), max_trials=2 * BATCH)
    assert result.outcome.status == "hit"


START = np.array([-0.6, 0.7, 1.0, -1.0, 1.9])
PLACE = np.array([0.2, -0.1])
AWAY = np.linalg.norm(LEAST[:2] - PLACE)  # of the strike without effort from the target


def objective(criterion, target=None, rollout=None, **options) -> Objective:
    return Objective(
        rollout or LinearRollout(),
        target or Target(tuple(PLACE), 0.3),
        bounds=LINEAR_BOUNDS,
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
