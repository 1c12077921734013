"""Control of the hand: torques against Pinocchio's Jacobians, both simulators, engines, closed forms, differences."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from random_space import random_arm, random_whip
from slopes import compare

from whiptool.dynamics.closed_loop import closed_loop
from whiptool.dynamics.structure import Structure
from whiptool.errors import InputError
from whiptool.impedance import OIAC, ConstantImpedance, Controller, HandControl, PositionControl
from whiptool.impedance.arm import Arm
from whiptool.models import ArmLink, ArmParameters, Model, WhipParameters, preset
from whiptool.models.strike import HandStrike
from whiptool.rollout import CompiledRollout, ReferenceRollout

RNG = np.random.default_rng(12)
LEMON = preset("lemon2024")
ROPE = replace(random_whip(RNG, 3, forces=True), k=0.02, b=2e-4, dry_friction=0.0)
SMALL = Model(ROPE, random_arm(RNG, 4))
SEVEN = Model(ROPE, random_arm(np.random.default_rng(3), 7), name="seven joints")
SEVEN_HOME = (0.4, -0.3, 0.5, 0.6, -0.5, 0.8, 0.3)
LINKS = (ArmLink(0.4, 0.25), ArmLink(0.3, 0.25, friction=0.05), ArmLink(0.2, 0.2))
THREE = Model(WhipParameters(N=3, l=0.15, m=0.02, k=0.1, b=0.01), ArmParameters(LINKS), name="three joints")
HOMES = {"unnamed": (0.4, -0.3, 0.5, 0.6), "three joints": (0.2, 0.9, 0.7), "seven joints": SEVEN_HOME}


def symmetric(m: int, size: float) -> tuple[tuple[float, ...], ...]:
    """A random positive definite matrix."""
    A = RNG.normal(size=(m, m)) / 4
    return tuple(map(tuple, (size * (np.eye(m) + A @ A.T)).tolist()))


def constant(model: Model, K: float, B: float, *, pose: bool = False) -> ConstantImpedance:
    m = model.dimension + pose * {2: 1, 3: 3}[model.dimension]
    return ConstantImpedance(symmetric(m, K), symmetric(m, B))


def of_hand(law, model: Model, *, pose: bool = False, **options) -> Controller:
    hand = HandControl(posture=HOMES.get(model.name), null_damping=0.3, orientation=pose)
    return Controller(law, hand=hand, **options)


def interpreted(model: Model, controller: Controller, timestep: float) -> CompiledRollout:
    """A rollout that needs no compiler: for a few strikes that is faster."""
    return CompiledRollout(model, controller, timestep=timestep, engine="interpreter")


def strikes_of(controller: Controller, model: Model, count: int, rng: np.random.Generator = RNG) -> np.ndarray:
    """Random strikes that the arm can make."""
    space = controller.strike_space(model.arm)
    home = space.kinematics.coordinates(space.kinematics.posture)
    ends = home + rng.uniform(-0.08, 0.08, (20 * count, 2, len(home)))
    strikes = np.c_[ends.reshape(20 * count, -1), rng.uniform(0.3, 0.5, 20 * count)]
    strikes = strikes[space.beyond(strikes) == 0][:count]
    assert len(strikes) == count
    return strikes


PLACES = [(x, False) for x in (LEMON, THREE, SMALL, preset("ur5e"), preset("panda"))]
POSES = [(x, True) for x in (THREE, SEVEN, preset("ur5e"), preset("panda"))]
of_each = [pytest.param(*case, id=case[0].name + "-pose" * case[1]) for case in PLACES + POSES]
HEAVY_POSES = [pytest.param(model, True, marks=pytest.mark.slow) for model in (THREE, SEVEN)]
small = pytest.mark.parametrize(
    ("model", "pose"),
    [(THREE, False), (SMALL, False), *HEAVY_POSES],
    ids=["plane", "space", "pose in the plane", "pose in space"],
)


@pytest.mark.parametrize("law", ["constant", "oiac"])
@pytest.mark.parametrize(("model", "pose"), of_each)
def test_torques_against_pinocchios_jacobians(model, pose, law):
    """Two derivations of one law: CasADi's chain, and NumPy with Pinocchio's Jacobians; at any state."""
    given = constant(model, 300.0, 20.0, pose=pose) if law == "constant" else OIAC(a=0.01, beta=0.3, C=4.0)
    controller = of_hand(given, model, pose=pose, torque_limit=200.0)
    structure, space, arm = Structure.of(model, controller), controller.strike_space(model.arm), Arm(model)
    control, a, n = closed_loop(structure).control, model.arm.n, structure.n
    for vector in strikes_of(controller, model, 3):
        p = structure.pack(model, controller, space.numbers(vector[None]))[0]
        path = space.path(vector)
        loop = controller.bind(arm, path)
        for t in (0.0, 0.4 * vector[-1], vector[-1] + 0.1):
            x = RNG.normal(size=2 * n)
            q, v = path.reference(t)[0] + 0.2 * RNG.normal(size=a), 2 * RNG.normal(size=a)
            x[:a], x[n : n + a] = q, v
            expected = loop.torque(t, q, v)
            np.testing.assert_allclose(control(x, t, p).full().ravel(), expected, rtol=1e-9, atol=1e-9)
            assert 0 < np.abs(expected).max() <= 200.0


@pytest.mark.slow
@small
def test_mujoco_and_the_compiled_rollout_make_the_same_strike(model, pose):
    controller = of_hand(constant(model, 200.0, 30.0, pose=pose), model, pose=pose)
    strike = strikes_of(controller, model, 1)[0]
    strike[-1] = 0.2
    path = interpreted(model, controller, 1e-4).trajectory(strike, t_stay=0.1)
    other = ReferenceRollout(model, controller, timestep=1e-4).trajectory(HandStrike.from_vector(strike), t_stay=0.1)
    target = np.full(model.dimension, 0.4)
    assert abs(path.approach(target).distance - other.approach(target).distance) < 2e-5
    np.testing.assert_allclose(path.tip, other.tip, atol=2e-4)
    assert (np.abs(path.tau - other.tau).max(axis=0) < 0.01 * np.abs(other.tau).max()).all()
    J = controller.strike_space(model.arm).kinematics.jacobian(path.q[:, : model.arm.n])
    np.testing.assert_allclose(path.K, np.swapaxes(J, 1, 2) @ np.array(controller.law.K) @ J, rtol=1e-12, atol=1e-12)
    assert not np.isnan(path.q_d).any()


@pytest.mark.slow
@small
def test_joints_that_follow_the_hands_path_exactly(model, pose):
    controller = of_hand(PositionControl(), model, pose=pose)
    strike = strikes_of(controller, model, 1)[0]
    strike[-1] = 0.2
    rollout = interpreted(model, controller, 1e-4)
    path, other = rollout.trajectory(strike, t_stay=0.1), ReferenceRollout(model, controller, timestep=1e-4)
    other, a = other.trajectory(strike, t_stay=0.1), model.arm.n
    kinematics, wanted = rollout.space.kinematics, rollout.space.path(strike)
    for x in (path, other):
        left = kinematics.left(kinematics.motion(x.q[:, :a]), wanted.hand(x.t)[0])
        np.testing.assert_allclose(x.q[:, :a], wanted.reference(x.t)[0], atol=1e-11)
        np.testing.assert_allclose(x.v[:, :a], wanted.reference(x.t)[1], atol=1e-9)
        np.testing.assert_allclose(left, 0, atol=1e-4)
    np.testing.assert_allclose(path.tip, other.tip, atol=5e-5)


@pytest.mark.slow
@pytest.mark.parametrize(("model", "law"), [(THREE, "position"), (THREE, "oiac"), (SMALL, "constant")])
def test_the_interpreter_agrees_with_the_compiled_engine(model, law):
    given = {"position": PositionControl(), "oiac": OIAC(a=0.01, beta=0.3), "constant": constant(model, 200.0, 30.0)}
    controller, target = of_hand(given[law], model), np.full(model.dimension, 0.3)
    strikes = strikes_of(controller, model, 6)
    near = [
        CompiledRollout(model, controller, timestep=1e-3, engine=engine).approach(strikes, target, t_stay=0.1)
        for engine in ("simd", "interpreter")
    ]
    np.testing.assert_allclose(near[0].distance, near[1].distance, atol=1e-9)
    np.testing.assert_allclose(near[0].max_torque, near[1].max_torque, rtol=1e-7)


def test_a_weight_that_nobody_compensates_moves_the_hand_by_its_compliance():
    """At rest J^T K e = -J^T f, and two joints leave no other way than e = K^-1 f."""
    law = ConstantImpedance(((150.0, 40.0), (40.0, 250.0)), ((40.0, 0.0), (0.0, 40.0)))
    masses = (*LEMON.arm.per_link("mass"), 0.0)
    controller, home = Controller(law, compensated=masses, hand=HandControl()), np.array([0.45, -0.1])
    whip = WhipParameters(N=2, l=0.2, m=0.05, k=0.1, b=0.02)
    model = replace(LEMON, whip=whip)
    path = interpreted(model, controller, 1e-3).trajectory(np.array([*home, *home, 0.3]), t_stay=6.0)
    kinematics = controller.strike_space(LEMON.arm).kinematics
    weight = np.array([0.0, -whip.mass * LEMON.gravity])
    sagged = kinematics.coordinates(path.q[-1, :2]) - home
    assert np.abs(path.v[-1, :2]).max() < 1e-4  # the whip's free hinge goes on swinging a little
    np.testing.assert_allclose(sagged, np.linalg.solve(np.array(law.K), weight), rtol=0.01)


def test_damping_of_what_the_hand_does_not_see_hardly_moves_the_hand():
    """It takes energy out of the arm's own motion, and pulls at the hand a thousand times less than at the joints."""
    controller = of_hand(constant(SMALL, 200.0, 30.0), SMALL)
    space, arm = controller.strike_space(SMALL.arm), Arm(SMALL)
    path = space.path(strikes_of(controller, SMALL, 1)[0])
    none = replace(controller, hand=HandControl(posture=HOMES["unnamed"], null_damping=0.0))
    q, v = np.array(path.q_i), RNG.normal(size=4)
    tau = controller.bind(arm, path).torque(0.1, q, v) - none.bind(arm, path).torque(0.1, q, v)
    J = arm.hand(q).jacobian[:3]
    mode = np.linalg.svd(J)[2][-1]  # of the joints, that does not move the hand
    np.testing.assert_allclose(mode @ tau, -0.3 * mode @ v, rtol=1e-9)
    least = np.linalg.svd(J, compute_uv=False)[-1]
    assert np.linalg.norm(np.linalg.pinv(J.T) @ tau) * least < (0.02 / least) ** 2 * 0.3 * np.linalg.norm(v)


