"""Searches on functions with a known minimum, and the objective that keeps their accounts."""

from __future__ import annotations

import dataclasses
import signal
from dataclasses import replace

import numpy as np
import pytest

from whiptool.comparison.search_unit import StrikeLibrary, warm_search
from whiptool.errors import InputError
from whiptool.goals.target import Target
from whiptool.impedance import OIAC, Controller, oiac_preset
from whiptool.limits.limits import CommandLimits
from whiptool.models import preset
from whiptool.models.spatial_arm import JointLimits
from whiptool.models.strike import Strike, StrikeBounds, default_bounds
from whiptool.models.trajectory import Approach
from whiptool.objective import Objective, Outcome, SearchStopped, Trial
from whiptool.optimizers import MESSAGES, METHODS, Result, Status, find_method, search
from whiptool.optimizers.derivative_free import fitness, nlopt_names
from whiptool.rollout import CompiledRollout, ReferenceRollout
from whiptool.rollout.interface import Rollout

LEMON = preset("lemon2024")
UNIT = StrikeBounds((0.0, 0.0, 0.0, 0.0, 0.5), (1.0, 1.0, 1.0, 1.0, 1.5))
MINIMUM = np.array([0.3, 0.6, 0.2, 0.7, 1.1])


class Bowl(Rollout):
    """Instead of physics: the miss distance is the distance of the strike vector from a known point."""

    model, engine, timestep = LEMON, "bowl", 1.0

    def __init__(self, diverging: bool = False) -> None:
        self.calls, self.diverging = 0, diverging

    def trajectory(self, strike, *, t_stay=0.3):
        raise NotImplementedError("a bowl has no joints")

    def approach(self, strikes, target, *, t_stay):
        self.calls += len(strikes)
        distance = np.linalg.norm(strikes - MINIMUM, axis=1)
        none = np.zeros((len(strikes), 2))
        diverged = strikes[:, 0] > 0.5 if self.diverging else np.zeros(len(strikes), bool)
        distance = np.where(diverged, np.nan, distance)
        return Approach(distance, distance, none, none, none, none, diverged)

    def gradient(self, strikes, target, *, t_stay):
        offset = strikes - MINIMUM
        return None, offset / np.maximum(np.linalg.norm(offset, axis=1, keepdims=True), 1e-300)


@pytest.mark.slow
@pytest.mark.parametrize("method", [*METHODS, "nlopt:GN_CRS2_LM", "nlopt:GN_ISRES", "nlopt:GN_ESCH"])
def test_the_budget_is_kept_exactly_and_the_best_is_kept(method):
    bowl, budget = (
        Bowl(),
        40 if method in ("gradient", "map") else 137,
    )  # more, and searches with gradients would be done
    result = search(Objective(bowl, Target(hit_radius=1e-9), bounds=UNIT, max_trials=budget), method, seed=3)
    assert (result.status, result.n_trials, bowl.calls) == (Status.MAX_TRIALS, budget, budget)
    best = min(result.trace, key=lambda trial: trial.outcome.miss_distance)
    assert result.strike.vector.tolist() == list(best.strike)
    assert result.outcome == best.outcome
    assert [trial.number for trial in result.trace] == list(range(1, budget + 1))
    lower, upper = UNIT.box
    assert all((lower <= trial.strike).all() and (trial.strike <= upper).all() for trial in result.trace)


class Slow:
    """Limits of the commanded speeds alone."""

    judges, words, by_peaks, of_candidates, positions = "joint", "a speed", True, False, None
    command = CommandLimits((JointLimits(velocity=0.5), JointLimits()))
    smooth = (command,)

    def violation_of_peaks(self, near):
        return np.full(len(near.distance), -1.0)

    def violation(self, trajectory):
        raise NotImplementedError("peaks say all")


@pytest.mark.slow
@pytest.mark.parametrize("method", [*METHODS, "nlopt:GN_CRS2_LM"])
def test_every_search_commands_admissible_speeds(method):
    bounds = StrikeBounds((0.0, 0.0, 0.1, 0.0, 0.5), (1.0, 1.0, 0.9, 1.0, 1.5))  # where q_f has bounds, they come first
    objective = Objective(Bowl(), Target(hit_radius=1e-9), bounds=bounds, max_trials=90, limits=Slow())
    strikes = np.array([trial.strike for trial in search(objective, method, seed=1).trace])
    assert len(strikes) > 30
    moved, farthest = np.abs(strikes[:, 2] - strikes[:, 0]), 0.5 * strikes[:, 4] / (15 / 8)
    inside = (strikes[:, 2] > 0.1) & (strikes[:, 2] < 0.9)
    assert (moved <= farthest + 1e-6)[inside].all()
    assert inside.mean() > 0.5
    assert (np.abs(strikes[:, 3] - strikes[:, 1]) > farthest).any()  # the other joint may be fast
    lower, upper = bounds.box
    assert ((lower <= strikes) & (strikes <= upper)).all()


