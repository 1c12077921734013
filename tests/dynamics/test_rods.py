"""Whips of rods: against point masses on constraints solved densely, their energy, and universal joints."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest
from random_space import loop_of, pinocchio_arm_of, random_arm, random_rods, random_whip
from slopes import compare
from start_slopes import check_start_slopes

from whiptool.dynamics import rods
from whiptool.dynamics.posture import start_posture
from whiptool.dynamics.rods import rod_damping
from whiptool.impedance.controller import Controller
from whiptool.impedance.laws import ConstantImpedance
from whiptool.models.kinematics import arm_frames
from whiptool.models.parameters import Model
from whiptool.models.spatial_arm import SpatialArm, SpatialLink
from whiptool.models.whip import WhipParameters
from whiptool.rollout.compiled import CompiledRollout
from whiptool.rollout.engine import RUNGS


def random_state(model: Model, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Joints and unit vectors, their rates, the arm's torques."""
    a, N, rng = model.arm.n, model.whip.N, np.random.default_rng(seed)
    d = rng.normal(size=(N, 3))
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    rate = np.cross(rng.uniform(-4, 4, (N, 3)), d)
    q, v = rng.uniform(-1, 1, a), rng.uniform(-2, 2, a)
    return np.r_[q, d.ravel()], np.r_[v, rate.ravel()], rng.uniform(-1, 1, a)


def forces_of(model: Model) -> ca.Function:
    """Forces on the hand (3, 1), its moment (3, 1), and forces on the nodes (3, N), of bending and damping:
    slopes of energy and dissipation by the places and velocities of point masses."""
    N, whip = model.whip.N, model.whip
    x, u = ca.SX.sym("x", 3, N + 1), ca.SX.sym("u", 3, N + 1)
    first, turning = ca.SX.sym("first", 3), ca.SX.sym("turning", 3)
    k, cubic = (whip.per_node(name) for name in ("k", "cubic_stiffness"))
    V, last = ca.SX(0), first
    for i in range(N):
        r = x[:, i + 1] - x[:, i]
        d = r / ca.norm_2(r)
        w = 1 - ca.dot(last, d)
        half_square = w + w**2 / 6 + 2 * w**3 / 45
        V += k[i] * half_square + cubic[i] * half_square**2
        last = d
    D = dissipation_of(model, x, u, turning)
    force = -ca.gradient(V, x) - ca.gradient(D[0], u)
    moment = -ca.cross(first, ca.gradient(V, first)) - ca.gradient(D[0], turning)
    return ca.Function("forces", [x, u, first, turning], ca.substitute([force, moment], [D[1]], [D[2]]))


