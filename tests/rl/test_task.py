"""The learners' task on a tip that flies straight: rewards, observations, penalties, counts."""

from __future__ import annotations

import math

import numpy as np
import pytest
from arrivals_by_hand import cost_by_hand, hit_by_hand
from fake_rollout import SPEED, StraightFlight, StraightFlightInSpace

from whiptool.errors import InputError
from whiptool.goals.arrival_rule import ArrivalRule, GoalRegion
from whiptool.goals.target import HIT_RADIUS
from whiptool.goals.zone import Disc
from whiptool.limits.arm_limits import ArmLimits
from whiptool.models import preset
from whiptool.models.strike import StrikeBounds
from whiptool.objective import Objective
from whiptool.rl.task import StrikeTask, log_reward, reward

BOUNDS = StrikeBounds((-0.5, 0.0, 0.1, 0.2, 0.4), (0.5, 1.0, 0.3, 0.8, 1.0))
ZONE = Disc((1.0, 0.2), 0.4)
ANY = ArrivalRule()


def task(*, arrival: ArrivalRule = ANY, hit_radius: float = HIT_RADIUS, **options) -> StrikeTask:
    return StrikeTask(StraightFlight(), GoalRegion(ZONE, arrival, hit_radius), bounds=BOUNDS, **options)


def test_the_reward_of_eq_17():
    above = math.nextafter
    distances = np.array([0.0, 0.06, above(0.06, 1), 0.1, above(0.1, 1), 1.0])
    assert reward(distances, distances <= 0.06) == pytest.approx([50, 50, -0.3, -0.5, -1.0, -10])
    assert reward(np.array([0.01, 0.02]), np.array([True, False])) == pytest.approx([50, -0.1])


def test_the_logarithmic_reward():
    assert log_reward(np.array([0.06, 0.12, 0.018, 0.001]), 0.06) == pytest.approx(
        [0, -math.log(2), -math.log(0.3), -math.log(0.3)]
    )
    logarithmic = task(reward="log", hit_radius=0.1)
    assert logarithmic.reward(np.array([0.2]), np.array([False])) == pytest.approx([-math.log(2)])


def test_actions_cover_the_box():
    t = task()
    actions = np.array([[-1, -1, -1, -1, -1], [1, 1, 1, 1, 1], [0, 0, 0, 0, 0], [-3, 3, 0.5, -0.5, 1]], float)
    expected = [BOUNDS.lower, BOUNDS.upper, (0, 0.5, 0.2, 0.5, 0.7), (-0.5, 1, 0.25, 0.35, 1)]
    np.testing.assert_allclose(t.to_strikes(actions), expected, atol=1e-15)


@pytest.mark.parametrize("observation", ["tip", "relative", "goal"])
def test_a_step_on_a_straight_flight(observation):
    t = task(observation=observation, strikes=2, hit_radius=0.1)
    targets = np.array([[1.0, 0.0], [1.0, 0.3], [0.9, 0.2]])
    first = t.reset(targets)
    rest = t.resting_tip
    assert rest[0] == pytest.approx(0, abs=1e-12)
    assert rest[1] == pytest.approx(-t.rollout.model.reach)
    shown = {
        "tip": np.hstack([np.tile(rest, (3, 1)), np.zeros((3, 2))]),
        "relative": np.hstack([rest - targets, np.zeros((3, 2))]),
        "goal": np.hstack([np.tile(rest, (3, 1)), np.zeros((3, 2)), targets]),
    }[observation]
    np.testing.assert_allclose(first, shown, atol=1e-12)
    actions = np.array([[0.0, 0, 0, 0, 1], [0.0, 0, 0, 0, 1], [0.0, 1, 0, 0, 1]])  # straight ahead; the last diverges
    step = t.step(actions)
    tips, velocity = np.array([[1.0, 0], [1.0, 0]]), np.array([[SPEED, 0], [SPEED, 0]])
    seen = {
        "tip": np.hstack([tips, velocity]),
        "relative": np.hstack([tips - targets[:2], velocity]),
        "goal": np.hstack([tips, velocity, targets[:2]]),
    }[observation]
    np.testing.assert_allclose(step.obs[:2], seen, atol=1e-12)
    np.testing.assert_allclose(step.obs[2], first[2])  # as before the first strike
    assert step.hit.tolist() == [True, False, False]
    penalty = t.rollout.model.reach + math.sqrt(2) * 1.4
    assert t.penalty == pytest.approx(penalty)
    assert step.reward == pytest.approx([50, -3, -10 * penalty])
    assert step.truncated.tolist() == [False, False, False]
    again = t.step(actions)
    assert again.truncated.tolist() == [False, True, True]
    assert (t.n_strikes, t.n_diverged) == (6, 2)
    over = again.hit | again.truncated
    renewed = t.renew(again.obs, over, targets + 0.1)
    np.testing.assert_allclose(renewed, t.first_look(targets + 0.1))
    assert t.counts.tolist() == [0, 0, 0]
    np.testing.assert_allclose(t.targets, targets + 0.1)


