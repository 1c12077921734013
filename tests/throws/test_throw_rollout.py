"""Throws of whole models: derivatives against differences, trajectories, searches, and MuJoCo."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from whiptool.errors import InputError
from whiptool.models import preset
from whiptool.objective import Objective
from whiptool.optimizers import search
from whiptool.throws.box import Box
from whiptool.throws.flight import Thing
from whiptool.throws.mujoco_throw import MujocoThrow, replay_throw
from whiptool.throws.release import FARTHEST
from whiptool.throws.rollout import ThrowRollout

LEMON = preset("lemon2024")
BOX, BALL = Box((1.8, -0.5), 0.08), Thing.of_ball(0.02, 0.04)
STRIKE = np.array([-0.9, 1.4, 1.7, 1.4, 0.95])  # its thing lands in the box
FAR, AWAY = np.array([-0.6, 0.6, 1.2, 0.7, 1.1007]), Box((3.2, -0.2), 0.08)  # its thing does not reach this one


@pytest.fixture(scope="module")
def throws() -> ThrowRollout:
    return ThrowRollout(LEMON, BOX, thing=BALL)


def differences(landed: Callable[[np.ndarray], np.ndarray], at: np.ndarray, size: float) -> np.ndarray:
    """Return differences of the fourth order of quantities (B, K) of B rows of numbers, (K, m), about one row (m,)."""
    m = len(at)
    found = landed(at + size * np.kron([[2], [1], [-1], [-2]], np.eye(m))).reshape(4, m, -1)
    return (np.tensordot([-1, 8, -8, 1], found, axes=1) / (12 * size)).T


def landing(rollout: ThrowRollout, strikes: np.ndarray) -> np.ndarray:
    near = rollout.approach(strikes, AWAY)
    return np.column_stack([near.distance, near.tip, near.velocity])


@pytest.mark.parametrize("how", [{}, {"release_noise": 0.005}, {"place": "hand"}, {"release_time": 0.8}])
def test_slopes_of_the_landing_are_those_of_differences(how):
    """By the numbers of a strike, with the release that is best for each: it moves, and the landing point with it.

    With equal steps, of which none begins at a sample of the path for such durations, landings are smooth functions.
    """
    rollout = ThrowRollout(LEMON, AWAY, thing=BALL, timestep=5e-4, **how)
    near, slopes = rollout.slopes(FAR, AWAY)
    assert near.distance[0] > 0.2
    found = differences(lambda x: landing(rollout, x), FAR, 1e-5)
    by_miss, by_tip, by_velocity = found[0], found[1:3], found[3:]
    assert rollout.gradient(FAR, AWAY)[1][0] == pytest.approx(by_miss, abs=1e-6)
    assert slopes.distance[0] == pytest.approx(by_miss, abs=1e-6)
    if not rollout.release_noise:  # with noise, tip and slope lie along the nominal miss
        assert np.abs(slopes.tip[0] - by_tip).max() < 1e-5 * np.abs(by_tip).max()
    assert np.abs(slopes.velocity[0] - by_velocity).max() < 3e-5 * np.abs(by_velocity).max()


@pytest.mark.parametrize(("place", "time"), [("tip", 0.8), ("hand", 0.8004), ("tip", None)])
def test_slopes_by_mass_and_release_time(place, time):
    def landed(numbers: np.ndarray) -> np.ndarray:
        things = [(replace(BALL, mass=x[0]), time and x[1]) for x in numbers]
        rollouts = [ThrowRollout(LEMON, AWAY, thing=a, release_time=b, place=place, timestep=5e-4) for a, b in things]
        return np.concatenate([landing(rollout, FAR) for rollout in rollouts])

    names = ["thing.mass", "release_time"][: 1 if time is None else 2]
    rollout = ThrowRollout(LEMON, AWAY, thing=BALL, place=place, release_time=time, timestep=5e-4)
    found = rollout.slopes(FAR, AWAY, names=names)[1]
    expected = differences(landed, np.array([0.02, time or 0.0]), 1e-5)[:, : len(names)]
    assert found.tip[0] == pytest.approx(expected[1:3], rel=1e-5, abs=1e-6)
    with pytest.raises(InputError, match="the best time is taken"):
        ThrowRollout(LEMON, AWAY).slopes(FAR, AWAY, names=["release_time"])


def test_the_trajectory_is_that_of_the_thing(throws):
    path = throws.trajectory(STRIKE)
    near, at = throws.approach(STRIKE, BOX), throws.release_times(STRIKE)[0]
    assert near.distance[0] < BOX.hit_radius
    assert path.release_time == at
    assert path.approach(BOX).distance == near.distance
    held, bare = path.t <= at, throws.rollout.trajectory(STRIKE, t_stay=path.duration - STRIKE[-1])
    assert (path.tip[held] == bare.tip[held]).all()
    flown = (path.t > at) & (path.t < near.time[0])
    rates = np.gradient(path.tip_velocity[flown], path.t[flown], axis=0)[1:-1]
    velocity = path.tip_velocity[flown][1:-1]
    drag = BALL.drag_per_mass * np.linalg.norm(velocity, axis=1, keepdims=True) * velocity
    assert rates == pytest.approx([0, -9.81] - drag, abs=0.02)
    assert path.tip[-1] == pytest.approx(near.tip[0], abs=1e-6)


def test_noisy_releases_of_a_robust_plan_land():
    shares = []
    for noise in (0.0, 0.005):
        rollout = ThrowRollout(LEMON, BOX, thing=BALL, release_noise=noise)
        found = search(Objective(rollout, BOX, max_trials=600, stop_at_hit=True), "gradient", seed=2)
        assert found.hit
        times = rollout.release_times(found.strike)[0] + 0.005 * np.random.default_rng(0).standard_normal(1000)
        shares.append(float(np.mean(np.linalg.norm(rollout.landings(found.strike, times).offset, axis=1) <= 0.08)))
    assert shares[1] >= 0.9


def test_boxes_that_move_are_met_where_they_will_be(throws):
    moving = replace(BOX, position=(1.4, -0.5), velocity=(0.25, 0.0))
    rollout = ThrowRollout(LEMON, moving, thing=BALL, release_time=0.8)
    near = rollout.approach(FAR, moving)
    still = ThrowRollout(LEMON, BOX, thing=BALL, release_time=0.8).approach(FAR, BOX)
    assert near.time == pytest.approx(still.time)
    assert near.tip[0] - [1.4, -0.5] == pytest.approx(still.tip[0] - [1.4 + 0.25 * still.time[0], -0.5])


def test_what_does_not_fit_is_refused():
    with pytest.raises(InputError, match="place of the thing"):
        ThrowRollout(LEMON, BOX, place="elbow")
    with pytest.raises(InputError, match="coordinates"):
        ThrowRollout(preset("fr3"), BOX)


def test_a_strike_with_a_flat_entry_that_strikes_the_rim_is_no_hit():
    """At 87 degrees from the normal a ball of 40 mm strikes the rim of an opening of 200 mm, centred as it may be."""
    strike, box = [-1.3608714, 1.1184118, 2.8878468, 1.5873233, 1.0361695], Box((1.0, -0.5), 0.08)
    rollout = ThrowRollout(LEMON, box, thing=BALL, release_time=1.0658476)
    near = rollout.approach(strike, box)
    assert math.degrees(box.entry_angle(near.velocity[0])) == pytest.approx(87, abs=1)
    assert np.linalg.norm(rollout.landings(strike, [1.0658476]).place) < 1e-3
    assert not box.goals.hit_by(near)[0]
    assert (
        ThrowRollout(LEMON, box, release_time=1.0658476).approach(strike, box).distance[0] > 0.08
    )  # a point: too flat


def test_release_times_that_no_strike_reaches_are_refused(throws):
    with pytest.raises(InputError, match=r"release time.*from 0 to 1.8 s"):
        ThrowRollout(LEMON, BOX, thing=BALL, release_time=99.0).approach(STRIKE, BOX)
    with pytest.raises(InputError, match=r"release times.*the end of the strike"):
        throws.landings(STRIKE, [0.8, 9.0])
    late = ThrowRollout(LEMON, BOX, thing=BALL, release_time=1.5)  # after this strike's end, not after every one's
    assert late.approach(STRIKE, BOX).distance[0] == FARTHEST
    assert late.trajectory(STRIKE).landing is None


@pytest.mark.slow
def test_things_land_where_mujoco_lets_them_fall():
    rollout = ThrowRollout(LEMON, BOX, thing=BALL, release_time=0.85)
    seen = replay_throw(rollout, STRIKE, t_stay=0.7)
    assert seen.confirmed
    assert seen.difference is not None
    assert seen.difference < 1e-3


@pytest.mark.slow
def test_robots_let_things_fall_from_the_hand_as_in_mujoco():
    """A robot's joints are on their reference, whatever the equality pulls at."""
    model, start = preset("fr3"), [0.2, -0.4, 0.1, -2.2, 0.3, 1.9, 0.4]
    strike = np.array([*start, *np.add(start, [0.5, 0.7, 0.0, 0.6, 0.0, 0.4, 0.0]), 0.5])
    rollout = ThrowRollout(model, Box((0.6, 0.6, -0.4), 0.08), thing=BALL, place="hand", release_time=0.3)
    seen = replay_throw(rollout, strike, t_stay=0.1)
    assert seen.confirmed
    assert seen.timestep > 5e-4


def test_mujoco_holds_the_thing_until_its_release():
    rollout = ThrowRollout(LEMON, BOX, thing=BALL, release_time=0.1)
    simulator = MujocoThrow(rollout, 0.1)
    simulator.throw(np.r_[STRIKE[:4], 0.25], until=0.2)
    assert simulator.released == pytest.approx(0.1, abs=1e-9)
