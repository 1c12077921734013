"""Energies of a strike against CasADi's expressions, and against the work of the motors less what is lost."""

from __future__ import annotations

import casadi as ca
import mujoco
import numpy as np
import pytest
from random_space import bent, random_model, random_rods, random_state

from whiptool.dynamics.chain import chain_of, kinetic_energy, potential_energy
from whiptool.errors import InputError
from whiptool.impedance import ConstantImpedance, Controller
from whiptool.models import ArmLink, ArmParameters, Model, WhipParameters, preset
from whiptool.models.kinematics import chain_motion, joint_points
from whiptool.models.strike import Strike
from whiptool.models.trajectory import Trajectory
from whiptool.rollout import CompiledRollout, ReferenceRollout
from whiptool.rollout.energy import energies
from whiptool.rollout.mujoco_model import build_spec

STRIKE = Strike.from_vector([-1.2, 0.9, 1.2, 0.3, 0.7])
LEMON = preset("lemon2024")
EVERYTHING = Model(  # every term that a model can have
    whip=WhipParameters(
        N=4,
        l=(0.2, 0.15, 0.1, 0.12),
        m=(0.05, 0.03, 0.02, 0.01),
        k=(0.1, 0.4, 0.3, 0.2),
        b=(0.01, 0.03, 0.02, 0.01),
        rest_angle=(0.1, 0.2, -0.1, 0.0),
        dry_friction=(0.01, 0.005, 0.0, 0.002),
        drag=(0.0, 0.01, 0.02, 0.03),
        hinge_mass=0.03,
        drag_ratio=0.2,
        cubic_stiffness=(0.05, 0.2, 0.1, 0.15),
        node_inertia=(1e-4, 3e-4, 0.0, 2e-4),
    ),
    arm=ArmParameters(
        (ArmLink(mass=0.3, length=0.3, com=0.1, friction=0.02), ArmLink(mass=0.2, length=0.25, inertia=0.002))
    ),
)
MODELS = pytest.mark.parametrize(
    "model", [LEMON, pytest.param(EVERYTHING, marks=pytest.mark.slow)], ids=["lemon2024", "every term"]
)


def path_of(model, timestep):
    return CompiledRollout(model, Controller(ConstantImpedance()), timestep=timestep).trajectory(STRIKE, t_stay=0.3)


@MODELS
def test_energies_are_those_of_the_symbolic_chain(model):
    path = path_of(model, 1e-3)
    e = energies(model, path)
    q, v = ca.SX.sym("q", model.n), ca.SX.sym("v", model.n)
    chain = chain_of(model)
    both = ca.Function("both", [q, v], [kinetic_energy(chain, q, v), potential_energy(chain, q)])
    T, V = (x.full()[0] for x in both.map(len(path.t))(path.q.T, path.v.T))
    np.testing.assert_allclose(e.kinetic.sum(axis=1), T, rtol=1e-12, atol=1e-14)
    np.testing.assert_allclose((e.weight + e.springs).sum(axis=1), V, rtol=1e-12, atol=1e-13)


@MODELS
def test_what_is_stored_is_the_work_less_the_losses(model):
    coarse, fine = (energies(model, path_of(model, h)) for h in (5e-4, 2.5e-4))
    assert fine.work.max() > 0.5  # [J]: there is something to balance
    assert fine.lost[-1] > 0.1
    errors = [np.abs(e.imbalance).max() for e in (coarse, fine)]
    assert errors[1] < 1e-4
    assert errors[1] < 0.35 * errors[0]  # of second order


def test_the_balance_holds_in_the_other_simulator():
    path = ReferenceRollout(EVERYTHING, Controller(ConstantImpedance()), timestep=1e-4).trajectory(STRIKE, t_stay=0.05)
    assert np.abs(energies(EVERYTHING, path).imbalance).max() < 1e-5


def test_velocities_are_the_rates_of_the_points():
    path = path_of(EVERYTHING, 1e-3)
    q, v, h = path.q[300:400], path.v[300:400], 1e-6
    rate = (joint_points(EVERYTHING, q + h * v) - joint_points(EVERYTHING, q - h * v)) / (2 * h)
    velocities = chain_motion(EVERYTHING, q, v)[1]
    np.testing.assert_allclose(velocities, rate, atol=1e-7)
    np.testing.assert_allclose(velocities[:, -1], path.tip_velocity[300:400], atol=1e-12)