@pytest.mark.parametrize(
    ("method", "close"),
    [
        ("directl", 0.02),
        ("gradient", 1e-6),
        ("cmaes", 1e-3),
        ("ga", 0.02),
        ("nlopt:GN_CRS2_LM", 0.02),
        ("random", 0.35),
    ],
)
def test_searches_come_close_to_a_known_minimum(method, close):
    result = search(Objective(Bowl(), Target(hit_radius=1e-9), bounds=UNIT, max_trials=1000), method, seed=0)
    assert result.outcome.miss_distance < close


def test_the_fitness_of_the_genetic_algorithm_is_eq_20():
    assert fitness(np.array([0.0, 1.0, 4.0]), 4.0).tolist() == [1.0, 0.75, 0.0]


def test_a_library_knows_what_passed_a_target_and_a_search_begins_there():
    rollout = CompiledRollout(LEMON, Controller(oiac_preset("table4")))
    library = StrikeLibrary.random(rollout, default_bounds(LEMON.arm), 64, seed=1)
    target = rollout.tip_path(library.strikes[[17]], t_stay=0.3, rate=100.0)[1][0, 60]  # on a path: its strike hits
    strikes, distance = library.nearest(target, 5)
    assert (np.diff(distance) >= 0).all()
    assert strikes[0].tolist() == library.strikes[17].tolist()
    true = rollout.approach(strikes, target, t_stay=0.3).distance
    np.testing.assert_allclose(distance, true, atol=2e-3)
    objective = Objective(rollout, Target(tuple(target), 0.01), max_trials=50, stop_at_hit=True)
    assert warm_search(objective, "directl", library).first_hit == 1
    apart = target + np.array([0.0, 0.03])
    objective = Objective(rollout, Target(tuple(apart), 1e-6), max_trials=60, check_reach=False)
    result = warm_search(objective, "cmaes", library)
    assert result.outcome.miss_distance < result.trace[0].outcome.miss_distance
    lower, upper = objective.bounds.box
    assert ((upper - lower) <= 0.1001 * np.ptp(default_bounds(LEMON.arm).box, axis=0)).all()


@pytest.mark.parametrize("name", nlopt_names())
def test_every_nlopt_name_runs_or_says_why(name):
    result = search(Objective(Bowl(), Target(hit_radius=1e-9), bounds=UNIT, max_trials=60), f"nlopt:{name}", seed=0)
    assert result.status in (Status.MAX_TRIALS, Status.CONVERGED, Status.FAILED)
    assert result.n_trials == 60 or result.status is not Status.MAX_TRIALS


def test_seeds_decide_what_is_random():
    def trace(method, seed):
        objective = Objective(Bowl(), bounds=UNIT, max_trials=30)
        return [trial.strike for trial in search(objective, method, seed=seed).trace]

    state = np.random.get_state()[1].tolist()  # noqa: NPY002
    for method in ("nlopt:GN_CRS2_LM", "cmaes", "gradient", "random"):
        assert trace(method, 0) == trace(method, 0)
        assert trace(method, 0) != trace(method, 1)
    assert np.random.get_state()[1].tolist() == state  # noqa: NPY002


def test_the_gradient_search_reaches_the_middle_of_a_target():
    """To the millimetre, on a few targets; benchmarks/gradient.py has 100."""
    rollout = CompiledRollout(LEMON, Controller(OIAC(a=2e-4)))
    for seed, position in enumerate([(1.3, 0.0), (1.22, 0.04), (1.35, -0.07)]):
        objective = Objective(rollout, Target(position, hit_radius=1e-3), max_trials=3000, stop_at_hit=True)
        result = search(objective, "gradient", seed=seed)
        assert result.outcome.miss_distance <= 1e-3
        assert result.n_trials < 500
    with pytest.raises(InputError, match="derivatives"):
        Objective(ReferenceRollout(LEMON, Controller())).gradient([-1.2, 0.9, 1.2, 0.3, 0.7])


