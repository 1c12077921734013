"""Linearised chain and hanging modes against closed forms, MuJoCo and finite differences."""

from __future__ import annotations

import dataclasses
import re

import casadi as ca
import mujoco
import numpy as np
import pytest
from dense_inverse import dense_slopes, inverse_dynamics
from random_space import loop_of, random_model, random_rods, random_state
from robot_files import WEIGHTLESS
from scipy.linalg import eigh
from scipy.special import jn_zeros, roots_laguerre
from spatial_arms import of_universal_nodes

from whiptool.dynamics.chain import bias_forces, chain_of, forward_dynamics, passive_torque, potential_energy
from whiptool.dynamics.modes import explicit_timestep, hanging_modes, linearise
from whiptool.dynamics.posture import start_posture
from whiptool.errors import InputError
from whiptool.impedance import OIAC, Controller, PositionControl
from whiptool.impedance.laws import Law
from whiptool.models.files import load_model
from whiptool.models.kinematics import rotation_about
from whiptool.models.parameters import ArmLink, ArmParameters, Model, in_space
from whiptool.models.presets import PRESETS, preset, rope
from whiptool.models.profile import WhipProfile
from whiptool.models.strike import default_bounds
from whiptool.models.whip import WhipParameters
from whiptool.rollout.compiled import CompiledRollout
from whiptool.rollout.mujoco_model import build_spec

ARM = preset("lemon2024").arm
G = 9.81
HEAVY = '<inertial><mass value="2"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'


def omegas(model: Model, **options) -> np.ndarray:
    return 2 * np.pi * hanging_modes(model, **options).frequencies


# ---------------------------------------------------------------------------------------------------------------------
# Frequencies


@pytest.mark.parametrize("N", [1, 2, 3, 12, 40, 100])
def test_a_string_of_equal_masses_swings_at_the_zeros_of_laguerre(N: int):
    """omega^2 = x g / l with L_N(x) = 0: the loaded hanging string, exactly."""
    model = Model(WhipParameters(N=N, l=0.03, m=0.02, k=0.0, b=0.0), ARM)
    zeros = roots_laguerre(N)[0]
    rounding = 1e-9 if N < 100 else 1e-8  # grows with the mass matrix's condition number
    np.testing.assert_allclose(omegas(model), np.sqrt(zeros * G / 0.03), rtol=rounding)


def test_a_long_chain_swings_at_the_zeros_of_bessel():
    """omega = j_0k / 2 sqrt(g / L): a uniform hanging chain, lumped with hats; four modes, second order in 1/N."""
    exact, errors = jn_zeros(0, 4) / 2 * np.sqrt(G / 1.3), []
    for N in (50, 100, 200):
        whip = WhipProfile(length=1.3, linear_density=0.2, bending_stiffness=1e-12, bending_damping=0).lump(N)
        errors.append(np.abs(omegas(Model(whip, ARM), count=4) / exact - 1))
    assert np.log2(errors[0] / errors[1]).min() > 1.9
    assert np.log2(errors[1] / errors[2]).min() > 1.9
    assert errors[2].max() < 2e-3


@pytest.mark.parametrize("seed", range(10))
def test_double_pendulum_in_closed_form(seed: int):
    m1, m2, l1, l2 = np.random.default_rng(seed).uniform(0.1, 1, 4)
    model = Model(WhipParameters(N=2, l=(l1, l2), m=(m1, m2), k=0.0, b=0.0), ARM)
    M = m1 + m2
    root = np.sqrt((M * (l1 + l2)) ** 2 - 4 * m1 * M * l1 * l2)
    squares = G * (M * (l1 + l2) + np.array([-root, root])) / (2 * m1 * l1 * l2)
    modes = hanging_modes(model)
    np.testing.assert_allclose((2 * np.pi * modes.frequencies) ** 2, squares, rtol=1e-11)
    # shape: the absolute angles' ratio from the second row of (K - omega^2 M) = 0
    second = squares * l1 / (G - squares * l2)  # theta_2 / theta_1
    q = modes.shapes[:, 2:]
    np.testing.assert_allclose((q[:, 0] + q[:, 1]) / q[:, 0], second, rtol=1e-9)