@pytest.mark.slow
@pytest.mark.parametrize("law", ["constant", "position"])
@pytest.mark.parametrize(("model", "pose"), [(THREE, False), HEAVY_POSES[1]], ids=["plane", "pose in space"])
def test_derivatives_by_the_hands_numbers_against_central_differences(model, pose, law):
    given = PositionControl() if law == "position" else constant(model, 200.0, 30.0, pose=pose)
    controller = of_hand(given, model, pose=pose)
    rollout, compared = interpreted(model, controller, 2e-3 if pose else 1e-3), []
    strikes, target = (
        strikes_of(controller, model, 3 if pose else 8, np.random.default_rng(0)),
        np.array([0.5, 0.2, 0.1])[-model.dimension :],
    )
    near, slopes = rollout.gradient(strikes, target, t_stay=0.1)
    assert not near.diverged.any()
    columns = [1, 3, 5, 8, 10] if pose else range(slopes.shape[1] - 1)
    for column in columns:
        slope = slopes[:, column]

        def distance(by: float, column: int = column) -> np.ndarray:
            shifted = strikes.copy()
            shifted[:, column] += by
            return rollout.approach(shifted, target, t_stay=0.1).distance

        wrong, still = compare(slope, distance, 3e-5)
        assert not wrong.any(), column
        compared.append(still.mean())
    assert np.mean(compared) > 0.9


def test_strikes_of_another_space_are_refused():
    rollout = interpreted(LEMON, of_hand(constant(LEMON, 200.0, 30.0), LEMON), 1e-3)
    with pytest.raises(InputError, match="the hand of an arm of 2 joints"):
        rollout.trajectory(np.zeros(7))
    with pytest.raises(InputError, match="a start and an end that the hand reaches"):
        rollout.trajectory(np.array([0.4, 0.0, 2.0, 0.0, 0.5]))
    with pytest.raises(InputError, match=r"matrices of 3 rows, one per coordinate of the hand"):
        interpreted(preset("ur5e"), Controller(ConstantImpedance(), hand=HandControl()), 1e-3)