def test_a_hit_ends_the_search():
    result = search(Objective(Bowl(), Target(hit_radius=0.3), bounds=UNIT, max_trials=500, stop_at_hit=True), "directl")
    assert result.status is Status.HIT
    assert result.outcome.hit
    assert not any(trial.outcome.hit for trial in result.trace[:-1])


def test_divergence_costs_a_finite_penalty_and_is_counted():
    objective = Objective(Bowl(diverging=True), bounds=UNIT, max_trials=200)
    result = search(objective, "directl")
    diverged = [trial for trial in result.trace if trial.outcome.diverged]
    assert result.n_diverged == len(diverged) > 0
    assert all(trial.outcome.miss_distance == objective.penalty for trial in diverged)
    assert not result.outcome.diverged


def test_time_and_interruption_end_a_search():
    result = search(Objective(Bowl(), bounds=UNIT, max_time=0.05), "random")
    assert result.status is Status.MAX_TIME
    for method in ("directl", "random"):
        objective = Objective(Bowl(), Target(hit_radius=1e-9), bounds=UNIT, max_trials=100)

        def interrupt(trial):
            if trial.number == 7:
                raise KeyboardInterrupt

        objective.record([], interrupt)
        result = search(objective, method)
        assert (result.status, result.n_trials) == (Status.INTERRUPTED, 7)
        assert result.strike is not None
    with pytest.raises(InputError, match="max trials"):
        search(Objective(Bowl(), bounds=UNIT), "random")


def test_batches_count_every_trial_and_stop_at_the_budget():
    objective = Objective(Bowl(), bounds=UNIT, max_trials=5)
    strikes = UNIT.sample(np.random.default_rng(0), 4)
    assert len(objective.batch(strikes)) == 4
    with pytest.raises(SearchStopped, match="trials"):
        objective.batch(strikes)
    assert len(objective.trials) == 5
    with pytest.raises(SearchStopped, match="trials"):
        objective(strikes[0])
    assert len(objective.trials) == 5


def test_the_objective_copies_what_it_is_given():
    objective = Objective(Bowl(), bounds=UNIT)
    buffer = MINIMUM.copy()
    objective(buffer)
    buffer[:] = 0.9
    assert objective.best.strike == tuple(MINIMUM)


def test_replayed_trials_are_not_simulated_and_must_repeat():
    bowl = Bowl()
    first = Objective(bowl, bounds=UNIT, max_trials=40)
    search(first, "directl")
    again = Objective(bowl, bounds=UNIT, max_trials=60)
    again.record(first.trials, lambda trial: None)
    result = search(again, "directl")
    assert bowl.calls == 60
    assert list(result.trace[:40]) == first.trials
    other = Objective(bowl, bounds=UNIT, max_trials=60)
    other.record([dataclasses.replace(first.trials[0], strike=(0.0,) * 5)], lambda trial: None)
    with pytest.raises(Exception, match="trial 1 of the resumed run"):
        search(other, "directl")


def test_outcomes_of_both_simulators_agree():
    target = Target((1.2, 0.1))
    vector = [-1.2, 0.9, 1.2, 0.3, 0.7]
    a, b = (
        Objective(rollout(LEMON, Controller(OIAC(a=1e-3))), target)(vector)
        for rollout in (CompiledRollout, ReferenceRollout)
    )
    assert a.miss_distance == pytest.approx(b.miss_distance, abs=1e-4)
    assert a.time == pytest.approx(b.time, abs=1e-4)
    assert a.tip_speed == pytest.approx(b.tip_speed, rel=1e-3)
    assert a.max_torque == pytest.approx(b.max_torque, rel=1e-2)
    assert a.max_joint_speed == pytest.approx(b.max_joint_speed, rel=1e-3)
    assert (a.hit_time is not None) == a.hit == (a.miss_distance <= 0.06)