@pytest.mark.parametrize("name", [name for name, model in PRESETS.items() if model.dimension == 2])
def test_the_free_arm_swings_as_in_mujoco(name: str):
    """MuJoCo's mass matrix, and the finite differences of its forces, at the hanging posture."""
    model = preset(name)
    mj = build_spec(model).compile()
    data, n, step = mujoco.MjData(mj), model.n, 1e-5
    M, K = np.empty((n, n)), np.empty((n, n))
    mujoco.mj_forward(mj, data)
    mujoco.mj_fullM(mj, data, M)
    for j in range(n):
        for sign in (1, -1):
            data.qpos[:] = sign * step * np.eye(n)[j]
            mujoco.mj_forward(mj, data)
            K[:, j] = (0 if sign > 0 else K[:, j]) + sign * (data.qfrc_bias - data.qfrc_passive) / (2 * step)
    a = model.arm.n
    np.testing.assert_allclose(omegas(model, fixed_arm=False), np.sqrt(eigh((K + K.T) / 2, M)[0]), rtol=1e-6)
    locked = eigh(((K + K.T) / 2)[a:, a:], M[a:, a:])[0]
    np.testing.assert_allclose(omegas(model), np.sqrt(locked), rtol=1e-6)


@pytest.mark.parametrize("joints", [1, 2, 3, 4])
def test_a_curved_whip_on_any_arm(joints: int):
    """Rest angles and a spring at the hinge: the whip swings about where weight and springs balance. With the arm
    locked the arm makes no difference."""
    whip = WhipParameters(N=3, l=0.1, m=0.1, k=(0.2, 0.1, 0.1), b=0.01, rest_angle=0.4)
    arm = ArmParameters(tuple(ArmLink(mass=0.3, length=0.2) for _ in range(joints)))
    modes, usual = hanging_modes(Model(whip, arm)), hanging_modes(Model(whip, ARM))
    assert modes.shapes.shape == (3, joints + 3)
    np.testing.assert_allclose(modes.frequencies, usual.frequencies, rtol=1e-9)
    straight = WhipParameters(N=3, l=0.1, m=0.1, k=(0.2, 0.1, 0.1), b=0.01)
    assert abs(hanging_modes(Model(straight, arm)).frequencies[0] / modes.frequencies[0] - 1) > 1e-3


# ---------------------------------------------------------------------------------------------------------------------
# Damping


@pytest.mark.parametrize("seed", range(10))
def test_damping_ratio_of_a_single_pendulum(seed: int):
    l, m, k, damping = np.random.default_rng(seed).uniform(0.1, 1, 4)
    inertia = m * l**2
    omega = np.sqrt(G / l + k / inertia)
    b = 2 * damping * omega * inertia
    modes = hanging_modes(Model(WhipParameters(N=1, l=l, m=m, k=(k,), b=(b,)), ARM))
    assert modes.damping_ratios == pytest.approx([damping], rel=1e-9)
    root = omega * np.sqrt(1 - damping**2) * 1j
    np.testing.assert_allclose(modes.eigenvalues, [-damping * omega - root, -damping * omega + root], rtol=1e-9)


@pytest.mark.parametrize("seed", range(3))
def test_a_node_with_inertia_swings_as_a_physical_pendulum(seed: int):
    """omega^2 = (k + m g l) / (m l^2 + I), 2 zeta omega = b / (m l^2 + I): in the plane, and in space in two ways."""
    l, m, k, b, I = np.random.default_rng(seed).uniform(0.1, 1, 5) * [1, 1, 1, 0.1, 0.1]
    omega = np.sqrt((k + m * G * l) / (m * l**2 + I))
    whip = WhipParameters(N=1, l=l, m=m, k=(k,), b=(b,), node_inertia=I)
    for model, ways in ((Model(whip, ARM), 1), (put_in_space(Model(whip, ARM), "universal"), 2)):
        modes = hanging_modes(model)
        assert 2 * np.pi * modes.frequencies == pytest.approx([omega] * ways, rel=1e-9)
        assert modes.damping_ratios == pytest.approx([b / (m * l**2 + I) / (2 * omega)] * ways, rel=1e-9)


