"""Chain dynamics against MuJoCo, Pinocchio and dense algebra, over random chains."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import casadi as ca
import mujoco
import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st
from lagrangian import tip_state
from random_chains import (
    POINT_INERTIA,
    VECTORS,
    Case,
    Key,
    accelerations,
    cases,
    drag_torque,
    end_jacobians,
    end_positions,
    evaluate,
    examples,
    friction_torque,
    mujoco_chain,
    numbers,
    pinocchio_of,
    spring_torque,
    symbols,
    terms,
    tolerance,
    worst,
)

from whiptool.dynamics.chain import (
    Chain,
    chain_of,
    forward_dynamics,
    inverse_dynamics,
    kinetic_energy,
    passive_torque,
    potential_energy,
    ride_on_end,
)
from whiptool.models.parameters import ArmLink, ArmParameters, Model
from whiptool.models.whip import WhipParameters
from whiptool.rollout.mujoco_model import build_spec

SHORT, LONG = st.integers(1, 14), st.integers(15, 30)


@cache
def round_trip(key: Key) -> ca.Function:
    s = symbols(key)
    return s.function(inverse_dynamics(s.chain, s.q, s.v, forward_dynamics(s.chain, s.q, s.v, s.tau)))


@cache
def energy_rate(key: Key) -> ca.Function:
    """Rates of kinetic and of potential energy [W] along the motion."""
    s = symbols(key)
    a = forward_dynamics(s.chain, s.q, s.v, s.tau + passive_torque(s.chain, s.q, s.v))
    T, V = kinetic_energy(s.chain, s.q, s.v), potential_energy(s.chain, s.q)
    return s.function(ca.jtimes(T, s.v, a) + ca.jtimes(T, s.q, s.v), ca.jtimes(V, s.q, s.v))


@cache
def with_armature(key: Key, armature: str) -> ca.Function:
    """Accelerations with an armature on no, every second or every joint."""
    s = symbols(key)
    extra = ca.SX.sym("extra", s.chain.n)
    used = ca.SX(extra)
    if armature == "some":
        used[::2] = 0
    options = {} if armature == "none" else {"armature": used}
    return s.function(forward_dynamics(s.chain, s.q, s.v, s.tau, **options), extra=(extra,))


# ---------------------------------------------------------------------------------------------------------------------
# Forward dynamics


@examples(150)
@given(cases(SHORT))
def test_three_engines_agree_up_to_14_joints(case: Case):
    """Chains of `numbers` with 1..14 links: to 1e-9 of the largest acceleration, with Pinocchio, whose algorithm is
    articulated-body too, to 1e-11."""
    ours, theirs, _ = accelerations(case)
    assert worst(ours, theirs["MuJoCo"]) < 1e-9
    assert worst(ours, theirs["Pinocchio"]) < 1e-11


@examples(50)
@given(cases(LONG))
@pytest.mark.slow
def test_three_engines_agree_up_to_the_condition_number(case: Case):
    """Chains of `numbers` with 15..30 links; with Pinocchio, whose algorithm is articulated-body too, to 1e-11."""
    ours, theirs, condition = accelerations(case)
    assert worst(ours, theirs["MuJoCo"]) < tolerance(condition)
    assert worst(ours, theirs["Pinocchio"]) < 1e-11


@examples(100)
@given(cases(SHORT))
def test_inverse_dynamics_undoes_forward_dynamics(case: Case):
    """Chains of `numbers` with 1..14 links: torques to 1e-9 of the largest."""
    x = numbers(case)
    assert worst(evaluate(round_trip(case.key), x)[0], x.tau) < 1e-9


# ---------------------------------------------------------------------------------------------------------------------
# Terms


@examples(100)
@given(cases(st.integers(1, 30), points=("none", "whip")))
def test_terms_agree_with_the_engines(case: Case):
    """Chains of `numbers` with 1..30 links: mass matrix, bias, energies, gradient, kinematics, to 1e-12 of the
    largest entry, torques to 1e-12 of the chain's weight and drag moments."""
    x, n = numbers(case, POINT_INERTIA), case.n
    M, bias, T, V, gradient, ends, tip, tip_velocity = evaluate(terms(case.heavy_key), x)
    M = M.reshape(n, n)

    model = pinocchio_of(x.chain)
    data = model.createData()
    crba = np.triu(pin.crba(model, data, x.q))
    crba += np.triu(crba, 1).T
    assert worst(M, crba) < 1e-12
    mj = mujoco_chain(x.chain)
    state = mujoco.MjData(mj)
    state.qpos[:], state.qvel[:] = x.q, x.v
    mujoco.mj_forward(mj, state)
    full = np.empty((n, n))
    mujoco.mj_fullM(mj, state, full)
    assert worst(M, full) < 1e-12

    drag = drag_torque(x)
    velocity_free = x.chain.gravity * x.chain.mass.sum() * x.chain.length.sum()
    scale = max(np.abs(bias).max(), velocity_free, np.abs(drag).max())
    assert np.abs(bias + drag - pin.nonLinearEffects(model, data, x.q, x.v)).max() < 1e-12 * scale
    assert np.abs(bias + drag - state.qfrc_bias).max() < 1e-12 * scale

    assert pytest.approx(pin.computeKineticEnergy(model, data, x.q, x.v), rel=1e-12) == T
    bent = x.q - x.chain.rest_angle
    springs = x.chain.stiffness @ bent**2 / 2 + x.chain.cubic_stiffness @ bent**4 / 4
    assert pytest.approx(pin.computePotentialEnergy(model, data, x.q) + springs, rel=1e-12, abs=1e-12 * scale) == V
    weight = pin.computeGeneralizedGravity(model, data, x.q)
    spring = spring_torque(x)
    assert np.abs(gradient + spring - weight).max() < 1e-12 * max(scale, np.abs(spring).max())

    assert np.abs(ends - end_positions(x.chain.length, x.q)).max() < 1e-13 * n
    assert np.abs(tip - ends[-1]).max() < 1e-13 * n
    assert np.abs(tip_velocity - end_jacobians(x.chain.length, x.q)[-1] @ x.v).max() < 1e-12 * n


