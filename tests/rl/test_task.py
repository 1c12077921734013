"""The learners' task on a tip that flies straight: rewards, observations, penalties, counts."""

from __future__ import annotations

import math

import numpy as np
import pytest
from fake_rollout import SPEED, StraightFlight

from whiptool.models.strike import StrikeBounds
from whiptool.rl.task import StrikeTask, log_reward, reward
from whiptool.zone import Disc

BOUNDS = StrikeBounds((-0.5, 0.0, 0.1, 0.2, 0.4), (0.5, 1.0, 0.3, 0.8, 1.0))
ZONE = Disc((1.0, 0.2), 0.4)


def task(**options) -> StrikeTask:
    return StrikeTask(StraightFlight(), ZONE, bounds=BOUNDS, **options)  # type: ignore[arg-type]


def test_the_reward_of_eq_17():
    above = math.nextafter
    distances = np.array([0.0, 0.06, above(0.06, 1), 0.1, above(0.1, 1), 1.0])
    assert reward(distances, 0.06) == pytest.approx([50, 50, -0.3, -0.5, -1.0, -10])
    assert reward(np.array([0.01, 0.02]), 0.01) == pytest.approx([50, -0.1])


def test_the_logarithmic_reward():
    assert log_reward(np.array([0.06, 0.12, 0.018, 0.001]), 0.06) == pytest.approx(
        [0, -math.log(2), -math.log(0.3), -math.log(0.3)]
    )
    assert task(reward="log", hit_radius=0.1).reward(np.array([0.2])) == pytest.approx([-math.log(2)])


def test_actions_cover_the_box():
    t = task()
    actions = np.array([[-1, -1, -1, -1, -1], [1, 1, 1, 1, 1], [0, 0, 0, 0, 0], [-3, 3, 0.5, -0.5, 1]], float)
    expected = [BOUNDS.lower, BOUNDS.upper, (0, 0.5, 0.2, 0.5, 0.7), (-0.5, 1, 0.25, 0.35, 1)]
    np.testing.assert_allclose(t.to_strikes(actions), expected, atol=1e-15)


@pytest.mark.parametrize("observation", ["paper", "relative", "goal"])
def test_a_step_on_a_straight_flight(observation):
    t = task(observation=observation, strikes=2, hit_radius=0.1)
    targets = np.array([[1.0, 0.0], [1.0, 0.3], [0.9, 0.2]])
    first = t.reset(targets)
    rest = t.resting_tip
    assert rest[0] == pytest.approx(0, abs=1e-12)
    assert rest[1] == pytest.approx(-t.rollout.model.reach)
    shown = {
        "paper": np.hstack([np.tile(rest, (3, 1)), np.zeros((3, 2))]),
        "relative": np.hstack([rest - targets, np.zeros((3, 2))]),
        "goal": np.hstack([np.tile(rest, (3, 1)), np.zeros((3, 2)), targets]),
    }[observation]
    np.testing.assert_allclose(first, shown, atol=1e-12)
    actions = np.array([[0.0, 0, 0, 0, 1], [0.0, 0, 0, 0, 1], [0.0, 1, 0, 0, 1]])  # straight ahead; the last diverges
    step = t.step(actions)
    tips, velocity = np.array([[1.0, 0], [1.0, 0]]), np.array([[SPEED, 0], [SPEED, 0]])
    seen = {
        "paper": np.hstack([tips, velocity]),
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
        "paper": np.hstack([where, [[0.5, -2]]]),
        "relative": np.hstack([obs[:, :2] / size, [[0.5, -2]]]),
        "goal": np.hstack([where, [[0.5, -2]], (obs[:, 4:] - centre) / half]),
    }
    for observation, wanted in expected.items():
        t = StrikeTask(StraightFlight(), zone, observation=observation, bounds=BOUNDS)  # type: ignore[arg-type]
        np.testing.assert_allclose(t.normalise(obs[:, : t.n_obs]), wanted)
        assert (t.n_obs, t.n_act) == (wanted.shape[1], 5)
