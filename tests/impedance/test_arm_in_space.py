"""Arms in space in Pinocchio against MuJoCo, differences of the potential energy, and the same arm in the plane."""

from __future__ import annotations

import dataclasses

import mujoco
import numpy as np
import pytest
from spatial_arms import ARMS, random_model

from whiptool.errors import InputError
from whiptool.impedance import OIAC, ConstantImpedance, Controller, constant_preset, impedance_cost
from whiptool.impedance.arm import Arm
from whiptool.impedance.controller import read_controller, write_controller
from whiptool.models import Model, Strike, WhipParameters, in_space, preset
from whiptool.models.kinematics import arm_frames
from whiptool.rollout import ReferenceRollout
from whiptool.rollout.mujoco_model import build_spec

MODELS = [
    *(preset(name) for name in ("nah2023", "ur5e", "panda")),
    *(random_model(rng=np.random.default_rng(i), **arm) for i, arm in enumerate(ARMS.values())),
]
every_model = pytest.mark.parametrize("model", MODELS, ids=lambda model: f"{model.name}, {model.arm.n}")


def weight(model: Model, q: np.ndarray, masses: np.ndarray) -> np.ndarray:
    """Potential energy of masses at the links' centres and the hand [J], (...)."""
    frames = arm_frames(model.arm, q)
    points = [frame.carried(link.com).origin for frame, link in zip(frames, model.arm.links, strict=False)]
    heights = np.stack([*points, frames[-1].origin], axis=-2)[..., 2]
    return model.gravity * heights @ masses


@every_model
def test_gravity_compensation_is_the_slope_of_the_potential(model):
    arm, a, h = Arm(model), model.arm.n, 1e-5
    own = np.append(model.arm.per_link("mass"), model.whip.mass)
    for q in np.random.default_rng(0).uniform(-2, 2, (5, a)):
        for masses, given in ((own, None), (np.arange(1.0, a + 2), tuple(range(1, a + 2)))):
            steps = h * np.eye(a)
            slope = (weight(model, q + steps, masses) - weight(model, q - steps, masses)) / (2 * h)
            np.testing.assert_allclose(arm.gravity_compensation(q, given), slope, atol=2e-8 * masses.sum() * 10)


@every_model
def test_inertia_is_that_of_the_bare_arm_in_mujoco(model):
    """MuJoCo's model with a whip and a hinge mass that weigh nothing to speak of."""
    weightless = WhipParameters(N=1, l=0.05, m=1e-9, k=0.0, b=0.0, joints="universal")
    light = dataclasses.replace(model, whip=weightless)
    mj = build_spec(light, node_inertia=1e-13).compile()
    data, M, a = mujoco.MjData(mj), np.empty((mj.nv, mj.nv)), model.arm.n
    for q in np.random.default_rng(1).uniform(-2, 2, (5, a)):
        data.qpos[:a] = q
        mujoco.mj_forward(mj, data)
        mujoco.mj_fullM(mj, data, M)
        np.testing.assert_allclose(Arm(model).inertia(q), M[:a, :a], atol=1e-8)


@every_model
def test_feedforward_is_what_moves_the_arm_without_weight_and_friction(model):
    """Inertia by acceleration, the change of inertia by velocity: Christoffel's symbols of I(q), by differences."""
    arm, a, h = Arm(model), model.arm.n, 1e-6
    q, v, acceleration = np.random.default_rng(2).uniform(-1, 1, (3, a))
    dI = np.array([(arm.inertia(q + h * e) - arm.inertia(q - h * e)) / (2 * h) for e in np.eye(a)])  # d I / d q_i
    turning = np.einsum("kij,k,j->i", dI, v, v) - np.einsum("ijk,j,k->i", dI, v, v) / 2
    expected = arm.inertia(q) @ acceleration + turning + model.arm.per_link("friction") * v
    size = max(1, np.abs(expected).max())
    np.testing.assert_allclose(arm.feedforward(q, v, acceleration), expected, atol=1e-7 * size)


def test_an_arm_put_in_space_is_the_arm_in_the_plane():
    planar = preset("nah2020-fitted")
    spatial = Model(dataclasses.replace(planar.whip, joints="universal"), in_space(planar.arm))
    a, b = Arm(planar), Arm(spatial)
    for q, v, acceleration in np.random.default_rng(3).uniform(-3, 3, (5, 3, 2)):
        np.testing.assert_allclose(b.inertia(q), a.inertia(q), atol=1e-15)
        np.testing.assert_allclose(b.gravity_compensation(q), a.gravity_compensation(q), atol=1e-14)
        np.testing.assert_allclose(b.gravity_jacobians(q)[:, [0, 2]], a.gravity_jacobians(q), atol=1e-15)
        np.testing.assert_allclose(b.feedforward(q, v, acceleration), a.feedforward(q, v, acceleration), atol=1e-13)