@examples(60)
@given(cases(SHORT))
def test_gradient_of_potential_is_bias_at_rest_plus_springs(case: Case):
    """Chains of `numbers` with 1..14 links, at rest: dV/dq = bias - springs, to 1e-12 of the largest."""
    x = numbers(replace(case, moving=False))
    _, bias, _, _, gradient, *_ = evaluate(terms(case.key), x)
    assert worst(bias - spring_torque(x), gradient) < 1e-12


@examples(60)
@given(cases(SHORT))
def test_power_of_all_forces_is_the_rate_of_energy(case: Case):
    """Chains of `numbers` with 1..14 links: d(T + V)/dt is the power of torques, dampers, friction and drag, to 1e-10
    of the kinetic energy's rate."""
    x = numbers(case)
    kinetic, potential = (y.item() for y in evaluate(energy_rate(case.key), x))
    power = (x.tau - x.chain.damping * x.v + friction_torque(x) + drag_torque(x)) @ x.v
    assert kinetic + potential == pytest.approx(power, abs=1e-10 * (abs(kinetic) + np.abs(x.tau * x.v).max()))


# ---------------------------------------------------------------------------------------------------------------------
# Armature


@examples(150)
@given(cases(SHORT), st.sampled_from(["none", "some", "all"]))
def test_armature_equals_the_dense_solution(case: Case, armature: str):
    """Chains of `numbers` with 1..14 links: armature 0..0.5 kg m^2 on no, every second or all joints."""
    x = numbers(case)
    extra = np.random.default_rng(case.seed + 1).uniform(0, 0.5, case.n)
    ours = evaluate(with_armature(case.key, armature), x, extra)[0]
    M, bias, *_ = evaluate(terms(case.key), x)
    added = {"none": 0 * extra, "some": np.where(np.arange(case.n) % 2, extra, 0), "all": extra}[armature]
    dense = M.reshape(case.n, case.n) + np.diag(added)
    assert worst(ours, np.linalg.solve(dense, x.tau - bias)) < 1e-9


# ---------------------------------------------------------------------------------------------------------------------
# What is generated


def production(**changed) -> ca.Function:
    """Acceleration of an arm of 2 and a whip of 12, all parameters symbols but for those in `changed`."""
    n = 14
    s = {name: ca.SX.sym(name, n) for name in VECTORS}
    inputs = list(s.values())
    s |= changed
    chain = Chain(**s)
    q, v, tau = (ca.SX.sym(name, n) for name in ("q", "v", "tau"))
    a = forward_dynamics(chain, q, v, tau + passive_torque(chain, q, v))
    return ca.Function("a", [*inputs, q, v, tau], [a])


def count(function: ca.Function, operation: int) -> int:
    return sum(function.instruction_id(i) == operation for i in range(function.n_instructions()))


@pytest.mark.parametrize(
    "term", ["stiffness", "cubic_stiffness", "damping", "dry_friction", "drag", "inertia", "rest_angle"]
)
@pytest.mark.parametrize("zero", [ca.SX.zeros(14), np.zeros(14)], ids=["SX", "numpy"])
def test_a_term_that_is_the_number_zero_generates_nothing(term: str, zero):
    full, without, position = production(), production(**{term: zero}), VECTORS.index(term)
    assert without.n_instructions() < full.n_instructions()
    assert full.jac_sparsity(0, position).nnz() > 0
    assert without.jac_sparsity(0, position).nnz() == 0