def test_an_overdamped_pendulum_has_real_eigenvalues_and_no_ratio():
    l, m, damping = 0.4, 0.2, 3.0
    omega = np.sqrt(G / l)
    modes = hanging_modes(Model(WhipParameters(N=1, l=l, m=m, k=(0.0,), b=(2 * damping * omega * m * l**2,)), ARM))
    assert np.isnan(modes.damping_ratios).all()
    poles = -omega * (damping + np.array([-1, 1]) * np.sqrt(damping**2 - 1))
    np.testing.assert_allclose(modes.eigenvalues, poles, rtol=1e-9)
    np.testing.assert_allclose(modes.frequencies, [omega / (2 * np.pi)])


def test_damping_in_proportion_to_stiffness():
    """Without weight, b = alpha k gives every mode the ratio alpha omega / 2; above 1 there is none."""
    k = np.array([0.3, 0.2, 0.5, 0.1, 0.4])
    alpha = 0.045
    whip = WhipParameters(N=5, l=0.1, m=0.1, k=tuple(k), b=tuple(alpha * k))
    modes = hanging_modes(Model(whip, ARM, gravity=0.0))
    expected = alpha * 2 * np.pi * modes.frequencies / 2
    assert expected.min() < 1 < expected.max()
    np.testing.assert_allclose(modes.damping_ratios, np.where(expected < 1, expected, np.nan), rtol=1e-9)


def test_lemon2024_is_mostly_overdamped():
    modes = hanging_modes(preset("lemon2024"))
    assert np.isfinite(modes.damping_ratios).tolist() == [True, True] + [False] * 10
    assert modes.damping_ratios[0] < 0.01  # the whip swings about its free hinge
    assert modes.eigenvalues.real.max() < 0
    assert np.isreal(modes.eigenvalues).sum() == 2 * 10


def test_without_damping_nothing_decays():
    model = Model(WhipParameters(N=12, l=0.072, m=0.012, k=0.242, b=0.0), ARM)
    np.testing.assert_allclose(hanging_modes(model, fixed_arm=False).damping_ratios, 0, atol=1e-12)


def test_a_free_hinge_without_weight_does_not_swing():
    modes = hanging_modes(Model(WhipParameters(N=3, l=0.1, m=0.1, k=0.1, b=0.001), ARM, gravity=0.0))
    assert modes.frequencies[0] == pytest.approx(0, abs=1e-6)
    assert np.isnan(modes.damping_ratios).tolist() == [True, False, False]


# ---------------------------------------------------------------------------------------------------------------------
# Form


def test_shapes():
    model = preset("lemon2024")
    modes = hanging_modes(model, count=3)
    assert modes.frequencies.shape == modes.damping_ratios.shape == (3,)
    assert modes.shapes.shape == (3, 14)
    assert modes.eigenvalues.shape == (24,)
    assert (modes.shapes[:, :2] == 0).all()
    np.testing.assert_allclose(np.abs(modes.shapes).max(axis=1), 1)
    assert (np.diff(modes.frequencies) > 0).all()
    whole = hanging_modes(model, fixed_arm=False)
    assert whole.shapes.shape == (14, 14)
    assert np.abs(whole.shapes[:, :2]).max() > 0.1
    linear = linearise(model, np.zeros(14))
    for shape, frequency in zip(whole.shapes, whole.frequencies, strict=True):
        np.testing.assert_allclose(linear.K @ shape, (2 * np.pi * frequency) ** 2 * linear.M @ shape, atol=1e-9)


@pytest.mark.parametrize("count", [0, 13, -1, 1.5, True])
def test_count_is_checked(count):
    with pytest.raises(InputError, match="count"):
        hanging_modes(preset("lemon2024"), count=count)


# ---------------------------------------------------------------------------------------------------------------------
# Linearisation