BALL = Disc((1.0, 0.2, 0.1), 0.4)
IN_SPACE = StrikeBounds((-0.5, 0.0, -0.5, *(0.1,) * 5, 0.4), (0.5, 1.0, 0.5, *(0.3,) * 5, 1.0))


@pytest.mark.parametrize("observation", ["tip", "relative", "goal"])
def test_a_step_in_space(observation):
    t = StrikeTask(StraightFlightInSpace(), GoalRegion(BALL, hit_radius=0.1), bounds=IN_SPACE, observation=observation)
    assert (t.n_act, t.n_obs) == (9, 9 if observation == "goal" else 6)
    targets = np.array([[1.0, 0.0, 0.0], [1.0, 0.3, 0.1]])
    first = t.reset(targets)
    hand = np.array([0.0, 0.0, -0.585])  # of the person's arm, hanging
    assert t.resting_tip[2] < hand[2] * np.cos(0.5)
    np.testing.assert_allclose(
        first[:, :3], t.resting_tip - (targets if observation == "relative" else 0 * targets), atol=1e-12
    )
    step = t.step(np.zeros((2, 9)))  # straight ahead
    tip = np.array([[1.0, 0, 0], [1.0, 0, 0]])
    shown = [tip - targets if observation == "relative" else tip, np.array([[SPEED, 0, 0]] * 2)]
    shown += [targets] if observation == "goal" else []
    np.testing.assert_allclose(step.obs, np.hstack(shown), atol=1e-12)
    assert step.hit.tolist() == [True, False]
    assert t.penalty == pytest.approx(t.rollout.model.reach + math.sqrt(3) * 1.4)
    seen = t.normalise(step.obs)
    where = shown[0] if observation == "relative" else tip - BALL.centre  # a ball narrower than a metre
    np.testing.assert_allclose(seen[:, :3], where, atol=1e-12)
    np.testing.assert_allclose(seen[:, 3:6], shown[1] / 10)
    np.testing.assert_allclose(
        seen[:, 6:], (targets - BALL.centre) / 0.4 if observation == "goal" else np.empty((2, 0)), atol=1e-12
    )


def test_the_arm_rests_where_strikes_start_in_space():
    """The whip hangs straight down from the hand of the arm in the middle of its box."""
    t = StrikeTask(StraightFlightInSpace(), BALL, bounds=IN_SPACE)
    hand, nodes = t.resting[4], t.resting[5:]
    np.testing.assert_allclose(nodes[:, :2], np.tile(hand[:2], (25, 1)), atol=1e-9)
    np.testing.assert_allclose(hand[2] - nodes[:, 2], 0.072 * np.arange(1, 26))
    flexion, abduction, rotation, elbow = 0.0, 0.5, 0.0, 0.2  # middle of q_i
    assert hand[2] == pytest.approx(-np.cos(abduction) * (0.294 * np.cos(flexion) + 0.291 * np.cos(flexion + elbow)))
    assert rotation == 0


