"""Strikes of joints exactly on their reference: engines against each other, MuJoCo, and the limit of stiffness."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from random_space import random_arm, random_whip
from rich_model import COMPUTED
from slopes import compare

from whiptool.impedance import ConstantImpedance, Controller, PositionControl
from whiptool.models import Model, preset
from whiptool.models.strike import Strike
from whiptool.rollout import CompiledRollout, ReferenceRollout
from whiptool.rollout.engine import RUNGS

RNG = np.random.default_rng(8)
A, N = 3, 4
MODEL = Model(random_whip(RNG, N, forces=True), random_arm(RNG, A, prismatic=1))
WHIP = replace(MODEL.whip, k=0.02, b=2e-4, dry_friction=0.0)
LIGHT = replace(MODEL, whip=WHIP)  # not stiff: steps are explicit
RODS = replace(MODEL, whip=replace(WHIP, joints="rod", node_inertia=0.0))
PLANE = preset("lemon2024")
HEAVY_STIFF, HEAVY_RODS, HEAVY_PLANE = (pytest.param(x, marks=pytest.mark.slow) for x in (MODEL, RODS, PLANE))
TARGETS = RNG.uniform(-0.6, 0.6, (24, 3))
STRIKES = np.c_[RNG.uniform(-0.8, 0.8, (24, 2 * A)), RNG.uniform(0.4, 0.8, 24)]
POSITION = Controller(PositionControl())


@pytest.mark.slow
@pytest.mark.parametrize("model", [MODEL, LIGHT, RODS], ids=["stiff", "light", "rod"])
def test_all_engines_agree(model):
    results = {}
    for name in RUNGS:
        rollout = CompiledRollout(model, POSITION, timestep=1e-3, engine=name)
        assert rollout.structure.explicit == (model is not MODEL)
        results[name] = rollout.approach(STRIKES, TARGETS, t_stay=0.2)
    assert not results["simd"].diverged.any()
    for near in results.values():
        np.testing.assert_allclose(near.distance, results["simd"].distance, atol=1e-9)
        np.testing.assert_allclose(near.max_torque, results["simd"].max_torque, rtol=1e-7)
        np.testing.assert_allclose(near.positions, results["simd"].positions, atol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("model", [HEAVY_STIFF, LIGHT, HEAVY_RODS, HEAVY_PLANE], ids=["stiff", "light", "rod", "plane"])
def test_mujoco_makes_the_same_strike_with_the_same_torques(model):
    """MuJoCo's own inertia and forces tell which torques give its joints the reference's accelerations."""
    a = model.arm.n
    strike = Strike.from_vector(np.r_[STRIKES[0][:a], STRIKES[0][A : A + a], 0.5])
    target, timestep = np.zeros(model.dimension), 2e-4 if model.dimension == 3 else 1e-4  # MuJoCo's is explicit
    path = CompiledRollout(model, POSITION, timestep=timestep).trajectory(strike, t_stay=0.1)
    other = ReferenceRollout(model, POSITION, timestep=timestep).trajectory(strike, t_stay=0.1)
    for x in (path, other):
        np.testing.assert_allclose(x.q[:, :a], x.q_d, atol=1e-12)
        np.testing.assert_allclose(x.v[:, :a], x.v_d, atol=1e-11)
        assert not x.K.any()
    assert abs(path.approach(target).distance - other.approach(target).distance) < 2e-6
    np.testing.assert_allclose(path.tip, other.tip, atol=2e-5)
    scale = np.abs(other.tau).max(axis=0)
    assert (np.abs(path.tau - other.tau).max(axis=0) < 0.01 * scale).all()  # the first stage's: of first order


@pytest.mark.slow
@pytest.mark.parametrize("model", [LIGHT, RODS], ids=["universal", "rod"])
def test_it_is_the_limit_of_a_stiff_impedance(model):
    """Ten times as stiff, a tenth of the difference in path and torque."""
    strike, distances = Strike.from_vector(np.r_[STRIKES[1][: 2 * A], 0.8]), []
    path = CompiledRollout(model, POSITION, timestep=1e-4).trajectory(strike, t_stay=0.1)
    for stiffness in (1e4, 1e5):
        K, B = stiffness * np.eye(A), 0.05 * stiffness * np.eye(A)
        law = ConstantImpedance(K=tuple(map(tuple, K)), B=tuple(map(tuple, B)))
        stiff = CompiledRollout(model, Controller(law, feedforward=True), timestep=1e-4)
        distances.append(np.abs(stiff.trajectory(strike, t_stay=0.1).tip - path.tip).max())
    assert distances[1] < 5e-4
    assert distances[1] < 0.2 * distances[0]


@pytest.mark.parametrize(
    ("model", "order"),
    [pytest.param(MODEL, 2, marks=pytest.mark.slow), (LIGHT, 4), pytest.param(RODS, 4, marks=pytest.mark.slow)],
    ids=["stiff", "light", "rod"],
)
def test_the_order_of_errors(model, order):
    """Up to D, where the reference's jerk jumps: a step across that has an error of second order by any method."""

    def ends(h: float) -> np.ndarray:
        paths = CompiledRollout(model, POSITION, timestep=h).trajectories(STRIKES[:8], t_stay=0.0)
        return np.array([path.tip[-1] for path in paths])

    truth = ends(1e-4)
    errors = [np.median(np.abs(ends(h) - truth)) for h in (2e-3, 1e-3)]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(order, abs=0.6)


@pytest.mark.slow
@pytest.mark.parametrize("model", [LIGHT, RODS], ids=["universal", "rod"])
def test_derivatives_against_central_differences(model):
    rollout = CompiledRollout(model, POSITION, timestep=1e-3)
    strikes, compared = STRIKES[12:], []
    _, slopes = rollout.gradient(strikes, TARGETS[12:])
    for column, slope in enumerate(slopes.T[:-1]):

        def distance(by: float, column: int = column) -> np.ndarray:
            shifted = strikes.copy()
            shifted[:, column] += by
            return rollout.approach(shifted, TARGETS[12:]).distance

        wrong, still = compare(slope, distance, 3e-5)
        assert not wrong.any(), column
        compared.append(still.mean())
    assert np.mean(compared) > 0.9


@pytest.mark.parametrize("model", [LIGHT, HEAVY_RODS], ids=["universal", "rod"])
def test_a_diverging_lane_leaves_the_others_bit_identical(model):
    wild = replace(model, whip=replace(model.whip, k=1e6))  # far too stiff for an explicit step
    rollout = CompiledRollout(model, POSITION, timestep=1e-3)
    strikes = STRIKES.copy()
    strikes[:, -1] = 0.5  # one order
    alone = rollout.approach(strikes, TARGETS)
    together = rollout.approach(strikes, TARGETS, models=[wild if i in (2, 11, 17) else model for i in range(24)])
    assert np.flatnonzero(together.diverged).tolist() == [2, 11, 17]
    others = ~together.diverged
    for field in COMPUTED:
        np.testing.assert_array_equal(getattr(together, field)[others], getattr(alone, field)[others])