def dissipation_of(model: Model, x: ca.SX, u: ca.SX, turning: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
    """Half the power that damping takes, least by the spin; its dampings' symbols (N, 1); and what these are."""
    N, whip = model.whip.N, model.whip
    spin, damping, secants = ca.SX.sym("spin"), ca.SX.sym("damping", N), []
    r, rate = ca.horzsplit(x[:, 1:] - x[:, :-1]), ca.horzsplit(u[:, 1:] - u[:, :-1])
    d = [y / ca.norm_2(y) for y in r]
    D, W, last = rods.SWIVEL * spin**2 / 2, [], None
    for i in range(N):
        w = ca.cross(r[i], rate[i]) / ca.sumsqr(r[i])
        if last is None:  # the hand's spin, and what is free of it; the joint's damper does not brake spin
            slip = ca.sumsqr(w - turning + ca.dot(turning, d[0]) * d[0])
            W.append(w + (ca.dot(turning, d[0]) + spin) * d[0])
        else:
            past = w - W[-1] + ca.dot(W[-1], d[i]) * d[i]
            near = 1 + ca.dot(d[i], last)
            past -= near**3 / (near**4 + rods.FOLD**4) * ca.dot(past, last) * d[i]  # all but none along d + last
            slip = ca.sumsqr(past)
            W.append(W[-1] + past)
        last = d[i]
        D += damping[i] * slip / 2
        root = ca.sqrt(ca.substitute(slip, spin, 0) + whip.friction_velocity**2)
        secants.append(whip.per_node("b")[i] + whip.per_node("dry_friction")[i] / root)
    slope, curvature = (ca.substitute(y, spin, 0) for y in (ca.jacobian(D, spin), ca.hessian(D, spin)[0]))
    return ca.substitute(D, spin, -slope / curvature), damping, ca.vertcat(*secants)


def dense_acceleration(model: Model, q: np.ndarray, v: np.ndarray, tau: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Accelerations of the arm's joints (a,) and of the rods' directions (N, 3): point masses at fixed distances, with
    Lagrange multipliers, solved together."""
    a, N, whip = model.arm.n, model.whip.N, model.whip
    l, m = whip.per_node("l"), whip.per_node("m")
    d, rate = q[a:].reshape(N, 3), v[a:].reshape(N, 3)
    arm = pinocchio_arm_of(model)
    data = arm.createData()
    M = pin.crba(arm, data, q[:a])
    M = np.triu(M) + np.triu(M, 1).T
    bias = pin.nonLinearEffects(arm, data, q[:a], v[:a])
    hand = hand_place(arm, model, q[:a])
    J = hand_jacobian(arm, q[:a], hand)
    h = 1e-6
    near = [q[:a] + sign * h * v[:a] for sign in (1, -1)]
    ahead, behind = (hand_jacobian(arm, x, hand_place(arm, model, x)) for x in near)
    drift = ((ahead - behind) / (2 * h) @ v[:a])[:3]
    x = np.vstack([hand.translation, hand.translation + np.cumsum(l[:, None] * d, axis=0)])
    u = np.vstack([J[:3] @ v[:a], J[:3] @ v[:a] + np.cumsum(l[:, None] * rate, axis=0)])
    force, moment = (y.full() for y in forces_of(model)(x.T, u.T, -hand.rotation[:, 2], J[3:] @ v[:a]))
    nodes = force.T[1:] - m[:, None] * np.array([0, 0, model.gravity])
    speed = np.linalg.norm(u[1:], axis=1, keepdims=True)
    along = (u[1:] * d).sum(axis=1, keepdims=True) * d
    nodes = nodes - whip.per_node("drag")[:, None] * speed * (u[1:] - along + whip.drag_ratio * along)
    applied = tau - model.arm.per_link("friction") * v[:a] - bias + J.T @ np.r_[force[:, 0], moment[:, 0]]

    size = a + 4 * N  # arm, nodes, multipliers
    A, right = np.zeros((size, size)), np.zeros(size)
    A[:a, :a], right[:a] = M, applied
    A[a : a + 3 * N, a : a + 3 * N] = np.diag(np.repeat(m, 3))
    right[a : a + 3 * N] = nodes.ravel()
    for i in range(N):
        row, own = a + 3 * N + i, slice(a + 3 * i, a + 3 * i + 3)
        A[row, own] = d[i]
        right[row] = -l[i] * rate[i] @ rate[i]
        if i:
            A[row, a + 3 * i - 3 : a + 3 * i] = -d[i]
        else:
            A[row, :a] = -d[i] @ J[:3]
            right[row] += d[i] @ drift
    A[:, a + 3 * N :] += A[a + 3 * N :, :].T
    found = np.linalg.solve(A, right)
    places = np.vstack([J[:3] @ found[:a] + drift, found[a : a + 3 * N].reshape(N, 3)])
    return found[:a], np.diff(places, axis=0) / l[:, None]


def hand_place(arm: pin.Model, model: Model, q: np.ndarray) -> pin.SE3:
    data = arm.createData()
    pin.forwardKinematics(arm, data, q)
    return data.oMi[arm.njoints - 1] * pin.SE3(np.array(model.arm.hand_rotation), np.array(model.arm.hand_position))


def hand_jacobian(arm: pin.Model, q: np.ndarray, hand: pin.SE3) -> np.ndarray:
    """Of the hand, linear first, (6, a)."""
    data = arm.createData()
    pin.computeJointJacobians(arm, data, q)
    J = pin.getJointJacobian(arm, data, arm.njoints - 1, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED)
    J = J.reshape(6, -1)
    r = hand.translation - data.oMi[arm.njoints - 1].translation
    return np.vstack([J[:3] - pin.skew(r) @ J[3:], J[3:]])


LARGE = [pytest.param(a, N, marks=pytest.mark.slow) for a, N in ((7, 12), (4, 25))]


@pytest.mark.parametrize(("a", "N"), [(1, 1), (2, 3), (3, 6), *LARGE])
def test_a_dense_solve_with_multipliers_gives_the_same_accelerations(a: int, N: int):
    """Point masses at fixed distances, forces from energy and dissipation; the hand's drift is a difference of 1e-9."""
    for seed in range(3):
        model = random_rods(seed, a, N)
        loop, p = loop_of(model)
        q, v, tau = random_state(model, seed)
        ours = loop.acceleration(np.r_[q, v], 0, p, tau).full()[:, 0]
        qdd, turning = dense_acceleration(model, q, v, tau)
        assert np.abs(ours[:a] - qdd).max() < 1e-9 * np.abs(qdd).max()
        assert np.abs(ours[a:].reshape(N, 3) - turning).max() < 1e-9 * np.abs(turning).max()


def fixed_arm() -> SpatialArm:
    """One joint about -y, too heavy to move."""
    link = SpatialLink(1e12, (0, 0, 0), (1e12, 1e12, 1e12, 0, 0, 0), (0, -1, 0), (0, 0, 0))
    return SpatialArm((link,))


WITHOUT = {"b": 0.0, "dry_friction": 0.0}


def turned_rigidly(model: Model, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """A bent whip that turns with the arm's only joint: joint and unit vectors, and their rates."""
    q, _, _ = random_state(model, seed)
    axis = np.array(model.arm.links[0].axis)
    return q, np.r_[3.0, 3.0 * np.cross(axis, q[1:].reshape(-1, 3)).ravel()]


def test_a_bent_whip_that_turns_as_a_whole_is_not_damped():
    """The joint's axis is across some rods, along others, in between with most: all of the whip turns about it."""
    model = replace(random_rods(0, 1, 8), arm=fixed_arm())
    damped, free = (replace(model, whip=replace(model.whip, **changes)) for changes in ({}, WITHOUT))
    assert damped.whip.per_node("b").min() > 0
    q, v = turned_rigidly(model, 0)
    (loop, p), (without, p_free) = loop_of(damped), loop_of(free)
    ours = loop.acceleration(np.r_[q, v], 0, p, [0.0]).full()
    its = without.acceleration(np.r_[q, v], 0, p_free, [0.0]).full()
    assert np.abs(ours - its).max() < 1e-9 * np.abs(its).max()
    frame = arm_frames(model.arm, q[:1], v[:1])[-1]
    hand, spin = -frame.rotation[:, 2], frame.spin
    directions = np.vstack([hand, q[1:].reshape(-1, 3)])
    turns = np.vstack([spin, np.cross(directions[1:], v[1:].reshape(-1, 3))])
    power = rod_damping(model.whip, directions, turns).power
    assert np.abs(power).max() < 1e-20
    turns[4] += np.cross(directions[4], [1.0, 0, 0])
    assert rod_damping(model.whip, directions, turns).power.sum() > 1e-3  # where not all turns together


@pytest.mark.parametrize("seed", range(3))
def test_damping_takes_the_power_of_its_dissipation_and_brakes_no_spin(seed: int):
    """Its torques' work on hand and rods is minus the power; none is along a rod between two, and 1e-9 at the hand."""
    model = random_rods(seed, 1, 7)
    rng = np.random.default_rng(seed)
    directions = rng.normal(size=(5, 8, 3))
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    turns = rng.uniform(-4, 4, (5, 8, 3))
    damping = rod_damping(model.whip, directions, turns)
    turns[:, 1:] -= (turns[:, 1:] * directions[:, 1:]).sum(axis=-1, keepdims=True) * directions[:, 1:]
    work = (damping.torques * np.diff(turns, axis=1)).sum(axis=(1, 2))
    np.testing.assert_allclose(work, -damping.power.sum(axis=1), rtol=1e-9)
    net = damping.torques - np.concatenate([damping.torques[:, 1:], np.zeros((5, 1, 3))], axis=1)
    assert np.abs((net * directions[:, 1:]).sum(axis=-1)).max() < 1e-12
    assert np.abs((damping.torques * directions[:, 1:])[:, 0].sum(axis=-1)).max() < 1e-6


def test_steps_are_implicit_in_friction_of_every_direction():
    """A joint that slips brakes what is across the slip by mu / |slip|, a hundred times more than what is along it; the
    inertia that a step adds has to cover both, or a light rod that slips makes the steps small."""
    b, mu, turn_over, h, zero = 1e-4, 1e-3, 0.1, 2e-3, ca.SX.zeros(3)
    joint = SimpleNamespace(stiffness=0.0, cubic_stiffness=0.0, damping=b, dry_friction=mu, friction_velocity=turn_over)
    slip = ca.SX.sym("slip", 3)
    hand = rods.RodFrame(ca.SX([0, 0.6, 0.8]), zero, zero, ca.SX.zeros(2), ca.SX(1), ca.SX(0), zero, zero)
    rod = hand._replace(direction=ca.SX([0, 0, 1]), speed=slip)
    _, torques, added = rods.torques_and_gain(joint, hand, rod, ca.SX(h), again=False)
    braked = ca.Function("braked", [slip], [-ca.jacobian(torques[:3, 0], slip), added / (rods.GAMMA * h)])
    for speed in (0.0, 0.05, 1.0, 20.0):
        slope, bound = (np.array(x) for x in braked([speed, 0.0, 0.0]))
        across = b + mu / np.hypot(speed, turn_over)
        np.testing.assert_allclose(slope[1, 1], across, rtol=1e-9)
        np.testing.assert_allclose(slope[0, 0], b + mu * turn_over**2 / np.hypot(speed, turn_over) ** 3, rtol=1e-9)
        assert np.linalg.eigvalsh(slope[:2, :2]).max() <= float(bound.item()) * (1 + 1e-9)


def test_in_the_plane_damping_is_that_of_the_angles_between_rods():
    model = random_rods(1, 1, 6)
    whip, rng = model.whip, np.random.default_rng(2)
    theta, omega = rng.uniform(-3, 3, 7), rng.uniform(-5, 5, 7)
    directions = np.c_[np.sin(theta), 0 * theta, -np.cos(theta)]
    turns = omega[:, None] * np.array([0, -1.0, 0])
    slip = np.diff(omega)
    root = np.sqrt(slip**2 + whip.friction_velocity**2)
    expected = -(whip.per_node("b") + whip.per_node("dry_friction") / root) * slip
    found = rod_damping(whip, directions, turns).torques
    np.testing.assert_allclose(found, expected[:, None] * np.array([0, -1.0, 0]), atol=1e-13)


def test_a_folding_rope_stays_bounded():
    """Rods that fold onto each other let twist slip, instead of spinning without bound."""
    whip = WhipParameters(N=3, l=0.1, m=0.01, k=0.0, b=1e-3, joints="rod")
    turns = np.random.default_rng(0).uniform(-5, 5, (4, 3))
    for near in (1e-2, 1e-5, 1e-9, 0.0):
        directions = np.array([[0, 0, -1], [0, 0, -1], [np.sin(near), 0, np.cos(near)], [1, 0, 0]])
        assert np.linalg.norm(rod_damping(whip, directions, turns).torques, axis=1).max() < 1e-3 * 50


def test_small_planar_motion_is_that_of_universal_joints_to_the_second_order():
    """What remains between the two models shrinks with the cube of the amplitude."""
    N, gaps = 5, []
    whip = WhipParameters(N=N, l=0.08, m=0.01, k=0.2, b=0.01, cubic_stiffness=0.1, joints="rod")
    models = [Model(whip, fixed_arm()), Model(replace(whip, joints="universal"), fixed_arm())]
    shape = np.random.default_rng(0).uniform(-1, 1, (2, N))
    for size in (0.2, 0.1, 0.05):
        theta, omega = np.cumsum(size * shape[0]), np.cumsum(size * shape[1])
        starts = [np.zeros(2 * (1 + 3 * N)), np.zeros(2 * (1 + 2 * N))]
        starts[0][1 : 1 + 3 * N] = np.c_[np.sin(theta), 0 * theta, -np.cos(theta)].ravel()
        starts[0][2 + 3 * N :] = np.c_[np.cos(theta) * omega, 0 * theta, np.sin(theta) * omega].ravel()
        starts[1][2 : 1 + 2 * N : 2] = size * shape[0]
        starts[1][3 + 2 * N :: 2] = size * shape[1]
        tips = []
        for model, x in zip(models, starts, strict=True):
            loop, p = loop_of(model)
            for i in range(100):
                x = loop.step(x, i * 1e-3, 1e-3, p, [0.0], [0.0])[0].full()[:, 0]
            tips.append(loop.step(x, 0, 1e-3, p, [0.0], [0.0])[1].full()[:3, 0])
        gaps.append(np.linalg.norm(tips[0] - tips[1]))
        assert gaps[-1] < 0.02 * size
    assert np.log2(np.array(gaps[:-1]) / gaps[1:]).min() > 2.8


@pytest.mark.parametrize(("seed", "a"), [pytest.param(0, 1, marks=pytest.mark.slow), (1, 3)])
def test_energy_error_shrinks_with_the_second_order_or_faster(seed: int, a: int):
    model = random_rods(seed, a, 5, forces=False)
    links = tuple(replace(link, friction=0.0) for link in model.arm.links)
    model = replace(model, whip=replace(model.whip, b=0.0), arm=replace(model.arm, links=links))
    loop, p = loop_of(model)
    q, v, _ = random_state(model, seed)
    q[a:] = start_posture(model, q[None, :a])[0, a:]
    v[a:] -= np.repeat((v[a:] * q[a:]).reshape(-1, 3).sum(axis=1), 3) * q[a:]
    n, errors = loop.n, []
    for h in (4e-4, 2e-4, 1e-4):
        x, E, T = np.r_[q, v], [], []
        for i in range(round(0.2 / h) + 1):
            T.append(float(loop.energies(x[:n], x[n:], p)[0]))
            E.append(T[-1] + float(loop.energies(x[:n], x[n:], p)[1]))
            d, rate = (y.reshape(-1, 3) for y in (x[a:n], x[n + a :]))
            assert np.abs((d**2).sum(axis=1) - 1).max() < 1e-14
            assert np.abs((d * rate).sum(axis=1)).max() < 1e-12
            x = loop.step(x, i * h, h, p, np.zeros(a), np.zeros(a))[0].full()[:, 0]
        assert np.ptp(T) > 0.01
        errors.append(np.abs(np.array(E) - E[0]).max())
    assert np.log2(np.array(errors[:-1]) / errors[1:]).min() >= 1.9
    assert errors[-1] < 1e-4 * np.ptp(T)


def test_steps_are_of_the_second_order_with_everything_that_brakes():
    """Richardson, with the hand in fast motion: its acceleration without that of the joints counts in both stages."""
    rng = np.random.default_rng(3)
    whip = replace(random_whip(rng, 6, forces=True), joints="rod", node_inertia=0.0, b=(0.02,) * 6)
    model = Model(whip, random_arm(rng, 3))
    loop, p = loop_of(model)
    q = start_posture(model, rng.uniform(-1, 1, (1, 3)))[0]
    ends = []
    for h in (1e-3, 5e-4, 2.5e-4, 1.25e-4):
        x = np.r_[q, 8.0, -12.0, 16.0, np.zeros(loop.n - 3)]  # the hand turns about a turning axis
        for i in range(round(0.1 / h)):
            torque = [np.array([8.0, -5.0, 3.0]) * np.cos(20 * t) for t in (i * h, (i + 1) * h)]
            x = loop.step(x, i * h, h, p, *torque)[0].full()[:, 0]
        ends.append(x[: loop.n])
    gaps = [np.abs(x - y).max() for x, y in pairwise(ends)]
    assert np.log2(np.array(gaps[:-1]) / gaps[1:]).min() > 1.7
    assert gaps[-1] < 1e-3


@pytest.mark.parametrize("sprung", [False, True])
def test_rods_start_in_static_balance_which_moves_as_differences_say(sprung: bool):
    model = random_rods(4, 3, 4)
    if not sprung:
        model = replace(model, whip=replace(model.whip, k=0.2, cubic_stiffness=0.0))
    q_i = np.array([0.3, -0.4, 0.6])
    q, (loop, p) = start_posture(model, q_i[None]), loop_of(model)
    d = q[0, 3:].reshape(-1, 3)
    np.testing.assert_allclose(np.linalg.norm(d, axis=1), 1, atol=1e-14)
    assert (np.abs(d - [0, 0, -1]).max() < 1e-12) != sprung
    # at rest only the arm moves: nothing pulls the whip
    locked = dense_acceleration(model, q[0], 0 * q[0], np.zeros(3))
    assert locked[1].shape == (4, 3)
    assert np.abs(loop.whip_balance(q[0], p, 0, 0)[0].full()).max() < 1e-12
    check_start_slopes(model, q_i, ["whip.m[3]" if sprung else "gravity"], rtol=1e-5)


MODEL = random_rods(2, 3, 4)
STRIKES = np.c_[np.random.default_rng(5).uniform(-0.8, 0.8, (24, 6)), np.full(24, 0.5)]
TARGETS = np.random.default_rng(6).uniform(-0.6, 0.6, (24, 3))
STIFF = tuple(map(tuple, 30 * np.eye(3)))
SOFT = tuple(map(tuple, 3 * np.eye(3)))
CONTROLLER = Controller(ConstantImpedance(K=STIFF, B=SOFT))


def test_all_engines_agree_on_rods():
    results = [
        CompiledRollout(MODEL, CONTROLLER, timestep=1e-3, engine=name).approach(STRIKES, TARGETS, t_stay=0.2)
        for name in RUNGS
    ]
    assert not results[0].diverged.any()
    for near in results[1:]:
        np.testing.assert_allclose(near.distance, results[0].distance, rtol=0, atol=1e-9)
        np.testing.assert_allclose(near.velocity, results[0].velocity, atol=1e-6)


@pytest.mark.slow
def test_derivatives_of_rods_against_central_differences():
    rollout = CompiledRollout(MODEL, CONTROLLER, timestep=1e-3)
    names = ["q_1i", "q_2f", "q_3f", "gravity", "whip.l[1]", "whip.m[3]", "whip.k[2]", "whip.b[1]", "whip.drag[2]"]
    names += ["whip.dry_friction[0]", "whip.cubic_stiffness[1]", "arm.mass[1]", "arm.com[2].x", "arm.hand_position.z"]
    slopes = rollout.gradient(STRIKES, TARGETS, t_stay=0.2, names=names)[1]
    columns = {"q_1i": 0, "q_2f": 4, "q_3f": 5}
    for slope, name in zip(slopes.T, names, strict=True):

        def distance(by: float, name: str = name) -> np.ndarray:
            shifted, model = STRIKES.copy(), MODEL
            if name in columns:
                shifted[:, columns[name]] += by
            else:
                model = MODEL.with_parameters({name: MODEL.parameters()[name] + by})
            return CompiledRollout(model, CONTROLLER, timestep=1e-3).approach(shifted, TARGETS, t_stay=0.2).distance

        value = 1.0 if name in columns else abs(MODEL.parameters()[name])
        wrong, still = compare(slope, distance, 3e-5 * max(0.03, value))
        assert not wrong.any(), name
        assert still.mean() > 0.8
        assert np.abs(slope).max() > 1e-9