def test_a_task_has_a_zone_of_its_models_space():
    assert StrikeTask(StraightFlightInSpace()).zone == Disc((1.3, 0.0, 0.0))
    with pytest.raises(InputError, match="coordinates of the zone: got 2; allowed: 3"):
        StrikeTask(StraightFlightInSpace(), ZONE)


def test_only_lanes_that_ended_are_renewed():
    t = task(strikes=5)
    targets = np.array([[1.0, 0.1], [0.8, 0.2], [1.2, 0.3]])
    t.reset(targets)
    before = t.step(np.zeros((3, 5))).obs
    lanes = np.array([False, True, False])
    after = t.renew(before, lanes, np.array([[1.1, 0.4]]))
    assert t.counts.tolist() == [1, 0, 1]
    np.testing.assert_array_equal(t.targets, [[1.0, 0.1], [1.1, 0.4], [1.2, 0.3]])
    np.testing.assert_array_equal(after[[0, 2]], before[[0, 2]])
    np.testing.assert_allclose(after[1], t.first_look(np.array([[1.1, 0.4]]))[0])


@pytest.mark.parametrize("zone", [ZONE, Disc((1.0, 0.2), 0.7)])  # half widths below and above half a metre
def test_networks_see_sizes_of_one(zone):
    obs = np.array([[1.3, -0.4, 5.0, -20.0, 1.2, 0.5]])
    centre, half = np.array(zone.centre), zone.radius
    size = max(1.0, 2 * half)
    where = (obs[:, :2] - centre) / size
    expected = {
        "tip": np.hstack([where, [[0.5, -2]]]),
        "relative": np.hstack([obs[:, :2] / size, [[0.5, -2]]]),
        "goal": np.hstack([where, [[0.5, -2]], (obs[:, 4:] - centre) / half]),
    }
    for observation, wanted in expected.items():
        t = StrikeTask(StraightFlight(), zone, observation=observation, bounds=BOUNDS)
        np.testing.assert_allclose(t.normalise(obs[:, : t.n_obs]), wanted)
        assert (t.n_obs, t.n_act) == (wanted.shape[1], 5)


@pytest.mark.parametrize(
    "asked", [{"direction": (3.0, 1.0)}, {"angle": (-0.4, 0.9)}, {"speed": 2.5}, {"angle": 0.3, "speed": 1.9}]
)
def test_rewards_and_hits_of_arrivals_on_straight_flights(asked):
    """600 flights at goals of their own, each judged by hand: as a point, an angle and a speed, never by `Goals`."""
    rule = ArrivalRule(cone=0.2, **asked)
    t = task(arrival=rule, hit_radius=0.15)
    rng, count = np.random.default_rng(0), 600
    seen = t.reset(t.draw(rng.random((count, t.n_uniform))))
    assert t.n_obs == seen.shape[1] == (6 if asked == {"speed": 2.5} else 8)
    assert t.n_uniform == (4 if "angle" in asked and isinstance(asked["angle"], tuple) else 3)
    actions = rng.uniform(-1, 1, (count, 5))
    step = t.step(actions)
    strikes, hits = t.to_strikes(actions), []
    for lane in range(count):
        wanted = None if t.goals.directions is None else t.goals.directions[lane]
        if strikes[lane, 1] > 0.9:
            gained = -10 * t.penalty
            hits.append(False)
        else:
            flight = SPEED * np.array([math.cos(strikes[lane, 0]), math.sin(strikes[lane, 0])])
            end = SPEED * (strikes[lane, 4] + t.t_stay)
            along = min(max(t.targets[lane] @ flight / SPEED, 0.0), end)
            miss = math.dist(along * flight / SPEED, t.targets[lane])
            args = (miss, flight, wanted, 0.15, 0.2, asked.get("speed"))
            hits.append(hit_by_hand(*args))
            cost = cost_by_hand(*args)
            gained = 50.0 if hits[-1] else (-5 * cost if cost <= 0.1 else -10 * cost)
            shown = [*(along * flight / SPEED), *flight, *t.targets[lane], *([] if wanted is None else wanted)]
            np.testing.assert_allclose(step.obs[lane], shown, atol=1e-12)
        assert step.reward[lane] == pytest.approx(gained, rel=1e-9)
    np.testing.assert_array_equal(step.hit, hits)
    assert (0 < sum(hits) < count / 2) == ("speed" not in asked or asked["speed"] < SPEED)
    farthest = t.rollout.model.reach + math.sqrt(2) * 1.4
    most = 0.15 * math.hypot(0 if asked == {"speed": 2.5} else 1 / math.sin(0.1), 1 if "speed" in asked else 0)
    assert t.penalty == pytest.approx(math.hypot(farthest, most))


