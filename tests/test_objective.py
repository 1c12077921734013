"""The objective on a tip that flies straight: outcomes, penalties, budgets, limits."""

from __future__ import annotations

import dataclasses
import math
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from fake_rollout import SPEED, StraightFlight, StraightFlightInSpace

from whiptool.commands.options.strike_options import LimitOptions
from whiptool.errors import InputError
from whiptool.goals.criteria import Effort, PeakTorque, Speed
from whiptool.goals.goals import probability_within
from whiptool.goals.target import Target
from whiptool.impedance import Controller, HandControl, PositionControl
from whiptool.models import Model
from whiptool.models.joint_trajectory import free_hand
from whiptool.models.presets import rope
from whiptool.models.spatial_arm import without_inertia
from whiptool.models.strike import StrikeBounds
from whiptool.objective import Arrival, Objective, SearchStopped
from whiptool.rollout import CompiledRollout

BOUNDS = StrikeBounds((-1.0, 0.0, 0.1, 0.2, 0.4), (1.0, 1.0, 0.3, 0.8, 1.0))
REACH = StraightFlight.model.reach


class Limits:
    """Of motors: peaks are beyond by the first angle less 0.3, the whole strike by half of that."""

    judges, by_peaks, of_candidates, command, positions, smooth = "motor", False, False, None, None, ()

    def __init__(self) -> None:
        self.looked_at = []

    def violation_of_peaks(self, near):
        return near.max_joint_speed[:, 0] - 0.3

    def violation(self, trajectory):
        self.looked_at.append(trajectory)
        return (abs(trajectory.q_i[0]) - 0.3) / 2 - 0.1


class Peaks(Limits):
    """Their peaks say all."""

    by_peaks = True


class Following(StraightFlight):
    def trajectory(self, strike, *, t_stay):
        return strike


def objective(rollout=None, target=None, **options) -> Objective:
    return Objective(rollout or StraightFlight(), target or Target((1.2, 0.0), 0.1), bounds=BOUNDS, **options)


class Measured(StraightFlight):
    """Every miss is seen with a standard error of 2 cm and a hundredth of itself."""

    def approach(self, strikes, targets, *, t_stay):
        near = super().approach(strikes, targets, t_stay=t_stay)
        return dataclasses.replace(near, error=0.02 + 0.01 * near.distance)


@pytest.mark.parametrize("freedom", [np.inf, 3.0])
def test_the_probability_of_a_pass_is_that_of_draws(freedom):
    rng = np.random.default_rng(0)
    draws = rng.standard_normal(400_000) if freedom == np.inf else rng.standard_t(freedom, 400_000)
    for miss, scale in ((0.0, 0.05), (0.04, 0.03), (0.09, 0.02), (0.09, 0.2)):
        expected = np.mean(np.abs(miss + scale * draws) <= 0.06)
        found = probability_within(0.06, np.array(miss), scale, freedom)
        assert found == pytest.approx(expected, abs=5 * math.sqrt(0.25 / 400_000))


def test_a_hit_that_was_measured_is_claimed_by_its_probability():
    """Misses of 2, 7.5 and 9.5 cm with errors of some 2 cm; within 10 cm they are hits with 100, 89 and 60 %."""
    angles = [math.asin(x / 1.2) for x in (0.02, 0.075, 0.095)]
    outcomes = objective(Measured()).batch(np.array([[angle, 0.0, 0.1, 0.2, 0.7] for angle in angles]))
    assert [outcome.miss_error for outcome in outcomes] == pytest.approx([0.0202, 0.02075, 0.02095])
    assert [outcome.hit for outcome in outcomes] == [True, False, False]
    lost = objective(Measured()).batch(np.array([[0.0, 0.95, 0.1, 0.2, 0.7]]))[0]
    assert lost.miss_error is None
    assert not lost.hit
    assert objective().batch(np.array([[0.05, 0.0, 0.1, 0.2, 0.7]]))[0].miss_error is None  # computed, not measured