def test_linearise_at_a_moving_posture_against_finite_differences():
    """Every term in use: springs, dampers, friction, drag; the torque that holds the posture is constant."""
    whip = WhipParameters(
        N=4, l=0.1, m=0.05, k=0.2, b=0.01, rest_angle=0.1, dry_friction=0.02, drag=0.01, drag_ratio=0.3,
        cubic_stiffness=0.5,
    )  # fmt: skip
    model = Model(whip, ArmParameters((ArmLink(mass=0.5, length=0.3, friction=0.1), ArmLink(mass=0.4, length=0.2))))
    chain, n = chain_of(model), model.n
    rng = np.random.default_rng(5)
    q0, v0 = rng.uniform(-1, 1, n), rng.uniform(-2, 2, n)
    linear = linearise(model, q0, v0)
    q, v, tau = (ca.SX.sym(name, n) for name in ("q", "v", "tau"))
    hold = ca.Function("hold", [q, v], [bias_forces(chain, q, v) - passive_torque(chain, q, v)])
    a = ca.Function("a", [q, v, tau], [forward_dynamics(chain, q, v, tau + passive_torque(chain, q, v))])
    torque, step = hold(q0, v0), 1e-6
    np.testing.assert_allclose(a(q0, v0, torque), 0, atol=1e-9)
    slopes = np.hstack(
        [np.array(a(q0 + s, v0, torque) - a(q0 - s, v0, torque)) / (2 * step) for s in step * np.eye(n)]
        + [np.array(a(q0, v0 + s, torque) - a(q0, v0 - s, torque)) / (2 * step) for s in step * np.eye(n)]
    )
    np.testing.assert_allclose(linear.A[n:], slopes, rtol=0, atol=1e-6 * np.abs(slopes).max())
    np.testing.assert_array_equal(linear.A[:n], np.hstack([np.zeros((n, n)), np.eye(n)]))
    np.testing.assert_allclose(linear.M @ linear.A[n:], -np.hstack([linear.K, linear.C]), atol=1e-9)


def test_linearise_at_rest_is_the_hessian_of_the_potential_and_the_dampers():
    model = preset("nah2020-n10")
    q0 = np.random.default_rng(2).uniform(-1, 1, model.n)
    linear = linearise(model, q0)
    q = ca.SX.sym("q", model.n)
    hessian = ca.Function("H", [q], [ca.hessian(potential_energy(chain_of(model), q), q)[0]])
    np.testing.assert_allclose(linear.K, np.array(hessian(q0)), atol=1e-12)
    np.testing.assert_allclose(linear.C, np.diag(chain_of(model).damping), atol=1e-15)
    np.testing.assert_array_equal(linear.M, linear.M.T)
    by_chain = linearise(chain_of(model), q0)
    np.testing.assert_array_equal(by_chain.A, linear.A)


@pytest.mark.parametrize(
    ("name", "arguments"), [("q0", (np.zeros(3),)), ("q0", (np.full(14, np.nan),)), ("v0", (np.zeros(14), np.zeros(2)))]
)
def test_linearise_checks_its_states(name: str, arguments: tuple):
    with pytest.raises(InputError, match=name):
        linearise(preset("lemon2024"), *arguments)


@pytest.mark.parametrize("law", [OIAC(), PositionControl()])
@pytest.mark.parametrize(("k", "b"), [(500.0, 0.1), (20.0, 0.0)])
def test_stiff_whips_get_steps_that_let_nothing_grow(k: float, b: float, law: Law):
    """Of whatever damping, as equal steps have it that are far finer than the fastest mode."""
    model = dataclasses.replace(preset("lemon2024"), whip=dataclasses.replace(preset("lemon2024").whip, k=k, b=b))
    strikes, target = default_bounds(ARM).sample(np.random.default_rng(0), 8), np.array([1.2, 0.1])
    near, fine = (
        CompiledRollout(model, Controller(law), timestep=step).approach(strikes, target, t_stay=0.1)
        for step in (None, 5e-6)
    )
    assert np.isfinite(near.integration_error).all()
    np.testing.assert_allclose(near.distance, fine.distance, atol=1e-4)