def test_nah_s_controller_compensates_both_links_and_the_whip_at_the_wrist():
    model = preset("nah2023")
    torque = Arm(model).gravity_compensation([0, 0, 0, np.pi / 2])
    fore = 9.81 * (0.869 * 0.112 + 0.3 * 0.291)  # held forward by the elbow, and by flexion all the more
    np.testing.assert_allclose(torque, [fore, 0, 0, fore], atol=1e-14)


@pytest.mark.parametrize("n", [4, 6, 7])
def test_oiac_is_of_any_number_of_joints(n):
    """Eqs. 2 and 8 to 10, written out; the law's two forms agree; its torque never pulls away from the path."""
    import casadi as ca

    law = OIAC(a=0.03, beta=0.4, C=7.0)
    rng = np.random.default_rng(n)
    e, de = rng.normal(size=(2, n))
    K, B = law.gains(e, de)
    epsilon = e + 0.4 * de
    gamma = 0.03 / (1 + 7 * sum(x**2 for x in epsilon))
    np.testing.assert_allclose(K, [[x * y / gamma for y in e] for x in epsilon])
    np.testing.assert_allclose(B, [[x * y / gamma for y in de] for x in epsilon])
    symbols = [ca.SX.sym(name, n) for name in ("e", "de")]
    numbers = {name: ca.SX(value) for name, value in law.parameters().items()}
    torque = ca.Function("torque", symbols, [law.expression(numbers, *symbols)])
    np.testing.assert_allclose(np.array(torque(e, de))[:, 0], K @ e + B @ de)
    assert (K @ e + B @ de) @ epsilon > 0


def test_controllers_fit_arms_in_space_or_say_what_does_not(tmp_path):
    model = preset("ur5e")
    limits = (150, 150, 150, 28, 28, 28)
    Controller(OIAC(), torque_limit=limits, compensated=(1, 2, 3, 4, 5, 6, 0)).check_fits(model.arm)
    for controller, message in (
        (Controller(ConstantImpedance()), "controller constant: .*K of 2 rows.*matrices of 6 rows"),
        (Controller(OIAC(), torque_limit=(1.0, 2.0)), "torque_limit: .*one number, or 6, one per arm joint"),
        (Controller(OIAC(), compensated=(1.0, 2.0)), "compensated: .*7 masses"),
    ):
        with pytest.raises(InputError, match=f"^{message}"):
            controller.check_fits(model.arm)
    with pytest.raises(InputError, match=r"^torque_limit\[1\]: got -1"):
        Controller(torque_limit=(1.0, -1.0))
    controller = Controller(constant_preset("ur5e"), torque_limit=limits).reckoning_with(model)
    write_controller(controller, tmp_path / "controller.toml")
    assert read_controller(tmp_path / "controller.toml") == controller
    assert controller.parameters()["torque_limit[3]"] == 28
    np.testing.assert_array_equal(controller.clipped(np.full(6, -1e3)), [-150, -150, -150, -28, -28, -28])


def test_the_cost_of_a_strike_in_space():
    """Its parts by plain loops along the trajectory."""
    model = preset("nah2023")
    rollout = ReferenceRollout(model, Controller(constant_preset("nah2023")), timestep=2e-4, integrator="implicitfast")
    path = rollout.trajectory(Strike((-0.8, 0.1, 0.1, 0.4), (1.0, 0.2, 0.0, 0.8), 0.5), t_stay=0.0)
    assert not path.diverged
    cost = impedance_cost(path, model, D=0.5, beta=0.6)
    law = constant_preset("nah2023")
    squares = float((np.array(law.K) ** 2).sum() + (np.array(law.B) ** 2).sum())
    assert cost.J_c == pytest.approx(squares * 0.5 / 2)
    arm = Arm(model)

    def energy(i):
        x = path.q_d[i] - path.q[i, :4] + 0.6 * (path.v_d[i] - path.v[i, :4])
        return x @ arm.inertia(path.q[i, :4]) @ x / 2

    assert cost.J_p == pytest.approx(energy(-1) - energy(0))