def test_outcomes_of_straight_flights():
    o = objective()
    outcomes = o.batch(np.array([[0.05, 0.0, 0.1, 0.2, 0.7], [0.4, 0.5, 0.1, 0.2, 0.7], [0.0, 0.95, 0.1, 0.2, 0.7]]))
    for outcome, angle in zip(outcomes, (0.05, 0.4), strict=False):
        assert outcome.miss_distance == pytest.approx(1.2 * math.sin(angle))
        assert outcome.time == pytest.approx(1.2 * math.cos(angle) / SPEED)
        assert outcome.tip == pytest.approx((1.2 * math.cos(angle) ** 2, 1.2 * math.cos(angle) * math.sin(angle)))
        assert outcome.tip_speed == pytest.approx(SPEED)
        assert outcome.max_joint_speed[0] == pytest.approx(angle)
        assert outcome.max_torque[0] == pytest.approx(2 * angle)
    assert [outcome.hit for outcome in outcomes] == [True, False, False]
    assert outcomes[0].hit_time == outcomes[0].time
    assert outcomes[1].hit_time is None
    assert outcomes[2].diverged
    assert outcomes[2].miss_distance == o.penalty == pytest.approx(REACH + 1.2)
    assert (o.n_diverged, o.n_refused, len(o.trials)) == (1, 0, 3)
    assert o.best is o.trials[0]
    assert [trial.number for trial in o.trials] == [1, 2, 3]


def test_torques_of_an_arm_of_unknown_inertia_are_not_known():
    """They are NaN, and no strike is judged by them."""
    flight = StraightFlightInSpace()
    arm = flight.model.arm
    flight.model = dataclasses.replace(flight.model, arm=without_inertia(arm, arm.joints[:1]))
    target, strike = Target((1.2, 0.0, 0.0), 0.1), [*[0.0] * (2 * arm.n), 0.7]
    outcome = Objective(flight, target, criteria=[Speed()])(strike)
    assert outcome.hit
    assert np.isnan(outcome.max_torque).tolist() == [True] * len(outcome.max_torque)
    for criterion in (Effort(), PeakTorque()):
        with pytest.raises(InputError, match=rf"criterion: got '{criterion.name}'; allowed: miss, speed or robustness"):
            Objective(flight, target, criteria=[criterion])
    with pytest.raises(InputError, match="--limits: got 'xm430'; allowed: arm or none"):
        LimitOptions(limits="xm430").build_limits(flight.model, Controller(PositionControl()))


def test_a_motor_that_turns_has_no_line_for_what_slides():
    prismatic = r"--limits: got 'xm430'; allowed: arm or none, because .*hand_x, hand_y, hand_z"
    with pytest.raises(InputError, match=prismatic):
        LimitOptions(limits="xm430").build_limits(Model(rope(), free_hand(np.eye(3))), Controller(PositionControl()))


def test_a_target_counts_as_hit_at_its_radius():
    edge = 1.2 * math.sin(0.05)
    for radius, hit in ((edge, True), (math.nextafter(edge, 0), False)):
        near = StraightFlight().approach(np.array([[0.05, 0, 0, 0, 0.7]]), np.array([1.2, 0.0]), t_stay=0.3)
        assert near.distance[0] == pytest.approx(edge)
        o = objective(target=Target((1.2, 0.0), float(near.distance[0]) if hit else radius * 0.999999))
        assert o([0.05, 0, 0, 0, 0.7]).hit is hit


def test_the_first_of_equals_stays_the_best():
    o = objective()
    o.batch(np.array([[0.2, 0, 0, 0, 0.7], [0.1, 0, 0, 0, 0.7], [0.1, 0.1, 0, 0, 0.7]]))
    assert o.best is o.trials[1]


