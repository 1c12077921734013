"""The arm in Pinocchio against closed forms, finite differences, and Lagrange's equations."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from lagrangian import lagrangian_dynamics
from shared_by_threads import check_shared

from whiptool.dynamics.chain import Chain, mass_matrix, potential_energy
from whiptool.impedance.arm import Arm
from whiptool.models.parameters import ArmLink, ArmParameters, Model
from whiptool.models.presets import PRESETS, preset
from whiptool.models.whip import WhipParameters

STATES = 20


def random_arm(joints: int) -> Model:
    """An arm of any size whose links are no uniform rods, with friction, on a planet of its own; the whip has a mass
    on its hinge."""
    rng = np.random.default_rng(joints)
    links = tuple(
        ArmLink(
            mass=rng.uniform(0.2, 2),
            length=(length := rng.uniform(0.2, 0.4)),
            com=length * rng.uniform(0.2, 0.8),
            inertia=rng.uniform(1e-3, 1e-2),
            friction=rng.uniform(0.01, 0.2),
        )
        for _ in range(joints)
    )
    whip = WhipParameters(N=3, l=0.1, m=(0.05, 0.03, 0.02), k=0.1, b=0.01, hinge_mass=0.07)
    return Model(whip, ArmParameters(links), gravity=8.0, name=f"{joints} joints")


PLANAR = [model for model in PRESETS.values() if model.dimension == 2]
MODELS = [*PLANAR, *(random_arm(joints) for joints in (1, 2, 3, 4))]
every_model = pytest.mark.parametrize("model", MODELS, ids=lambda model: model.name)
two_joints = pytest.mark.parametrize("model", [m for m in MODELS if m.arm.n == 2], ids=lambda model: model.name)


def states(model: Model, size: int = STATES) -> np.ndarray:
    return np.random.default_rng(0).uniform(-np.pi, np.pi, (size, model.arm.n))


def chain_with_load(model: Model, load: float, gravity: float) -> Chain:
    """The bare arm with a point mass at its hand, as one more link without length."""
    zeros = np.zeros(model.arm.n + 1)
    link = {name: model.arm.per_link(name) for name in ("length", "mass", "com", "inertia")}
    return Chain(
        length=np.r_[link["length"], 0.0],
        mass=np.r_[link["mass"], load],
        com=np.r_[link["com"], 0.0],
        inertia=np.r_[link["inertia"], 0.0],
        stiffness=zeros,
        damping=zeros,
        rest_angle=zeros,
        dry_friction=zeros,
        drag=zeros,
        cubic_stiffness=zeros,
        gravity=gravity,
    )


def weight_points(model: Model, q: np.ndarray) -> np.ndarray:
    """Centres of mass and hand [m], (n + 1, 2)."""
    theta = np.cumsum(q)
    along = np.stack([np.sin(theta), -np.cos(theta)], axis=1)  # (n, 2)
    ends = np.cumsum(model.arm.per_link("length")[:, None] * along, axis=0)
    joints = np.vstack([np.zeros(2), ends[:-1]])
    return np.vstack([joints + model.arm.per_link("com")[:, None] * along, ends[-1]])


@every_model
def test_gravity_compensation_is_the_gradient_of_the_potential(model: Model):
    n = model.arm.n
    q = ca.SX.sym("q", n)
    chain = chain_with_load(model, model.whip.mass, model.gravity)
    gradient = ca.Function("g", [q], [ca.gradient(potential_energy(chain, ca.vertcat(q, 0)), q)])
    arm = Arm(model)
    for state in states(model):
        ours = arm.gravity_compensation(state)
        assert ours.shape == (n,)
        np.testing.assert_allclose(ours, np.array(gradient(state))[:, 0], rtol=0, atol=1e-12)


@two_joints
def test_gravity_compensation_in_closed_form(model: Model):
    (m1, m2), (l1, l2), (c1, c2) = (model.arm.per_link(name) for name in ("mass", "length", "com"))
    g, arm = model.gravity, Arm(model)
    w = model.whip.per_node("m").sum() + model.whip.hinge_mass
    for q in states(model):
        elbow = (m2 * c2 + w * l2) * g * np.sin(q[0] + q[1])
        shoulder = (m1 * c1 + (m2 + w) * l1) * g * np.sin(q[0]) + elbow
        np.testing.assert_allclose(arm.gravity_compensation(q), [shoulder, elbow], rtol=0, atol=1e-13)


@two_joints
def test_inertia_in_closed_form(model: Model):
    (m1, m2), (c1, c2), (I1, I2) = (model.arm.per_link(name) for name in ("mass", "com", "inertia"))
    l1, arm = model.arm.links[0].length, Arm(model)
    for q in states(model):
        coupling = m2 * l1 * c2 * np.cos(q[1])
        elbow = I2 + m2 * c2**2
        shoulder = I1 + m1 * c1**2 + m2 * l1**2 + elbow + 2 * coupling
        closed = [[shoulder, elbow + coupling], [elbow + coupling, elbow]]
        np.testing.assert_allclose(arm.inertia(q), closed, rtol=1e-13, atol=0)


@every_model
def test_inertia_is_the_chains_and_knows_nothing_of_the_whip(model: Model):
    n = model.arm.n
    q = ca.SX.sym("q", n + 1)
    matrix = ca.Function("M", [q], [mass_matrix(chain_with_load(model, 0.0, 9.81), q)[:n, :n]])
    for state in states(model):
        np.testing.assert_allclose(Arm(model).inertia(state), matrix(np.r_[state, 0]), rtol=1e-12, atol=1e-15)


@every_model
def test_gravity_jacobians_are_the_slopes_of_positions(model: Model):
    n, arm, step = model.arm.n, Arm(model), 1e-6
    for q in states(model):
        J = arm.gravity_jacobians(q)
        assert J.shape == (n + 1, 2, n)
        for j in range(n):
            d = step * np.eye(n)[j]
            slope = (weight_points(model, q + d) - weight_points(model, q - d)) / (2 * step)
            np.testing.assert_allclose(J[:, :, j], slope, rtol=0, atol=1e-9)


@every_model
def test_feedforward_is_what_lagrange_asks_for(model: Model):
    """`I(q) a` with velocity and friction terms; gravity switched off, and no load at the hand."""
    n, arm, rng = model.arm.n, Arm(model), np.random.default_rng(1)
    q, v = ca.SX.sym("q", n), ca.SX.sym("v", n)
    loaded = chain_with_load(model, 0.0, 0.0)
    bare = Chain(**{name: getattr(loaded, name)[:n] for name in list(Chain.__dataclass_fields__)[:10]}, gravity=0.0)
    M, r = lagrangian_dynamics(bare, ca.SX.zeros(n), q, v)
    f = ca.Function("f", [q, v], [M, r])
    moved_by_velocity = 0.0
    for state in states(model):
        speed, acceleration = rng.uniform(-5, 5, n), rng.uniform(-50, 50, n)
        M, r = (np.array(x) for x in f(state, speed))
        expected = M @ acceleration - r[:, 0] + model.arm.per_link("friction") * speed
        ours = arm.feedforward(state, speed, acceleration)
        np.testing.assert_allclose(ours, expected, rtol=0, atol=1e-12 * np.abs(expected).max())
        moved_by_velocity = max(moved_by_velocity, np.abs(r).max())
    assert n == 1 or moved_by_velocity > 0.1


def test_feedforward_of_a_pendulum():
    link = ArmLink(mass=2.0, length=0.5, com=0.3, inertia=0.04, friction=0.7)
    model = Model(WhipParameters(N=1, l=0.1, m=0.5, k=0, b=0), ArmParameters((link,)))
    torque = Arm(model).feedforward(np.array([0.4]), np.array([1.5]), np.array([-3.0]))
    np.testing.assert_allclose(torque, [(0.04 + 2 * 0.3**2) * -3.0 + 0.7 * 1.5], rtol=1e-13)
    weight = Arm(model).gravity_compensation(np.array([0.4]))
    np.testing.assert_allclose(weight, [(2 * 0.3 + 0.5 * 0.5) * 9.81 * np.sin(0.4)], rtol=1e-13)


@pytest.mark.parametrize("name", ["lemon2024", "ur5e"])
def test_threads_may_share_an_arm(name: str):
    arm = Arm(preset(name))

    def told(q):
        hand = arm.hand(q)
        motion = hand.position, hand.rotation, hand.jacobian
        return *motion, arm.gravity_jacobians(q), arm.inertia(q), arm.gravity_compensation(q), arm.feedforward(q, q, q)

    check_shared(told, np.random.default_rng(0).normal(size=(2000, arm.n)))
