"""Linearised chain and hanging modes against closed forms, MuJoCo and finite differences."""

from __future__ import annotations

import dataclasses

import casadi as ca
import mujoco
import numpy as np
import pytest
from scipy.linalg import eigh
from scipy.special import jn_zeros, roots_laguerre

from whiptool.dynamics.chain import bias_forces, chain_of, forward_dynamics, passive_torque, potential_energy
from whiptool.dynamics.modes import explicit_timestep, hanging_modes, linearise, steady_timestep
from whiptool.errors import InputError
from whiptool.impedance import Controller
from whiptool.models.parameters import ArmLink, ArmParameters, Model, WhipParameters
from whiptool.models.presets import PRESETS, preset
from whiptool.models.profile import WhipProfile
from whiptool.models.spatial_arm import in_space
from whiptool.models.strike import default_bounds
from whiptool.rollout.compiled import TIMESTEP, CompiledRollout
from whiptool.rollout.mujoco_model import build_spec

ARM = preset("lemon2024").arm
G = 9.81


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
    for N in (40, 80, 160):
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


@pytest.mark.parametrize(("k", "b"), [(100.0, 1e-3), (500.0, 0.1), (20.0, 1e-3), (20.0, 1e-5)])
def test_stiff_whips_get_a_step_that_lets_nothing_grow(k: float, b: float):
    """Half of it gives the same misses. Where the usual step makes every strike diverge, it is not the one given."""
    lemon, controller = preset("lemon2024"), Controller()
    model = dataclasses.replace(lemon, whip=dataclasses.replace(lemon.whip, k=k, b=b))
    strikes, target = default_bounds(ARM).sample(np.random.default_rng(0), 20), np.array([1.2, 0.1])
    h = steady_timestep(model, TIMESTEP)
    usual, given, finer = (
        CompiledRollout(model, controller, timestep=step).approach(strikes, target, t_stay=0.3)
        for step in (TIMESTEP, h, h / 2)
    )
    assert not given.diverged.any()
    np.testing.assert_allclose(given.distance, finer.distance, atol=1e-4)
    assert h < TIMESTEP
    assert usual.diverged.all() or np.abs(usual.distance - finer.distance).max() < 1e-3


def test_published_whips_keep_the_usual_step():
    assert all(steady_timestep(model, TIMESTEP) == TIMESTEP for model in PRESETS.values())


def test_a_step_is_as_steady_in_space_as_in_the_plane():
    whip = dataclasses.replace(preset("lemon2024").whip, k=20.0, b=1e-3)
    planar = Model(whip, ARM)
    space = Model(dataclasses.replace(whip, joints="universal", node_inertia=1e-6), in_space(ARM))
    assert steady_timestep(space, TIMESTEP) == pytest.approx(steady_timestep(planar, TIMESTEP), rel=1e-9)
    assert steady_timestep(space, TIMESTEP) < TIMESTEP


def test_an_explicit_step_is_a_share_of_the_fastest_decay():
    """Of one node in closed form; of universal nodes in gimbal lock, between two dampers, their own inertia counts."""
    for b in (1e-4, 5e-2):
        node = WhipParameters(N=1, l=0.3, m=0.02, k=(0.1,), b=(b,))
        fastest = np.abs(np.roots([0.02 * 0.3**2, b, 0.1 + 0.02 * G * 0.3])).max()
        assert explicit_timestep(Model(node, ARM)) == pytest.approx(2 / fastest, rel=1e-9)
    rope = preset("ur5e").whip
    inertia, b = rope.per_node("node_inertia"), rope.per_node("b")
    assert explicit_timestep(preset("ur5e")) == pytest.approx((inertia[b > 0] / b[b > 0]).min(), rel=1e-9)
    assert explicit_timestep(preset("nah2023")) < 1e-4
    rods = dataclasses.replace(rope, joints="rod", node_inertia=0.0)
    assert explicit_timestep(dataclasses.replace(preset("ur5e"), whip=rods)) > 2e-3


def test_a_whip_in_space_has_every_mode_of_the_plane_twice():
    planar = preset("lemon2024")
    space = Model(dataclasses.replace(planar.whip, joints="universal", node_inertia=0.0), in_space(ARM))
    flat, both = hanging_modes(planar), hanging_modes(space)
    np.testing.assert_allclose(both.frequencies, np.repeat(flat.frequencies, 2), rtol=1e-9)
    rods = dataclasses.replace(space, whip=dataclasses.replace(space.whip, joints="rod"))
    with pytest.raises(InputError, match="universal"):
        linearise(rods, np.zeros(rods.n))