def test_what_is_beyond_the_limits_is_no_hit():
    """Peaks acquit; where they do not, the whole strike decides, and how far it is beyond raises the penalty."""
    limits = Limits()
    o = objective(Following(), limits=limits)
    strikes = np.array([[0.05, 0, 0, 0, 0.7], [0.4, 0, 0, 0, 0.7], [0.7, 0, 0, 0, 0.7], [0.9, 0, 0, 0, 0.7]])
    outcomes = o.batch(strikes)
    assert len(limits.looked_at) == 3  # not the first, whose peaks are within
    assert outcomes[0].hit
    assert outcomes[1].miss_distance == pytest.approx(1.2 * math.sin(0.4))  # the whole strike is within
    beyond = np.array([0.1, 0.2])
    for outcome, b in zip(outcomes[2:], beyond, strict=True):
        assert outcome.miss_distance == pytest.approx(o.penalty * (2 - 1 / (1 + b)))
        assert not outcome.hit
        assert not outcome.diverged
    assert o.n_refused == 2
    assert o.penalty < outcomes[2].miss_distance < outcomes[3].miss_distance < 2 * o.penalty
    wide = objective(Following(), Target((0.2, 0.0), 1.6), limits=Limits())
    assert [outcome.hit for outcome in wide.batch(strikes)] == [True, True, False, False]


def test_limits_whose_peaks_say_all_look_at_no_whole_strike():
    limits = Peaks()
    o = objective(Following(), limits=limits)
    outcomes = o.batch(np.array([[0.25, 0, 0, 0, 0.7], [0.4, 0, 0, 0, 0.7]]))
    assert not limits.looked_at
    assert outcomes[0].miss_distance == pytest.approx(1.2 * math.sin(0.25))
    assert outcomes[1].miss_distance == pytest.approx(o.penalty * (2 - 1 / 1.1))


def test_budgets():
    rollout = StraightFlight()
    o = objective(rollout, max_trials=3)
    strikes = np.tile([0.5, 0, 0, 0, 0.7], (2, 1))
    assert len(o.batch(strikes)) == 2
    with pytest.raises(SearchStopped, match="trials"):
        o.batch(strikes)
    assert (len(o.trials), sum(rollout.rolled)) == (3, 3)
    o = objective(max_trials=2)
    assert len(o.batch(strikes)) == 2  # all of the budget, and no more asked
    with pytest.raises(SearchStopped, match="trials"):
        o.batch(strikes)
    o = objective(stop_at_hit=True)
    o.batch(strikes)
    with pytest.raises(SearchStopped, match="hit"):
        o.batch(np.array([[0.0, 0, 0, 0, 0.7], [0.5, 0, 0, 0, 0.7]]))
    assert len(o.trials) == 4
    o = objective(max_time=1e-9)
    with pytest.raises(SearchStopped, match="time"):
        o.batch(strikes)
    assert not o.trials
    assert len(objective(max_time=3600.0).batch(strikes)) == 2


def test_gradients_are_trials():
    class Sloped(StraightFlight):
        def gradient(self, strikes, target, *, t_stay):
            assert target.tolist() == [1.2, 0.0]
            return None, np.arange(5.0)[None] + strikes

    o = objective(Sloped())
    outcome, slope = o.gradient([0.2, 0, 0, 0, 0.7])
    assert outcome.miss_distance == pytest.approx(1.2 * math.sin(0.2))
    np.testing.assert_allclose(slope, [0.2, 1, 2, 3, 4.7])
    outcome, slope = o.gradient([0.2, 0.95, 0, 0, 0.7])
    assert outcome.diverged
    assert not slope.any()
    assert len(o.trials) == 2


def arriving(**asked) -> Target:
    """A target straight ahead, 0.1 m around; the tip passes it at its own azimuth, at 2 m/s."""
    return Target((1.2, 0.0), 0.1, **asked)