def test_an_explicit_step_is_a_share_of_the_fastest_decay():
    """Of one node in closed form; of universal nodes in gimbal lock, between two dampers, their own inertia counts."""
    for b in (1e-4, 5e-2):
        node = WhipParameters(N=1, l=0.3, m=0.02, k=(0.1,), b=(b,))
        fastest = np.abs(np.roots([0.02 * 0.3**2, b, 0.1 + 0.02 * G * 0.3])).max()
        assert explicit_timestep(Model(node, ARM)) == pytest.approx(2 / fastest, rel=1e-9)
    robot = of_universal_nodes("ur5e")
    rope = robot.whip
    inertia, b = rope.per_node("node_inertia"), rope.per_node("b")
    assert explicit_timestep(robot) == pytest.approx((inertia[b > 0] / b[b > 0]).min(), rel=1e-9)
    assert explicit_timestep(preset("nah2023")) < 1e-4
    rods = dataclasses.replace(rope, joints="rod", node_inertia=0.0)
    assert explicit_timestep(dataclasses.replace(preset("ur5e"), whip=rods)) > 2e-3


def test_a_whip_in_space_has_every_mode_of_the_plane_twice():
    planar = preset("lemon2024")
    space = Model(dataclasses.replace(planar.whip, joints="universal", node_inertia=0.0), in_space(ARM))
    flat, both = hanging_modes(planar), hanging_modes(space)
    np.testing.assert_allclose(both.frequencies, np.repeat(flat.frequencies, 2), rtol=1e-9)


def put_in_space(planar: Model, joints: str) -> Model:
    return Model(dataclasses.replace(planar.whip, joints=joints), in_space(planar.arm), gravity=planar.gravity)


@pytest.mark.parametrize("joints", ["universal", "rod"])
def test_a_long_chain_in_space_swings_at_the_zeros_of_bessel_in_every_direction(joints: str):
    """Below an arm in any posture, in pairs of one frequency and of two directions."""
    exact, errors = jn_zeros(0, 2) / 2 * np.sqrt(G / 1.3), []
    for N in (10, 20):
        whip = WhipProfile(length=1.3, linear_density=0.2, bending_stiffness=1e-12, bending_damping=0).lump(N)
        modes = hanging_modes(put_in_space(Model(whip, ARM), joints), count=4, posture=np.array([0.7, -0.4]))
        pairs = 2 * np.pi * modes.frequencies.reshape(2, 2)
        np.testing.assert_allclose(pairs[:, 0], pairs[:, 1], rtol=1e-9)
        errors.append(np.abs(pairs[:, 0] / exact - 1))
        for pair in modes.displacements.reshape(2, 2, N + 1, 3):
            np.testing.assert_allclose(pair[..., 2], 0, atol=1e-9)  # level
            assert np.linalg.matrix_rank(pair[:, -1], tol=1e-3 * np.abs(pair).max()) == 2
    assert np.log2(errors[0] / errors[1]).min() > 1.9
    assert errors[1].max() < 2e-2


def test_rods_swing_as_universal_nodes_do():
    """Below a robot in any posture, with all that bends and brakes, free to move and held."""
    rng = np.random.default_rng(4)
    universal = random_model(1, 3, 5, forces=True)
    straight = dataclasses.replace(
        universal.whip, k=0.1, cubic_stiffness=0.1, b=0.01, dry_friction=0.0, node_inertia=0.0
    )
    universal = dataclasses.replace(universal, whip=straight)
    rods = dataclasses.replace(universal, whip=dataclasses.replace(straight, joints="rod"))
    for fixed in (True, False):
        posture = rng.uniform(-0.5, 0.5, 3)
        ours, its = (hanging_modes(model, posture=posture, fixed_arm=fixed) for model in (rods, universal))
        assert ours.shapes.shape == its.shapes.shape == (10 if fixed else 13, 13)
        np.testing.assert_allclose(ours.frequencies, its.frequencies, rtol=1e-7, atol=1e-7)
        np.testing.assert_allclose(ours.eigenvalues, its.eigenvalues, rtol=1e-6, atol=1e-6)
    with pytest.raises(InputError, match="posture"):
        hanging_modes(rods, posture=np.zeros(2))