def test_drag_and_dry_friction_are_the_only_roots():
    zero = ca.SX.zeros(14)
    assert count(production(), ca.OP_SQRT) == 2 * 14  # one per node, one per joint
    assert count(production(drag=zero), ca.OP_SQRT) == 14
    assert count(production(drag=zero, dry_friction=zero), ca.OP_SQRT) == 0


@pytest.mark.parametrize("numeric", [False, True])
def test_point_masses_generate_less_than_rods(numeric: bool):
    """The same chain of 2 rods and 12 nodes, but for nodes whose centres of mass are not known to lie at their ends."""
    s, x = symbols((14, "whip", False, False)), numbers(Case(14, "whip", False, False, True, 0))
    nodes = x.chain if numeric else s.chain
    rods = replace(nodes, com=0.9 * nodes.com if numeric else ca.SX.sym("com", 14))
    f, g = (
        ca.Function("f", [s.p, s.q, s.v, s.tau], [forward_dynamics(c, s.q, s.v, s.tau)], {"allow_free": True})
        for c in (nodes, rods)
    )
    assert count(f, ca.OP_SIN) == count(f, ca.OP_COS) == 14
    assert f.n_instructions() < g.n_instructions() - 5 * 12


# ---------------------------------------------------------------------------------------------------------------------
# From parameters to chain


@examples(100)
@given(st.integers(0, 2**32 - 1))
def test_a_mass_that_rides_on_a_link_is_added_as_pinocchio_adds_it(seed: int):
    mass, com, inertia, length, load = np.random.default_rng(seed).uniform(0.01, 1, 5)
    ours = [float(x) for x in ride_on_end(mass, com, inertia, length, load)]
    link = pin.Inertia(mass, np.array([0, -com, 0]), np.diag([inertia] * 3))
    both = link + pin.Inertia(load, np.array([0, -length, 0]), np.zeros((3, 3)))
    assert ours == pytest.approx([both.mass, -both.lever[1], both.inertia[2, 2]], rel=1e-12)


@examples(25)
@given(seed=st.integers(0, 2**32 - 1), a=st.integers(1, 4), N=st.integers(1, 10), hinge=st.booleans())
def test_chain_of_a_model_moves_like_its_mujoco_model(seed: int, a: int, N: int, hinge: bool):
    """Arms of 1..4 joints with whips of 1..10 nodes, every native parameter in use: accelerations to 1e-9."""
    rng = np.random.default_rng(seed)
    arm = ArmParameters(
        tuple(
            ArmLink(
                mass=rng.uniform(0.2, 2),
                length=L,
                com=L * rng.uniform(0.2, 0.8),
                inertia=rng.uniform(1e-3, 1e-2),
                friction=rng.uniform(0, 0.1),
            )
            for L in rng.uniform(0.2, 0.4, a)
        )
    )
    whip = WhipParameters(
        N=N,
        l=tuple(rng.uniform(0.05, 0.15, N)),
        m=tuple(rng.uniform(0.01, 0.1, N)),
        k=tuple(rng.uniform(0, 0.3, N)),
        b=tuple(rng.uniform(0, 0.1, N)),
        rest_angle=tuple(rng.uniform(-0.3, 0.3, N)),
        hinge_mass=0.05 * hinge,
        node_inertia=tuple(rng.uniform(0, 1e-4, N)),
    )
    model = Model(whip, arm)
    mj = build_spec(model, node_inertia=POINT_INERTIA).compile()
    data = mujoco.MjData(mj)
    tau = np.r_[rng.uniform(-1, 1, a), np.zeros(N)]
    data.qpos[:], data.qvel[:], data.ctrl[:] = rng.uniform(-2, 2, a + N), rng.uniform(-3, 3, a + N), tau[:a]
    mujoco.mj_forward(mj, data)
    chain = chain_of(model, node_inertia=POINT_INERTIA)
    chain.inertia[a - 1] += POINT_INERTIA * hinge  # of the mass on the hand
    q, v = ca.SX.sym("q", a + N), ca.SX.sym("v", a + N)
    f = ca.Function(
        "f",
        [q, v],
        [forward_dynamics(chain, q, v, passive_torque(chain, q, v) + tau), ca.vertcat(*tip_state(chain, q, v))],
    )
    ours, tip = (np.array(x).ravel() for x in f(data.qpos, data.qvel))
    assert worst(ours, data.qacc) < 1e-9
    assert np.abs(tip[:2] - data.site("tip").xpos[::2]).max() < 1e-12