def test_a_hit_arrives_as_the_target_asks():
    """Azimuths of 0, 3 and 4.5 degrees pass within 0.1 m; asked are 7 degrees, to 3.5, and speeds."""
    azimuths = np.radians([0, 3, 4.5, 7])
    strikes = np.array([[a, 0, 0, 0, 0.7] for a in azimuths])
    ahead = (math.cos(math.radians(7)), math.sin(math.radians(7)))
    o = objective(target=arriving(direction=ahead, cone=math.radians(3.5)))
    outcomes = o.batch(strikes)
    assert [x.hit for x in outcomes] == [False, False, True, False]
    for x, a in zip(outcomes, azimuths, strict=True):
        assert x.arrival is not None
        assert x.arrival.angle == pytest.approx(math.radians(7) - a)
        assert x.arrival.speed == pytest.approx(SPEED * math.cos(math.radians(7) - a))
        chord = math.sin((math.radians(7) - a) / 2) / math.sin(math.radians(3.5) / 2)
        assert x.cost == pytest.approx(math.hypot(1.2 * math.sin(a), 0.1 * chord))
    assert o.best is o.trials[2]  # of the least cost; the first came nearest
    for speed, hit in ((1.9, True), (2.1, False)):
        fast = objective(target=arriving(speed=speed)).batch(strikes[:1])[0]
        assert fast.hit is hit
        assert fast.arrival == Arrival(None, pytest.approx(SPEED), pytest.approx(max(0, 0.1 * (1 - SPEED / speed))))


def test_what_is_lost_costs_more_than_the_worst_arrival():
    backward = arriving(direction=(-1.0, 0.0), cone=0.1, speed=5.0)
    o = objective(target=backward)
    worst, lost = o.batch(np.array([[0.0, 0, 0, 0, 0.7], [0.0, 0.95, 0, 0, 0.7]]))
    assert lost.arrival is None
    assert lost.cost == lost.miss_distance >= o.penalty > worst.cost > 1
    assert objective().penalty < o.penalty  # of a point it is the farthest miss alone


def test_gradients_of_arrivals_are_those_of_the_cost():
    class Turning(StraightFlight):
        def arrival_gradient(self, strikes, target, *, t_stay):
            a = strikes[:, 0]
            dtip, dvelocity = np.zeros((2, 1, 2, 5))
            dtip[0, :, 0] = 1.2 * np.concatenate([-np.sin(2 * a), np.cos(2 * a)])
            dvelocity[0, :, 0] = SPEED * np.concatenate([-np.sin(a), np.cos(a)])
            return self.approach(strikes, target, t_stay=t_stay), dtip, dvelocity

    o = objective(Turning(), arriving(direction=(1.0, 0.3), speed=2.5))
    for a in (-0.2, 0.1, 0.6):
        outcome, slope = o.gradient([a, 0, 0, 0, 0.7])
        costs = [o([a + by, 0, 0, 0, 0.7]).cost for by in (-1e-6, 1e-6)]
        assert slope[0] == pytest.approx((costs[1] - costs[0]) / 2e-6, rel=1e-5)
        assert not slope[1:].any()
        assert outcome.cost == pytest.approx(np.mean(costs))


def test_a_log_answers_and_is_told():
    first = objective()
    strikes = np.array([[0.1, 0, 0, 0, 0.7], [0.2, 0, 0, 0, 0.7], [0.3, 0, 0, 0, 0.7]])
    first.batch(strikes)
    rollout, told = StraightFlight(), []
    again = objective(rollout)
    again.record(first.trials[:2], told.append)
    assert again(strikes[0]) == first.trials[0].outcome
    again.batch(strikes[1:])
    assert again.trials == first.trials == told
    assert sum(rollout.rolled) == 1


def test_targets_within_reach():
    Target((REACH, 0.0)).check_reach(StraightFlight.model)
    Target((0.0, -(REACH + 0.06))).check_reach(StraightFlight.model)
    for x in ((REACH + 0.0601, 0.0), (REACH, 0.5)):
        with pytest.raises(InputError, match="reach"):
            Target(x).check_reach(StraightFlight.model)
    assert objective(target=Target((9.0, 0.0)), check_reach=False).penalty == pytest.approx(REACH + 9)
    assert objective(target=Target((0.3, -0.4))).penalty == pytest.approx(REACH + 0.5)