@pytest.mark.parametrize("seed", range(3))
def test_linearised_in_space_as_by_mujoco(seed: int):
    """Its derivatives of one explicit step, from a moving posture that torques hold."""
    model = random_model(seed, 3, 4)
    q, v, _ = random_state(model, seed)
    q, n, h = 0.5 * q, model.n, 1e-5
    mj = build_spec(model).compile()
    mj.opt.timestep = h
    mj.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_EULERDAMP
    data = mujoco.MjData(mj)
    data.qpos[:], data.qvel[:] = q, v
    mujoco.mj_forward(mj, data)
    data.qfrc_applied[:] = data.qfrc_bias - data.qfrc_passive
    mujoco.mj_forward(mj, data)
    assert np.abs(data.qacc).max() < 1e-6
    steps = np.zeros((2 * n, 2 * n))
    mujoco.mjd_transitionFD(mj, data, 1e-6, True, steps, None, None, None)
    its = (steps[n:] - np.hstack([np.zeros((n, n)), np.eye(n)])) / h
    np.testing.assert_allclose(linearise(model, q, v).A[n:], its, rtol=0, atol=1e-5 * np.abs(its).max())


@pytest.mark.parametrize("seed", range(3))
def test_rods_linearised_at_rest_are_the_slopes_of_their_accelerations(seed: int):
    """About a bent whip in balance on an arm that torques hold, against differences of the articulated pass."""
    model = random_rods(seed, 3, 4)
    q0 = start_posture(model, np.array([[0.4, -0.3, 0.6]]))[0]
    loop, p = loop_of(model)
    still, n, a, h = np.zeros(loop.n), model.n, 3, 1e-6
    hold = float_column(ca.Function("hold", [loop.p], [inverse_dynamics(loop, q0, still, still)[:a]])(p))
    assert np.abs(loop.acceleration(np.r_[q0, still], 0, p, hold).full()).max() < 1e-8
    d = q0[a:].reshape(-1, 3)
    assert np.abs(d[:, :2]).max() > 0.1  # it is bent
    A = linearise(model, q0).A
    for i in range(n):  # a turn of one joint, or of one rod towards one of its axes
        turned = np.zeros(loop.n)
        if i < a:
            turned[i] = 1
        else:
            rod, which = divmod(i - a, 2)
            turned[a + 3 * rod : a + 3 * rod + 3] = turn_from_down(d[rod])[:, which]
        for column, change in ((i, np.r_[turned, still]), (n + i, np.r_[still, turned])):
            ends = [loop.acceleration(np.r_[q0, still] + s * h * change, 0, p, hold).full()[:, 0] for s in (1, -1)]
            slope = (ends[0] - ends[1]) / (2 * h)
            of_rods = [turn_from_down(x)[:, :2].T @ y for x, y in zip(d, slope[a:].reshape(-1, 3), strict=True)]
            expected = np.r_[slope[:a], np.concatenate(of_rods)]
            np.testing.assert_allclose(A[n:, column], expected, rtol=0, atol=1e-5 * np.abs(A[n:]).max())


@pytest.mark.parametrize("kind", ["universal", "rod"])
def test_derivatives_from_link_to_link_are_those_of_the_whole_chain(kind: str):
    """Of an arm and a whip that move and bend, with drag, friction and all else, as one expression has them."""
    a, rng = 3, np.random.default_rng(3)
    if kind == "universal":
        model, across = random_model(1, a, 8, forces=True), None
        q, v, _ = random_state(model, 1)
    else:
        model = random_rods(1, a, 8)
        d = rng.normal(size=(8, 3))
        d /= np.linalg.norm(d, axis=1, keepdims=True)
        rate = np.cross(rng.uniform(-4, 4, (8, 3)), d)
        q, v = np.r_[rng.uniform(-1, 1, a), d.ravel()], np.r_[rng.uniform(-2, 2, a), rate.ravel()]
        across = np.array([turn_from_down(row)[:, :2] for row in d])
    loop, p = loop_of(model)
    linear, dense = linearise(model, q, v), dense_slopes(loop, p, q, v, across)
    for name, expected in zip("MCK", dense, strict=True):
        np.testing.assert_allclose(getattr(linear, name), expected, rtol=0, atol=1e-12 * np.abs(expected).max())


def float_column(x) -> np.ndarray:
    return np.array(x)[:, 0]


