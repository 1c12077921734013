"""Steps that are chosen by their errors: distances within the tolerance, or marked."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from rich_model import EVERY_RUNG, LEMON

from whiptool.dynamics.integrator import W_A, W_B, W_GAMMA, W_SECOND, W_STIFF
from whiptool.dynamics.structure import outcome_columns
from whiptool.errors import InputError
from whiptool.goals.goals import Goals
from whiptool.impedance import ConstantImpedance, Controller, PositionControl, constant_preset, oiac_preset
from whiptool.models.presets import preset
from whiptool.models.strike import default_bounds
from whiptool.models.trajectory import Approach
from whiptool.rollout.batch import resolve
from whiptool.rollout.compiled import CompiledRollout
from whiptool.rollout.reference import ReferenceRollout

OIAC = Controller(oiac_preset("table4"))
ROBOT = preset("ur5e")
ROPE = dataclasses.replace(ROBOT, whip=dataclasses.replace(ROBOT.whip, joints="rod", node_inertia=0.0))
CASES = {
    "plane": (LEMON, OIAC, (1.2, 0.1)),
    "held": (LEMON, Controller(control_period=2e-4), (1.2, 0.1)),
    "rods": (ROPE, Controller(PositionControl()), (1.2, 0.3, 0.5)),
    "person": (preset("nah2023"), Controller(constant_preset("nah2023")), (1.995, 0.0, 0.0)),
    "rods under impedance": (ROPE, Controller(constant_preset("ur5e")), (1.2, 0.3, 0.5)),
}
SLOW = {"person", "rods under impedance", "held"}
EVERY = [pytest.param(*case, id=name, marks=[pytest.mark.slow] * (name in SLOW)) for name, case in CASES.items()]


def strikes_of(model, count: int) -> np.ndarray:
    return default_bounds(model.arm).sample(np.random.default_rng(3), count)


def test_the_method_of_third_order_keeps_its_order_for_any_matrix():
    """Order conditions of W methods (Hairer and Wanner II, Sect. IV.7), with A, b and Gamma, and those of its error."""
    A, b, second = (np.array(x) for x in (W_A, W_B, W_SECOND))
    G, c = np.array(W_STIFF) + W_GAMMA * np.eye(4), A.sum(axis=1)
    g = G.sum(axis=1)
    for weights, third in ((b, True), (second, False)):
        assert weights.sum() == pytest.approx(1, abs=1e-12)
        assert weights @ c == pytest.approx(1 / 2, abs=1e-12)
        assert weights @ g == pytest.approx(0, abs=1e-12)
        assert (weights @ c**2 == pytest.approx(1 / 3, abs=1e-12)) == third
    assert b @ A @ c == pytest.approx(1 / 6, abs=1e-12)
    for product in (b @ A @ g, b @ G @ c, b @ G @ g):
        assert product == pytest.approx(0, abs=1e-12)
    assert b @ (c * g) == pytest.approx(0, abs=1e-12)  # of a matrix that changes with the stage


@pytest.mark.parametrize(("model", "controller", "target"), EVERY)
def test_distances_are_within_the_tolerance(model, controller, target):
    strikes = strikes_of(model, 24)
    usual = CompiledRollout(model, controller).approach(strikes, target)
    exact = CompiledRollout(model, controller, tolerance=1e-6).approach(strikes, target)
    known = ~exact.diverged  # some do under a torque that is held
    assert np.isfinite(exact.integration_error[known]).all()
    assert np.isinf(usual.integration_error[exact.diverged]).all()
    error, estimate = (x[known] for x in (np.abs(usual.distance - exact.distance), usual.integration_error))
    assert (error[np.isfinite(estimate)] < 2e-4).all()
    assert np.percentile(error, 90) < 1e-4
    assert np.median(error - estimate) <= 1e-9
    np.testing.assert_allclose(usual.max_torque[known], exact.max_torque[known], rtol=0.05, atol=0.05)


@pytest.mark.slow
def test_gains_that_grow_with_the_error_are_integrated_to_third_order():
    """Against equal steps of another method of second order, extrapolated to none."""
    model, strikes = preset("nah2020-n15"), [[-1.4, 0.32, 3.084, 2.662, 0.654], [-0.65, 0.353, 3.109, 2.263, 0.557]]
    coarse, fine = (
        CompiledRollout(model, OIAC, timestep=h).approach(strikes, (1.3, 0.0)).distance for h in (1e-5, 5e-6)
    )
    exact = fine + (fine - coarse) / 3
    usual, precise = (CompiledRollout(model, OIAC, tolerance=x).approach(strikes, (1.3, 0.0)) for x in (1e-4, 1e-6))
    assert (precise.integration_error <= 1e-6).all()
    np.testing.assert_allclose(precise.distance, exact, atol=4e-6)
    np.testing.assert_allclose(usual.distance, exact, atol=1e-4)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "count"), [("plane", 3), ("rods", 1)])
def test_mujoco_comes_as_near(name, count):
    model, controller, target = CASES[name]
    strikes = strikes_of(model, count)
    ours, its = (r(model, controller).approach(strikes, target) for r in (CompiledRollout, ReferenceRollout))
    np.testing.assert_allclose(ours.distance, its.distance, atol=2e-4)


@pytest.mark.parametrize("engine", EVERY_RUNG)
def test_every_engine_keeps_the_tolerance(engine):
    strikes = strikes_of(LEMON, 6)
    near = CompiledRollout(LEMON, OIAC, engine=engine).approach(strikes, (1.2, 0.1))
    exact = CompiledRollout(LEMON, OIAC, tolerance=1e-7).approach(strikes, (1.2, 0.1))
    np.testing.assert_allclose(near.distance, exact.distance, atol=2e-4)
    assert (near.integration_error <= 1e-4).all()


def test_a_strike_is_the_same_to_the_bit_in_any_batch():
    strikes, rng = strikes_of(LEMON, 60), np.random.default_rng(0)
    rollout = CompiledRollout(LEMON, OIAC)
    whole = rollout.approach(strikes, (1.2, 0.1))
    order = rng.permutation(60)
    shuffled = CompiledRollout(LEMON, OIAC, threads=1).approach(strikes[order], (1.2, 0.1))
    alone = [rollout.approach(strikes[i], (1.2, 0.1)) for i in range(5)]
    for name in ("distance", "integration_error", "tip", "velocity", "max_torque", "effort"):
        np.testing.assert_array_equal(getattr(shuffled, name), getattr(whole, name)[order])
        np.testing.assert_array_equal(np.concatenate([getattr(x, name) for x in alone]), getattr(whole, name)[:5])


@pytest.mark.slow
@pytest.mark.parametrize(("model", "controller", "target"), EVERY[:3])
def test_derivatives_are_those_of_differences(model, controller, target):
    strikes, h = strikes_of(model, 2), 1e-6
    rollout = CompiledRollout(model, controller, tolerance=1e-8)
    _, slopes = rollout.gradient(strikes, target)
    for j in (0, strikes.shape[1] // 2, strikes.shape[1] - 1):
        moved = h * np.eye(strikes.shape[1])[j]
        after, before = (rollout.approach(strikes + side * moved, target).distance for side in (1, -1))
        np.testing.assert_allclose(slopes[:, j], (after - before) / (2 * h), atol=1e-5)
    _, usual = CompiledRollout(model, controller).gradient(strikes, target)
    np.testing.assert_allclose(usual, slopes, atol=1e-3)


def test_place_and_velocity_have_the_derivatives_of_differences():
    strikes, target, h = strikes_of(LEMON, 2), (1.2, 0.1), 1e-6
    rollout = CompiledRollout(LEMON, OIAC, tolerance=1e-8)
    _, slopes = rollout.slopes(strikes, target)
    for j in (0, 4):
        moved = h * np.eye(5)[j]
        after, before = (rollout.approach(strikes + side * moved, target) for side in (1, -1))
        np.testing.assert_allclose(slopes.tip[:, :, j], (after.tip - before.tip) / (2 * h), atol=1e-4, rtol=1e-4)
        change = (after.velocity - before.velocity) / (2 * h)
        np.testing.assert_allclose(slopes.velocity[:, :, j], change, atol=1e-2, rtol=1e-3)


def test_a_path_passes_its_closest_approach():
    strike, rollout = strikes_of(LEMON, 1), CompiledRollout(LEMON, OIAC)
    near = rollout.approach(strike, (1.2, 0.1))
    t, path, _ = rollout.tip_path(strike, rate=1e4)
    distances = np.linalg.norm(path[0] - (1.2, 0.1), axis=1)
    assert np.nanmin(distances) == pytest.approx(near.distance[0], abs=1e-4)
    assert t[np.nanargmin(distances)] == pytest.approx(near.time[0], abs=1e-3)
    trajectory = rollout.trajectory(strike)
    assert np.ptp(np.diff(trajectory.t)) < 1e-9  # instants are equally far apart, whatever the steps
    assert trajectory.approach((1.2, 0.1)).distance[0] == pytest.approx(near.distance[0], abs=1e-4)


def test_what_no_tolerance_resolves_is_marked_and_no_hit():
    """A strike that diverges, and one whose rollouts do not agree however fine the steps are."""
    columns = outcome_columns(LEMON.arm.n, 2)
    rng = np.random.default_rng(1)

    def roll(which: np.ndarray, tolerances: np.ndarray) -> np.ndarray:
        out = np.zeros((len(which), columns.width))
        distance = columns["distance"].start
        out[:, distance] = 0.01 + np.where(which == 0, 0.1 * tolerances, rng.uniform(size=len(which)))
        out[which == 2, columns["diverged"].start] = 1
        return out

    found = resolve(roll, 3, 1e-4, columns)
    assert found.error[0] == pytest.approx(0.27 * 7e-6, rel=1e-6)
    assert np.isinf(found.error[1:]).all()
    place = np.zeros((3, 2))
    near = Approach(
        found.out[:, columns["distance"].start], np.zeros(3), place + 1, place, place, place, np.zeros(3, bool)
    )
    goals = Goals(place, 2.0)
    assert goals.hit_by(near).all()
    assert goals.hit_by(dataclasses.replace(near, integration_error=found.error)).tolist() == [True, False, False]


def test_a_hit_by_less_than_the_error_is_none():
    one, place = np.array([0.01]), np.zeros((1, 2))
    near = Approach(one, one, place + 1, place, place, place, np.zeros(1, bool), integration_error=np.array([2e-4]))
    assert not Goals(place, 0.0101).hit_by(near)[0]
    assert Goals(place, 0.0103).hit_by(near)[0]


def test_a_spring_far_too_stiff_for_equal_steps_is_resolved():
    stiff = Controller(ConstantImpedance(K=((1e5, 0), (0, 1e5)), B=((0, 0), (0, 0))))
    strikes = strikes_of(LEMON, 2)
    assert CompiledRollout(LEMON, stiff, timestep=1e-3).approach(strikes, (1.2, 0.1)).diverged.all()
    near, exact = (CompiledRollout(LEMON, stiff, tolerance=x).approach(strikes, (1.2, 0.1)) for x in (1e-4, 1e-6))
    np.testing.assert_allclose(near.distance, exact.distance, atol=1e-4)


def test_tolerances_are_checked():
    for wrong in (0.0, -1.0, 1.0, float("nan")):
        with pytest.raises(InputError, match=r"^tolerance: got"):
            CompiledRollout(LEMON, OIAC, tolerance=wrong)
    with pytest.raises(InputError, match=r"^tolerance and timestep: got"):
        CompiledRollout(LEMON, OIAC, tolerance=1e-4, timestep=1e-3)
    assert CompiledRollout(LEMON, OIAC).tolerance == 1e-4