def test_strikes_that_are_none_never_reach_the_simulator():
    objective = Objective(CompiledRollout(LEMON, Controller()))
    for wrong in ([1, 2, 0.7], [np.nan] * 5, [0.0] * 6):
        with pytest.raises(InputError, match=r"strikes of 5 numbers, .*all of them finite|vectors of 5 finite numbers"):
            objective(wrong)
    with pytest.raises(InputError, match="D > 0"):
        objective([0, 0, 0, 0, -1])
    with pytest.raises(InputError):
        ReferenceRollout(LEMON, Controller()).trajectory(Strike((0.2,), (1.0,), 1.0), t_stay=0.3)
    with pytest.raises(InputError):
        CompiledRollout(LEMON, Controller()).trajectory(Strike((0.2,), (1.0,), 1.0), t_stay=0.3)
    assert not objective.trials


def test_bad_targets_and_methods_are_refused():
    for position in ((np.nan, 0.0), (1.0,), (np.inf, 1.0)):
        with pytest.raises(InputError, match="target"):
            Target(position)
    with pytest.raises(InputError, match=r"reach of 1\.514 m"):
        Objective(Bowl(), Target((2.0, 0.0)), bounds=UNIT)
    with pytest.raises(InputError, match="hit radius"):
        Target(hit_radius=0.0)
    with pytest.raises(InputError, match=r"directl, gradient, map, cmaes, ga, sac, td3, ddpg, ppo, random, nlopt:GN_"):
        find_method("sgd")


def outcome(miss: float, hit: bool = False) -> Outcome:
    return Outcome(miss, hit, 0.5, (1.0, 0.0), (3.0, 4.0), (1.0, 2.0), (0.1, 0.2), False)


def result(*misses: float, radius: float = 0.06) -> Result:
    trace = tuple(Trial(i + 1, (0.0,) * 5, outcome(x, x <= radius)) for i, x in enumerate(misses))
    best = min((trial.outcome for trial in trace), key=lambda x: x.miss_distance, default=None)
    strike = None if best is None else Strike((0.0, 0.1), (0.2, 0.3), 0.5)
    return Result("random", Status.MAX_TRIALS, MESSAGES[Status.MAX_TRIALS], strike, best, trace, 0, 1.0)


@pytest.mark.parametrize(
    ("misses", "first"),
    [((0.3, 0.05, 0.2, 0.01), 2), ((0.06,), 1), ((0.3, 0.061), None), ((), None)],
)
def test_the_first_hit_is_the_first_and_not_the_best(misses: tuple[float, ...], first: int | None):
    found = result(*misses)
    assert found.first_hit == first
    assert found.n_trials == len(misses)


def test_the_best_strike_hits_or_misses():
    assert (result(0.3, 0.05).hit, result(0.3, 0.05).miss_distance) == (True, 0.05)
    assert (result(0.3, 0.1).hit, result(0.3, 0.1).miss_distance) == (False, 0.1)
    assert (result().hit, result().miss_distance) == (False, float("inf"))


@pytest.mark.parametrize("step", ["ask", "tell"])
def test_a_signal_within_a_library_ends_the_search(step, monkeypatch):
    import cmaes

    own, calls = getattr(cmaes.CMA, step), []

    def interrupted(self, *args, **kwargs):
        calls.append(step)
        if len(calls) == 3:
            signal.raise_signal(signal.SIGINT)
        return own(self, *args, **kwargs)

    monkeypatch.setattr(cmaes.CMA, step, interrupted)
    result = search(Objective(Bowl(), bounds=UNIT, max_trials=300), "cmaes")
    assert result.status is Status.INTERRUPTED
    assert len(calls) == 3


def test_an_interrupted_search_ends_the_work_it_is_part_of():
    found = result(0.3)
    assert found.uninterrupted() is found
    with pytest.raises(KeyboardInterrupt):
        replace(found, status=Status.INTERRUPTED).uninterrupted()


def test_numbers_of_trials_are_their_own():
    """A search that goes on has trials whose numbers do not begin at 1."""
    trace = tuple(Trial(n, (0.0,) * 5, outcome(0.1 if n < 12 else 0.05, n >= 12)) for n in (11, 12, 13))
    found = Result("random", Status.HIT, "", None, None, trace, 0, 0.0)
    assert found.first_hit == 12
    assert found.n_trials == 3


def test_one_line_says_method_status_and_best():
    assert repr(result(0.3, 0.12345)) == "Result(random: max_trials, 2 trials, best miss 0.1235 m: miss)"
    assert repr(result()) == "Result(random: max_trials, 0 trials, no trial)"


def test_every_status_has_its_own_message():
    assert set(MESSAGES) == set(Status)
    assert len(set(MESSAGES.values())) == len(Status)
    assert len({status.value for status in Status}) == len(Status)