def test_a_trajectory_of_another_model_is_refused():
    with pytest.raises(InputError, match="14"):
        energies(LEMON, path_of(EVERYTHING, 1e-3))


# ---------------------------------------------------------------------------------------------------------------------
# In space

SPACE = {"universal": bent(random_model(2, 3, 4, forces=True)), "rod": random_rods(2, 3, 4)}  # every term
STIFF = Controller(
    ConstantImpedance(K=tuple(map(tuple, 30 * np.eye(3))), B=tuple(map(tuple, 3 * np.eye(3)))), torque_limit=20.0
)
IN_SPACE = Strike.from_vector([0.3, -0.4, 0.5, -0.2, 0.4, -0.3, 0.5])


def states_of(q, v):
    """A trajectory of these states that says nothing else."""
    none, t = np.zeros((len(q), 3)), np.arange(float(len(q)))
    gains = np.zeros((len(q), 3, 3))
    return Trajectory(t=t, q=q, v=v, q_d=none, v_d=none, tau=none, K=gains, B=gains, tip=none, tip_velocity=none)


@pytest.mark.parametrize("seed", range(4))
def test_energies_in_space_are_mujocos(seed):
    """Slides, links without mass, rotors, inertias of nodes, the hinge mass and cubic springs are among them."""
    model = bent(random_model(seed, 3, 5), seed)
    q, v = (np.array(x) for x in zip(*(random_state(model, i)[:2] for i in range(5)), strict=True))
    e = energies(model, states_of(q, v))
    mj = build_spec(model).compile()
    mj.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_ENERGY
    data, a = mujoco.MjData(mj), model.arm.n
    assert e.kinetic.shape == e.weight.shape == e.springs.shape == (5, a + 5)
    for i in range(5):
        data.qpos[:], data.qvel[:] = q[i], v[i]
        mujoco.mj_forward(mj, data)
        potential, kinetic = data.energy
        assert e.kinetic[i].sum() == pytest.approx(kinetic, rel=1e-9)
        assert (e.weight + e.springs)[i].sum() == pytest.approx(potential, rel=1e-9)


@pytest.mark.parametrize("joints", SPACE)
def test_what_is_stored_in_space_is_the_work_less_the_losses(joints):
    """Of arms with friction and whips with drag, dry friction, dampers and cubic springs."""
    model = SPACE[joints]
    found = [
        energies(
            model, CompiledRollout(model, STIFF, timestep=h, engine="interpreter").trajectory(IN_SPACE, t_stay=0.1)
        )
        for h in (5e-4, 2.5e-4)
    ]
    assert found[1].work.max() > 0.5
    assert found[1].lost[-1] > 0.3
    assert np.ptp(found[1].springs.sum(axis=1)) > 0.05
    errors = [np.abs(e.imbalance).max() for e in found]
    assert errors[1] < 2e-5
    assert errors[1] < 0.35 * errors[0]  # of second order


def test_the_balance_in_space_holds_in_the_other_simulator():
    model = SPACE["universal"]
    path = ReferenceRollout(model, STIFF, timestep=2e-4).trajectory(IN_SPACE, t_stay=0.05)
    assert np.abs(energies(model, path).imbalance).max() < 1e-5


@pytest.mark.parametrize("joints", SPACE)
def test_velocities_in_space_are_the_rates_of_the_points(joints):
    model = SPACE[joints]
    path = CompiledRollout(model, STIFF, timestep=1e-3, engine="interpreter").trajectory(IN_SPACE, t_stay=0.1)
    q, v, h = path.q[300:400], path.v[300:400], 1e-6
    rate = (joint_points(model, q + h * v) - joint_points(model, q - h * v)) / (2 * h)
    velocities = chain_motion(model, q, v)[1]
    assert velocities.shape == (100, model.arm.n + 1 + model.whip.N, 3)
    np.testing.assert_allclose(velocities, rate, atol=1e-7)