def test_a_cheap_strike_that_is_too_slow_is_no_hit():
    """Half of the speed asked for costs half a hit radius: within it, and yet no hit."""
    t = task(arrival=ArrivalRule(speed=2 * SPEED), hit_radius=0.1)
    t.reset(np.array([[1.0, 0.0]]))
    step = t.step(np.array([[0.0, 0, 0, 0, 1]]))
    assert step.judged.distance[0] < 1e-12
    assert step.judged.cost[0] == pytest.approx(0.05)
    assert (step.hit[0], step.reward[0]) == (False, pytest.approx(-0.25))
    assert task(arrival=ArrivalRule(speed=2 * SPEED), reward="log").reward(step.judged.cost, step.hit) == pytest.approx(
        -math.log(0.05 / 0.06)
    )


def test_arrivals_in_space_are_seen_from_the_base():
    """A flight straight at a target moves along the line of sight: it hits, and arrives along no angle."""
    region = GoalRegion(BALL, ArrivalRule(angle=(-math.pi, math.pi)), 0.1)
    t = StrikeTask(StraightFlightInSpace(), region, bounds=IN_SPACE)
    assert t.n_obs == 12
    target = np.array([[1.0, 0.0, 0.05]])
    for angle, hit in ((0.0, False), (math.pi, True)):
        seen = t.reset(t.arrival.goals_at(target, 0.1, np.array([angle])))
        up = np.array([-0.05, 0.0, 1.0]) / math.hypot(1.0, 0.05)
        np.testing.assert_allclose(seen[0, 9:], math.cos(angle) * up, atol=1e-12)
        step = t.step(np.zeros((1, 9)))  # ahead, below the line of sight: as seen from the base it moves down
        assert step.judged.distance[0] == pytest.approx(0.05)
        assert step.hit[0] == hit
        np.testing.assert_allclose(t.normalise(step.obs)[:, 9:], step.obs[:, 9:])


def test_lanes_of_goals_are_renewed_and_kept():
    t = task(arrival=ArrivalRule(angle=(0.0, 1.0)), strikes=5)
    goals = t.draw(np.random.default_rng(0).random((4, 4)))
    t.reset(goals)
    before = t.step(np.zeros((4, 5))).obs
    lanes, new = np.array([False, True, False, True]), t.draw(np.random.default_rng(1).random((2, 4)))
    after = t.renew(before, lanes, new)
    np.testing.assert_array_equal(after[~lanes], before[~lanes])
    np.testing.assert_array_equal(after[lanes], t.first_look(new))
    np.testing.assert_array_equal(t.goals.directions[lanes], new.directions)
    np.testing.assert_array_equal(goals.rows(lanes).positions, goals.positions[lanes])
    t.keep(lanes)
    assert (len(t.targets), t.counts.tolist()) == (2, [0, 0])
    with pytest.raises(InputError, match="arrival angles: got nothing"):
        t.reset(np.array([[1.0, 0.2]]))
    with pytest.raises(InputError, match="direction: got"):
        task(arrival=ArrivalRule(direction=(1.0, 0.0, 0.0)))