def turn_from_down(d: np.ndarray) -> np.ndarray:
    """The least rotation that takes -z to d, by its rotation vector."""
    axis = np.cross([0, 0, -1], d)
    sine = np.linalg.norm(axis)
    return rotation_about(axis / sine, np.arctan2(sine, -d[2]))


def test_inverse_dynamics_of_moving_rods_undoes_their_forward_dynamics():
    """With drag, friction and all else: no torque but the arm's turns a joint or a rod."""
    for seed in range(3):
        model = random_rods(seed, 3, 5)
        loop, p = loop_of(model)
        rng, a = np.random.default_rng(seed), 3
        d = rng.normal(size=(5, 3))
        d /= np.linalg.norm(d, axis=1, keepdims=True)
        rate = np.cross(rng.uniform(-4, 4, (5, 3)), d)
        q, v, tau = (
            np.r_[rng.uniform(-1, 1, a), d.ravel()],
            np.r_[rng.uniform(-2, 2, a), rate.ravel()],
            rng.uniform(-1, 1, a),
        )
        qdd = loop.acceleration(np.r_[q, v], 0, p, tau).full()[:, 0]
        found = float_column(ca.Function("inverse", [loop.p], [inverse_dynamics(loop, q, v, qdd)])(p))
        np.testing.assert_allclose(found[:a], tau, atol=1e-9)
        assert np.abs(np.cross(found[a:].reshape(5, 3), d)).max() < 1e-9  # along it, a rod has no inertia


def test_rods_are_linearised_at_unit_vectors_that_turn():
    model = random_rods(0, 3, 2)
    q0 = start_posture(model, np.zeros((1, 3)))[0]
    with pytest.raises(InputError, match=r"q0 of rod 2: got .*; allowed: a unit vector"):
        linearise(model, 2 * q0)
    along = np.r_[np.zeros(3), q0[3:]]
    with pytest.raises(InputError, match="perpendicular"):
        linearise(model, q0, along)
    with pytest.raises(InputError, match="9 finite numbers"):
        linearise(model, np.zeros(model.n))
    upright = np.r_[np.zeros(3), 0, 0, 1, 0, 0, 1]
    assert np.isfinite(linearise(model, upright).A).all()


@pytest.mark.parametrize("joints", ["rod", "universal"])
def test_the_joints_of_an_arm_of_unknown_inertia_are_no_degrees_of_freedom(joints: str, tmp_path):
    """Its mass matrix is singular; its whip swings as on an arm of known inertia that is held."""
    (tmp_path / "arm.urdf").write_text(WEIGHTLESS)
    unknown = dataclasses.replace(load_model(tmp_path / "arm.urdf"), whip=rope(5, joints=joints))
    (tmp_path / "arm.urdf").write_text(
        re.sub('<link name="(l[1-6])"/>', rf'<link name="\1">{HEAVY}</link>', WEIGHTLESS)
    )
    known = dataclasses.replace(load_model(tmp_path / "arm.urdf"), whip=unknown.whip)
    posture = np.array([0.1, 0.5, -0.4, 0.2, 0.3, 0.1])
    ours, its = (hanging_modes(model, posture=posture, count=3) for model in (unknown, known))
    np.testing.assert_allclose(ours.frequencies, its.frequencies, rtol=1e-9)
    np.testing.assert_allclose(ours.eigenvalues, its.eigenvalues, rtol=1e-7, atol=1e-7)
    linear, a = linearise(unknown, start_posture(unknown, posture[None])[0]), 6
    n = len(linear.M)
    assert not linear.A[n : n + a].any()
    of_whip = np.delete(np.delete(linear.A, [*range(a), *range(n, n + a)], 0), [*range(a), *range(n, n + a)], 1)
    found = np.sort_complex(np.round(np.linalg.eigvals(of_whip), 6))
    np.testing.assert_allclose(found, np.sort_complex(np.round(ours.eigenvalues, 6)), atol=1e-4)
    with pytest.raises(InputError, match=r"fixed_arm: .*inertia of j1, .* is unknown.*fixed_arm=True"):
        hanging_modes(unknown, fixed_arm=False)
