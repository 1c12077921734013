"""The engines in space: against each other and the reference, and exact derivatives against differences."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from random_space import random_arm, random_whip
from rich_model import COMPUTED, EVERY_RUNG
from slopes import compare

from whiptool.errors import InputError
from whiptool.impedance.controller import Controller
from whiptool.impedance.laws import OIAC, ConstantImpedance
from whiptool.models.kinematics import chain_motion
from whiptool.models.parameters import Model, in_space
from whiptool.models.presets import preset
from whiptool.models.strike import default_bounds
from whiptool.rollout.compiled import CompiledRollout
from whiptool.rollout.engine import RUNGS, find_engine
from whiptool.rollout.reference import ReferenceRollout

RNG = np.random.default_rng(8)
A, N = 3, 4
MODEL = Model(random_whip(RNG, N, forces=True), random_arm(RNG, A, prismatic=1))
TARGETS = RNG.uniform(-0.6, 0.6, (48, 3))
STRIKES = np.c_[RNG.uniform(-0.8, 0.8, (48, 2 * A)), RNG.uniform(0.4, 0.8, 48)]
ROOT = RNG.normal(0, 2, (A, A))
STIFF = ROOT @ ROOT.T + 5 * np.eye(A)
CONSTANT = Controller(ConstantImpedance(K=tuple(map(tuple, STIFF)), B=tuple(map(tuple, 0.2 * STIFF))))


@pytest.mark.slow
def test_all_engines_agree_on_mixed_batches_in_space():
    names = (
        "gravity",
        "arm.mass[0]",
        "arm.com[1].y",
        "arm.inertia[2].xy",
        "arm.position[2].z",
        "whip.m[2]",
        "whip.k[1]",
    )
    rng = np.random.default_rng(1)
    models = [
        MODEL.with_parameters({x: MODEL.parameters()[x] * rng.uniform(0.95, 1.05) for x in names}) for _ in range(6)
    ]
    controllers = [replace(CONSTANT, compensated=tuple(rng.uniform(0.5, 2, A + 1))) for _ in range(4)]
    of = {"models": [models[i % 6] for i in range(48)], "controllers": [controllers[i % 4] for i in range(48)]}
    results = {}
    for name in RUNGS:
        rollout = CompiledRollout(models[0], controllers[0], timestep=1e-3, engine=name)
        results[name] = rollout.approach(STRIKES, TARGETS, t_stay=0.2, **of)
    assert not results["simd"].diverged.any()
    for name, near in results.items():
        assert near.tip.shape == near.velocity.shape == (48, 3)
        assert np.abs(near.distance - results["simd"].distance).max() < 1e-9, name
        np.testing.assert_allclose(near.tip, results["simd"].tip, atol=1e-7)
        np.testing.assert_allclose(near.max_torque, results["simd"].max_torque, rtol=1e-7)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["simd", "scalar"])
def test_a_diverging_lane_leaves_the_others_bit_identical(name: str):
    wild = Controller(ConstantImpedance(K=tuple(map(tuple, 1e7 * np.eye(A))), B=tuple(map(tuple, np.zeros((A, A))))))
    rollout = CompiledRollout(MODEL, CONSTANT, timestep=1e-3, engine=name)
    strikes = STRIKES[:24].copy()
    strikes[:, -1] = 0.5  # one order, whatever the controllers
    alone = rollout.approach(strikes, TARGETS[:24], t_stay=0.2)
    controllers = [wild if i in (2, 11, 17) else CONSTANT for i in range(24)]
    together = rollout.approach(strikes, TARGETS[:24], t_stay=0.2, controllers=controllers)
    assert np.flatnonzero(together.diverged).tolist() == [2, 11, 17]
    others = ~together.diverged
    for field in COMPUTED:
        np.testing.assert_array_equal(getattr(together, field)[others], getattr(alone, field)[others])


@pytest.mark.slow
@pytest.mark.parametrize(
    "law",
    [
        pytest.param("constant", marks=pytest.mark.slow),
        pytest.param("oiac", marks=pytest.mark.slow),
        pytest.param("held", marks=pytest.mark.slow),
    ],
)
def test_the_reference_makes_the_same_strike(law: str):
    """MuJoCo, Pinocchio and NumPy, without friction and drag and with them."""
    controllers = {
        "constant": replace(CONSTANT, torque_limit=30.0),
        "oiac": Controller(OIAC(a=0.2)),
        "held": replace(CONSTANT, control_period=0.002),
    }
    compiled = CompiledRollout(MODEL, controllers[law], timestep=1e-4)
    reference = ReferenceRollout(MODEL, controllers[law], timestep=1e-4, integrator="RK4")
    ours, its = (x.trajectory(STRIKES[0], t_stay=0.1) for x in (compiled, reference))
    assert not its.diverged
    assert np.ptp(its.tip, axis=0).min() > 0.05  # it moves in all three directions
    assert np.abs(ours.tip - its.tip).max() < 3e-5
    assert np.abs(ours.q - its.q).max() < 3e-3
    np.testing.assert_allclose(ours.tau, its.tau, atol=3e-3 * np.abs(its.tau).max())
    miss = [x.approach(STRIKES[:1], TARGETS[0], t_stay=0.1).distance[0] for x in (compiled, reference)]
    assert miss[0] == pytest.approx(miss[1], abs=3e-5)
    assert miss[0] == pytest.approx(ours.approach(TARGETS[0]).distance[0], abs=1e-12)


def test_a_planar_strike_is_the_same_in_space():
    planar = preset("lemon2024")
    space = replace(planar, arm=in_space(planar.arm), whip=replace(planar.whip, joints="universal"))
    controller = Controller(ConstantImpedance(), feedforward=True)
    strikes = default_bounds(planar.arm).sample(np.random.default_rng(2), 16)
    flat = CompiledRollout(planar, controller, timestep=1e-3).approach(strikes, [1.0, 0.3])
    spatial = CompiledRollout(space, controller, timestep=1e-3).approach(strikes, [1.0, 0.0, 0.3])
    np.testing.assert_allclose(spatial.distance, flat.distance, rtol=0, atol=1e-10)
    np.testing.assert_allclose(spatial.max_torque, flat.max_torque, rtol=1e-9)
    assert np.abs(spatial.tip[:, 1]).max() < 1e-14


def moved(rollout: CompiledRollout, name: str, by: float) -> CompiledRollout:
    """The same rollout, one number of its model or controller changed."""
    model, controller = rollout.model, rollout.controller
    if name in model.parameters():
        model = model.with_parameters({name: model.parameters()[name] + by})
    else:
        law = controller.law
        block, _, index = name.removeprefix("law.").partition("[")
        numbers = {x: np.array(y, float) for x, y in law.parameters().items()}
        numbers[block][int(index[:-1]) if index else 0] += by
        controller = replace(controller, law=law.changed(numbers))
    return CompiledRollout(model, controller, timestep=rollout.timestep, free=rollout.free)


@pytest.mark.slow
@pytest.mark.parametrize("law", ["constant", "oiac"])
def test_derivatives_against_central_differences(law: str):
    """By numbers of strike, whip, arm and controller; kinks, where the differences do not hold still, are few."""
    controller = CONSTANT if law == "constant" else Controller(OIAC(a=0.05), feedforward=True)
    rollout = CompiledRollout(MODEL, controller, timestep=1e-3)
    strikes = STRIKES[:16]
    of_strike = ["q_1i", "q_2i", "q_3i", "q_1f", "q_2f", "q_3f"]
    names = [*of_strike, "gravity", "whip.l[0]", "whip.m[3]", "whip.k[2]", "whip.b[1]", "whip.drag[3]"]
    names += ["whip.drag_ratio", "whip.dry_friction[1]", "whip.cubic_stiffness[2]", "whip.node_inertia[0]"]
    names += ["whip.hinge_mass", "whip.friction_velocity", "arm.mass[1]", "arm.com[0].x", "arm.com[2].z"]
    names += ["arm.inertia[0].xx", "arm.inertia[2].yz", "arm.position[1].y", "arm.hand_position.x"]
    names += ["arm.friction[1]", "arm.armature[2]", *(["law.K[1]", "law.B[4]"] if law == "constant" else ["law.a"])]
    model_numbers = MODEL.parameters() | controller.parameters()
    near, slopes = rollout.gradient(strikes, TARGETS[:16], t_stay=0.2, names=names)
    np.testing.assert_allclose(near.distance, rollout.approach(strikes, TARGETS[:16], t_stay=0.2).distance, atol=1e-10)
    numbers = model_numbers | dict.fromkeys(of_strike, 1.0)
    compared = []
    for slope, name in zip(slopes.T, names, strict=True):

        def distance(by: float, name: str = name) -> np.ndarray:
            shifted, other = strikes.copy(), rollout
            if name in of_strike:
                shifted[:, of_strike.index(name)] += by
            else:
                other = moved(rollout, name, by)
            return other.approach(shifted, TARGETS[:16], t_stay=0.2).distance

        wrong, still = compare(slope, distance, 3e-5 * max(0.03, abs(numbers[name])))
        assert not wrong.any(), name
        assert np.abs(slope).max() > 1e-9, name  # every number matters
        compared.append(still.mean())
    assert np.mean(compared) > 0.9


@pytest.mark.slow
def test_a_number_that_is_zero_can_be_freed():
    arm = MODEL.arm.with_parameters({"com[0].x": 0.0, "armature[1]": 0.0})
    model, names = replace(MODEL, arm=arm), ["arm.com[0].x", "arm.armature[1]"]
    with pytest.raises(InputError, match="free"):
        CompiledRollout(model, CONSTANT).gradient(STRIKES[:1], TARGETS[0], names=names)
    rollout = CompiledRollout(model, CONSTANT, timestep=1e-3, free=names)
    slopes = rollout.gradient(STRIKES[:4], TARGETS[:4], t_stay=0.2, names=names)[1]
    for k, name in enumerate(names):
        sides = [
            CompiledRollout(model.with_parameters({name: h}), CONSTANT, timestep=1e-3, free=names)
            .approach(STRIKES[:4], TARGETS[:4], t_stay=0.2)
            .distance
            for h in (0.0, 1e-7)
        ]
        np.testing.assert_allclose(slopes[:, k], (sides[1] - sides[0]) / 1e-7, rtol=2e-3, atol=1e-6)


@pytest.mark.parametrize("name", EVERY_RUNG)
def test_tip_paths_in_space_and_their_derivatives(name: str):
    rollout = CompiledRollout(MODEL, CONSTANT, timestep=1e-3, engine=name)
    times, path, slopes = rollout.tip_path(STRIKES[:2], t_stay=0.2, rate=50.0, names=["q_1f", "D"])
    assert path.shape == (2, len(times), 3)
    fine = rollout.trajectory(STRIKES[1], t_stay=0.2)
    inside = times <= fine.t[-1]
    exact = np.stack([np.interp(times[inside], fine.t, fine.tip[:, c]) for c in range(3)], axis=1)
    np.testing.assert_allclose(path[1][inside], exact, atol=1e-3)
    for k, column in ((0, 3), (1, 6)):
        sides = []
        for sign in (1, -1):
            shifted = STRIKES[:2].copy()
            shifted[:, column] += sign * 1e-6
            sides.append(rollout.tip_path(shifted, t_stay=0.2, rate=50.0)[1])
        difference = (sides[0] - sides[1])[:, : path.shape[1]] / 2e-6
        ok = np.isfinite(difference) & np.isfinite(slopes[..., k])
        np.testing.assert_allclose(
            slopes[..., k][ok], difference[ok], rtol=1e-4, atol=2e-5 * np.abs(difference[ok]).max()
        )


def test_targets_of_another_dimension_are_refused():
    with pytest.raises(InputError, match="in space"):
        CompiledRollout(MODEL, CONSTANT).approach(STRIKES[:1], [1.0, 0.0])
    with pytest.raises(InputError, match="in the plane"):
        CompiledRollout(preset("lemon2024"), Controller()).approach(np.ones((1, 5)), [1.0, 0.0, 0.0])


@pytest.mark.parametrize("name", RUNGS)
def test_every_engine_observes_the_places_of_joints_and_nodes(name: str):
    rollout = CompiledRollout(MODEL, CONSTANT, timestep=1e-3, engine=name)
    batch = rollout._batch(STRIKES[:3], TARGETS[:3], 0.1)
    batch.with_rows, batch.columns, batch.stride = True, np.arange(3 * (A + N)), 7
    rolled = find_engine(rollout.structure, forward=False, rung=name)(batch)
    n = MODEL.n
    assert rolled.rows is not None
    assert rolled.first_row is not None
    for seen, first, steps in zip(rolled.observed()[0], rolled.first_row, batch.steps, strict=True):
        rows = rolled.rows[first : first + steps + 1 : 7]
        places, _ = chain_motion(MODEL, rows[:, 1 : 1 + n])  # the first joint's is not among the links' ends
        np.testing.assert_allclose(seen.reshape(len(seen), -1, 3), places[:, 1:], atol=1e-12)