@pytest.mark.parametrize("observation", ["tip", "relative"])
def test_observations_that_show_no_target_show_no_direction(observation):
    t, plain = task(observation=observation, arrival=ArrivalRule(angle=0.2)), task(observation=observation)
    targets = np.array([[1.0, 0.1]])
    np.testing.assert_array_equal(t.reset(targets), plain.reset(targets))
    assert t.n_obs == plain.n_obs == 4


class Steep:
    """Peaks are beyond by the first angle less 0.3; whole strikes that hit, by what is said."""

    judges, by_peaks, command, positions, smooth = "motor", True, None, np.array([[-0.4, 0], [0.5, 1]]), ()

    def __init__(self, of_hits: float | None = None) -> None:
        self.of_candidates, self.of_hits, self.looked_at = of_hits is not None, of_hits, 0

    def violation_of_peaks(self, near):
        return near.max_joint_speed[:, 0] - 0.3

    def violation(self, trajectory):
        self.looked_at += 1
        return self.of_hits


class Following(StraightFlight):
    def trajectory(self, strike, *, t_stay):
        return strike


def test_strikes_beyond_the_limits_are_refused_as_an_objective_refuses_them():
    t, o = (
        StrikeTask(StraightFlight(), ZONE, bounds=BOUNDS, limits=Steep()),
        Objective(StraightFlight(), (1.2, 0.0), bounds=BOUNDS, limits=Steep()),
    )
    assert (t.bounds.lower[0], t.bounds.upper[0]) == (o.bounds.lower[0], o.bounds.upper[0]) == (-0.4, 0.5)
    strikes = np.array([[0.05, 0, 0.2, 0.3, 0.7], [0.4, 0, 0.2, 0.3, 0.7], [0.2, 0.95, 0.2, 0.3, 0.7]])
    goals = t.as_goals(np.tile((1.2, 0.0), (3, 1)))
    judged, outcomes = t.judge(strikes, goals), o.batch(strikes)
    assert judged.refused.tolist() == [outcome.refused or "" for outcome in outcomes] == ["", "motor", ""]
    assert judged.diverged.tolist() == [outcome.diverged for outcome in outcomes] == [False, False, True]
    assert judged.lost.tolist() == [False, True, True]
    assert judged.distance[:2] / [1, t.penalty] == pytest.approx(
        [outcomes[0].miss_distance, outcomes[1].miss_distance / o.penalty]
    )
    assert judged.cost.tolist() == judged.distance.tolist()
    assert t.reward(judged.cost, judged.hit)[1] == pytest.approx(-10 * t.penalty * (2 - 1 / 1.1))
    np.testing.assert_allclose(t.look(judged, goals)[1:], t.first_look(goals)[1:])  # no such strike was made


def test_of_strikes_that_hit_the_whole_is_judged():
    strikes = np.array([[0.02, 0, 0.2, 0.3, 0.7], [0.2, 0, 0.2, 0.3, 0.7]])
    for beyond, expected in ((-1.0, [True, False]), (1.0, [False, False])):
        limits = Steep(of_hits=beyond)
        t = StrikeTask(Following(), ZONE, bounds=BOUNDS, limits=limits)
        judged = t.judge(strikes, t.as_goals(np.tile((1.2, 0.0), (2, 1))))
        assert limits.looked_at == 1
        assert judged.hit.tolist() == expected
        assert judged.refused.tolist() == [["", "motor"][beyond > 0], ""]


class InSpace(StraightFlightInSpace):
    model = preset("ur5e")


def test_a_robot_s_strikes_are_commanded_no_faster_than_its_joints_may():
    actions = np.random.default_rng(0).uniform(-1, 1, (100, 13))
    kept, free = (StrikeTask(InSpace(), limits=limits).to_strikes(actions) for limits in ("default", None))
    shortened = ArmLimits.of(preset("ur5e").arm).command.shortened
    np.testing.assert_allclose(shortened(kept), kept)
    assert (np.abs(shortened(free) - free).max(axis=1) > 0.1).mean() > 0.5
