"""Chains in space: against MuJoCo and Pinocchio, by their energy, and as a case of the plane."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest
from dense_inverse import inverse_dynamics
from random_space import (
    bent,
    by_mujoco,
    by_pinocchio,
    drag_torque,
    loop_of,
    node_jacobians,
    passive,
    pinocchio_of,
    random_model,
    random_state,
)

from whiptool.dynamics.closed_loop import closed_loop
from whiptool.dynamics.modes import linearise
from whiptool.dynamics.posture import start_posture
from whiptool.dynamics.structure import Structure
from whiptool.impedance.arm import Arm
from whiptool.impedance.controller import Controller
from whiptool.impedance.laws import OIAC, ConstantImpedance
from whiptool.models.parameters import Model, in_space
from whiptool.models.presets import preset
from whiptool.models.strike import Strike

LARGE = [pytest.param(a, N, marks=pytest.mark.slow) for a, N in ((6, 10), (4, 25), (7, 20), (7, 23))]
SIZES = [(1, 1), (1, 6), (2, 3), (3, 5), (3, 12), (5, 4), *LARGE]


def mass_matrix(loop, at: np.ndarray, p: np.ndarray) -> np.ndarray:
    """The joint-space mass matrix (n, n) [kg m^2], as the Hessian of the kinetic energy by the speeds."""
    q, v = ca.SX.sym("q", loop.n), ca.SX.sym("v", loop.n)
    T, _ = loop.energies(q, v, loop.p)
    return ca.Function("mass_matrix", [q, loop.p], [ca.hessian(T, v)[0]], {"cse": True})(at, p).full()


def worst(ours: np.ndarray, its: np.ndarray) -> float:
    """Largest difference, relative to the largest entry."""
    return float(np.abs(ours - its).max() / np.abs(its).max())


@pytest.mark.slow
@pytest.mark.parametrize(("a", "N"), SIZES)
def test_three_engines_agree_on_accelerations(a: int, N: int):
    """Random arms of 1 to 7 joints, some of which slide, with whips of up to 50 universal hinges: to 1e-9."""
    for seed in range(4):
        model = random_model(seed, a, N)
        loop, p = loop_of(model)
        for state in range(3):
            q, v, tau = random_state(model, state)
            ours = loop.acceleration(np.r_[q, v], 0, p, tau).full()[:, 0]
            assert worst(ours, by_mujoco(model, q, v, tau)) < 1e-9
            assert worst(ours, by_pinocchio(model, q, v, tau)) < 1e-9


@pytest.mark.parametrize(("a", "N"), [(1, 6), (4, 5)])
def test_three_engines_agree_on_bent_whips(a: int, N: int):
    """Each hinge of a node has its own angle at which its spring is slack."""
    for seed in range(3):
        straight = random_model(seed, a, N)
        model = bent(straight, seed)
        loop, p = loop_of(model)
        q, v, tau = random_state(model, seed)
        ours = loop.acceleration(np.r_[q, v], 0, p, tau).full()[:, 0]
        assert worst(ours, by_mujoco(model, q, v, tau)) < 1e-9
        assert worst(ours, by_pinocchio(model, q, v, tau)) < 1e-9
        assert worst(ours, by_mujoco(straight, q, v, tau)) > 1e-3


@pytest.mark.parametrize(("a", "N"), [(2, 4), (6, 8)])
def test_drag_and_dry_friction_are_what_virtual_work_says(a: int, N: int):
    for seed in range(4):
        model = random_model(seed, a, N, forces=True)
        loop, p = loop_of(model)
        q, v, tau = random_state(model, seed)
        ours = loop.acceleration(np.r_[q, v], 0, p, tau).full()[:, 0]
        assert worst(ours, by_pinocchio(model, q, v, tau)) < 1e-9
        assert worst(ours, by_mujoco(model, q, v, tau)) > 1e-6  # they do act


@pytest.mark.parametrize(("a", "N"), [(2, 3), (7, 8)])
def test_energies_and_mass_matrix_are_pinocchios(a: int, N: int):
    for seed in range(4):
        model = random_model(seed, a, N)
        loop, p = loop_of(model)
        q, v, _ = random_state(model, seed)
        its = pinocchio_of(model)
        data = its.createData()
        T, V = (float(x) for x in loop.energies(q, v, p))
        k, cubic = (np.repeat(model.whip.per_node(x), 2) for x in ("k", "cubic_stiffness"))
        springs = k @ q[a:] ** 2 / 2 + cubic @ q[a:] ** 4 / 4
        M = pin.crba(its, data, q)
        M = np.triu(M) + np.triu(M, 1).T
        assert pytest.approx(v @ M @ v / 2, rel=1e-12) == T
        assert pytest.approx(pin.computePotentialEnergy(its, data, q) + springs, rel=1e-12, abs=1e-12) == V
        assert worst(mass_matrix(loop, q, p), M) < 1e-12


@pytest.mark.parametrize("seed", range(3))
def test_inverse_dynamics_undoes_forward_dynamics(seed: int):
    """And linearised, it is the differences' slope of the accelerations."""
    model = random_model(seed, 4, 5, forces=True)
    loop, p = loop_of(model)
    q, v, tau = random_state(model, seed)
    n = model.n
    s = [ca.SX.sym(name, n) for name in "qva"]
    inverse = ca.Function("inverse", [*s, loop.p], [inverse_dynamics(loop, *s)])
    a = loop.acceleration(np.r_[q, v], 0, p, tau).full()[:, 0]
    found = inverse(q, v, a, p).full()[:, 0]
    assert np.abs(found - np.r_[tau, np.zeros(10)]).max() < 1e-9
    linear = linearise(model, q, v)
    np.testing.assert_allclose(linear.M, mass_matrix(loop, q, p), rtol=1e-9, atol=1e-12)
    h = 1e-6
    for matrix, k in ((linear.K, 0), (linear.C, 1)):
        for j in range(n):
            sides = []
            for sign in (1, -1):
                state = [q.copy(), v.copy()]
                state[k][j] += sign * h
                sides.append(inverse(*state, 0, p).full()[:, 0])
            np.testing.assert_allclose(matrix[:, j], (sides[0] - sides[1]) / (2 * h), rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize("seed", range(4))
def test_power_of_all_forces_is_the_rate_of_energy(seed: int):
    model = random_model(seed, 4, 6, forces=True)
    loop, p = loop_of(model)
    q, v, tau = random_state(model, seed)
    a = loop.acceleration(np.r_[q, v], 0, p, tau).full()[:, 0]
    h = 1e-6
    ends = [[float(x) for x in loop.energies(q + s * h * v, v + s * h * a, p)] for s in (-1, 1)]
    rate = (sum(ends[1]) - sum(ends[0])) / (2 * h)
    its = pinocchio_of(model)
    k, cubic = (np.repeat(model.whip.per_node(x), 2) for x in ("k", "cubic_stiffness"))
    lossy = passive(model, q, v) + np.r_[np.zeros(4), k * q[4:] + cubic * q[4:] ** 3]
    power = (np.r_[tau, np.zeros(12)] + lossy + drag_torque(its, model, q, v)) @ v
    assert rate == pytest.approx(power, rel=1e-6, abs=1e-6 * abs(ends[0][0]))


def conservative(model: Model) -> Model:
    links = tuple(replace(link, friction=0.0) for link in model.arm.links)
    return replace(model, whip=replace(model.whip, b=0.0), arm=replace(model.arm, links=links))


def roll(model: Model, x0: np.ndarray, h: float, steps: int) -> np.ndarray:
    """States (steps + 1, 2 n) of the loop without torques."""
    loop, p = loop_of(model)
    none, states = np.zeros(model.arm.n), [x0]
    for i in range(steps):
        states.append(loop.step(states[-1], i * h, h, p, none, none)[0].full()[:, 0])
    return np.array(states)


@pytest.mark.parametrize(("seed", "a"), [(0, 1), (1, 3), pytest.param(2, 4, marks=pytest.mark.slow)])
def test_energy_error_shrinks_with_the_second_order_or_faster(seed: int, a: int):
    """0.2 s of free motion in space, everything dissipative off."""
    model = conservative(random_model(seed, a, 4))
    n, (loop, p) = model.n, loop_of(model)
    rng = np.random.default_rng(seed)
    x0 = np.r_[start_posture(model, rng.uniform(-0.5, 0.5, (1, a)))[0], rng.uniform(-2, 2, n)]
    errors = []
    for h in (4e-4, 2e-4, 1e-4):
        states = roll(model, x0, h, round(0.2 / h))[:: round(0.02 / h)]
        T, V = np.array([[float(x) for x in loop.energies(x[:n], x[n:], p)] for x in states]).T
        assert np.ptp(T) > 0.01  # energy does change its form
        errors.append(np.abs(T + V - T[0] - V[0]).max())
    assert np.log2(np.array(errors[:-1]) / errors[1:]).min() >= 1.9
    assert errors[-1] < 1e-4 * np.ptp(T)


# ---------------------------------------------------------------------------------------------------------------------
# The plane is a case


def put_in_space(model: Model) -> Model:
    """The same planar model as one in space, of universal nodes."""
    return replace(model, arm=in_space(model.arm), whip=replace(model.whip, joints="universal"))


@pytest.mark.parametrize("law", ["constant", "oiac"])
def test_a_planar_state_moves_in_space_as_in_the_plane(law: str):
    """One step with everything that a whip can have, at random states of the plane: to 1e-10."""
    base = preset("lemon2024")
    whip = replace(base.whip, N=6, drag=2e-3, drag_ratio=0.3, dry_friction=5e-3, cubic_stiffness=0.05, hinge_mass=0.01)
    whip = replace(whip, rest_angle=(0.1, 0.2, -0.3, 0.1, 0.2, -0.1))
    planar = replace(base, whip=whip)
    controller = Controller(
        ConstantImpedance() if law == "constant" else OIAC(a=5e-3), feedforward=True, torque_limit=5.0
    )
    a, N, rng = 2, 6, np.random.default_rng(0)
    strike = np.array([[-1.0, 1.0, 1.5, 0.5, 0.6]])
    steps, numbers = [], []
    for model in (planar, put_in_space(planar)):
        structure = Structure.of(model, controller)
        steps.append(closed_loop(structure).step)
        numbers.append(structure.pack(model, controller, strike)[0])
    flat = np.r_[np.arange(a), a + 1 + 2 * np.arange(N)]  # the hinges of the plane
    for _ in range(5):
        q, v = rng.uniform(-1, 1, a + N), rng.uniform(-4, 4, a + N)
        n = a + 2 * N
        x = np.zeros(2 * n)
        x[flat], x[n + flat] = q, v
        t = rng.uniform(0, 0.7)
        ours, tip, tau, _ = (y.full()[:, 0] for y in steps[0](np.r_[q, v], t, 1e-3, numbers[0], [], []))
        its, tip3, tau3, _ = (y.full()[:, 0] for y in steps[1](x, t, 1e-3, numbers[1], [], []))
        assert np.abs(its[np.r_[flat, n + flat]] - ours).max() < 1e-10
        assert np.abs(np.delete(its, np.r_[flat, n + flat])).max() == 0
        assert np.abs(tip3[[0, 2, 3, 5]] - tip).max() < 1e-10
        assert np.abs(tau3 - tau).max() < 1e-10


# ---------------------------------------------------------------------------------------------------------------------
# Control


@pytest.mark.parametrize("a", [1, 4, 7])
@pytest.mark.parametrize("options", [{}, {"feedforward": True}, {"compensated": True}, {"torque_limit": 3.0}])
def test_the_controller_is_the_numpy_one(a: int, options: dict):
    """Torques of a strike, by CasADi and by NumPy and Pinocchio."""
    rng = np.random.default_rng(a)
    if "compensated" in options:
        options = {"compensated": tuple(rng.uniform(0.5, 2, a + 1))}
    root = rng.normal(0, 1, (a, a))
    laws = (
        OIAC(a=5e-3),
        ConstantImpedance(K=tuple(map(tuple, root @ root.T)), B=tuple(map(tuple, 0.1 * root @ root.T))),
    )
    for seed, law in enumerate(laws):
        model = random_model(seed, a, 3)
        bare = replace(model.arm, links=tuple(replace(link, armature=0.0) for link in model.arm.links))
        model = replace(model, arm=bare if "feedforward" in options else model.arm)
        controller = Controller(law, control_period=0.01, **options)
        strike = Strike(tuple(rng.uniform(-1, 1, a)), tuple(rng.uniform(-1, 1, a)), 0.7)
        q, v, _ = random_state(model, seed)
        structure = Structure.of(model, controller)
        p = structure.pack(model, controller, strike.vector[None])[0]
        ours = closed_loop(structure).control(np.r_[q, v], 0.3, p).full()[:, 0]
        its = controller.bind(Arm(model), strike).torque(0.3, q[:a], v[:a])
        np.testing.assert_allclose(ours, its, rtol=1e-10, atol=1e-10 * np.abs(its).max())


def test_places_and_velocities_are_those_of_the_nodes():
    model = random_model(3, 4, 5)
    loop, p = loop_of(model)
    q, v, tau = random_state(model, 0)
    _, tip, _, seen = (x.full()[:, 0] for x in loop.step(np.r_[q, v], 0, 1e-3, p, tau, tau))
    jacobians = node_jacobians(pinocchio_of(model), model, q)
    np.testing.assert_allclose(tip[3:], jacobians[-1] @ v, rtol=1e-10, atol=1e-12)
    places = seen.reshape(-1, 3)
    assert places.shape == (4 + 5, 3)
    np.testing.assert_array_equal(places[-1], tip[:3])
    lengths = np.linalg.norm(np.diff(places[3:], axis=0), axis=1)
    np.testing.assert_allclose(lengths, model.whip.per_node("l"), rtol=1e-12)