def test_what_is_usual_and_what_would_never_end():
    assert Target() == Target((1.3, 0.0), 0.06)  # Eq. 17; the target is the middle of the usual zone
    with pytest.raises(InputError):
        objective(t_stay=1e12)


def test_hits_are_judged_and_any_hit_is_better_than_any_miss():
    """By the torque, which of a straight flight is twice the larger of the first two angles."""
    o = objective(criteria=[PeakTorque(), Speed()], limits=Peaks())
    strikes = np.array([[0.07, 0.2, 0.1, 0.2, 0.7], [0.01, 0.4, 0.1, 0.2, 0.7], [0.2, 0.0, 0.1, 0.2, 0.7]])
    outcomes = o.batch(np.vstack([strikes, [[0.4, 0.0, 0.1, 0.2, 0.7], [0.0, 0.95, 0.1, 0.2, 0.7]]]))
    assert [outcome.hit for outcome in outcomes] == [True, True, False, False, False]
    assert [outcome.values[:1] for outcome in outcomes] == [(0.4,), (0.8,), (0.4,), (), ()]
    assert outcomes[0].values[1] == pytest.approx(SPEED)
    assert outcomes[0].cost == outcomes[0].merit < outcomes[1].cost < 0
    assert [outcome.merit for outcome in outcomes[2:]] == [None] * 3
    assert 0 < outcomes[2].cost == outcomes[2].miss_distance < outcomes[3].cost
    assert o.best is not None
    assert o.best.number == 1


def test_strikes_of_the_hand_that_no_joints_can_make_are_refused_trials():
    rollout = CompiledRollout(
        StraightFlight.model, Controller(PositionControl(), hand=HandControl()), engine="interpreter"
    )
    objective = Objective(rollout, (1.2, -0.4))
    assert len(objective.bounds.lower) == 5
    assert not objective.smooth
    good, far, farther = [0.3, -0.3, 0.5, -0.1, 0.4], [0.3, -0.3, 2.0, 0.0, 0.4], [0.3, -0.3, 4.0, 0.0, 0.4]
    outcomes = objective.batch(np.array([far, good, farther]))
    assert [outcome.refused is not None for outcome in outcomes] == [True, False, True]
    assert objective.penalty < outcomes[0].miss_distance < outcomes[2].miss_distance < 2 * objective.penalty
    assert outcomes[1].miss_distance == rollout.approach(np.array(good), (1.2, -0.4)).distance[0]
    assert objective.n_refused == 2
    assert objective.best is not None
    assert objective.best.number == 2
    outcome, slope = objective.gradient(np.array(far))
    assert outcome.refused is not None
    assert not slope.any()


def test_trials_of_several_threads_are_counted_one_after_the_other():
    searched = objective(max_trials=100)

    def strike(vector):
        try:
            return searched(vector).miss_distance
        except SearchStopped:
            return math.nan

    with ThreadPoolExecutor(3) as threads:
        found = list(threads.map(strike, BOUNDS.sample(np.random.default_rng(0), 150)))
    assert [trial.number for trial in searched.trials] == list(range(1, 101))
    assert np.isfinite(found).sum() == 100
    assert searched.best == min(searched.trials, key=lambda trial: trial.outcome.cost)


def test_what_is_lost_has_no_miss():
    """The third diverges: its miss distance is a penalty, which is nowhere shown as a distance."""
    o = objective()
    seen, _, lost = o.batch(
        np.array([[0.05, 0.0, 0.1, 0.2, 0.7], [0.4, 0.5, 0.1, 0.2, 0.7], [0.0, 0.95, 0.1, 0.2, 0.7]])
    )
    assert seen.known_miss == pytest.approx(1.2 * math.sin(0.05))
    assert lost.known_miss is None
    assert repr(o).endswith(f"3 trials, best: hit, {seen.miss_distance:.4f} m)")
