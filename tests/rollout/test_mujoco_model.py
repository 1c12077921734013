"""One step of the published models: semi-implicit Euler on the CasADi chain against MuJoCo's own."""

from __future__ import annotations

import casadi as ca
import mujoco
import numpy as np
import pytest

from whiptool.dynamics.chain import chain_of, forward_dynamics, passive_torque
from whiptool.models.parameters import Model
from whiptool.models.presets import PRESETS, preset
from whiptool.rollout.mujoco_model import build_spec

H = 1e-3  # [s]


def euler(model: Model, node_inertia: float) -> ca.Function:
    """`(M + h diag(b)) a = f(q, v)`, `v+ = v + h a`, `q+ = q + h v+`: damping implicit, as in MuJoCo's Euler."""
    chain, n, a = chain_of(model, node_inertia=node_inertia), model.n, model.arm.n
    q, v, tau = ca.SX.sym("q", n), ca.SX.sym("v", n), ca.SX.sym("tau", a)
    torque = passive_torque(chain, q, v)
    torque[:a] += tau
    after = v + H * forward_dynamics(chain, q, v, torque, armature=H * ca.SX(chain.damping))
    return ca.Function("euler", [q, v, tau], [q + H * after, after])


def worst_of_random_states(model: Model, node_inertia: float, states: int = 20) -> tuple[float, float]:
    """Largest error in velocity, relative to the largest velocity, and in position [rad]."""
    step, mj = euler(model, node_inertia), build_spec(model, node_inertia=node_inertia).compile()
    mj.opt.timestep, mj.opt.integrator = H, mujoco.mjtIntegrator.mjINT_EULER
    data, rng = mujoco.MjData(mj), np.random.default_rng(7)
    errors = np.empty((states, 2))
    for i in range(states):
        q = np.r_[rng.uniform(-np.pi, np.pi, model.arm.n), rng.uniform(-0.5, 0.5, model.whip.N)]
        v, tau = rng.uniform(-3, 3, model.n), rng.uniform(-2, 2, model.arm.n)
        data.qpos[:], data.qvel[:], data.ctrl[:] = q, v, tau
        mujoco.mj_step(mj, data)
        q_next, v_next = (np.array(x)[:, 0] for x in step(q, v, tau))
        errors[i] = np.abs(v_next - data.qvel).max() / np.abs(data.qvel).max(), np.abs(q_next - data.qpos).max()
        assert np.abs(data.qvel - v).max() > 1e-2, "a state in which nothing happens shows nothing"
    return tuple(errors.max(axis=0))


@pytest.mark.parametrize("node_inertia", [1e-12, 1e-9, 1e-6])
def test_lemon2024_steps_as_in_mujoco(node_inertia: float):
    velocity, position = worst_of_random_states(preset("lemon2024"), node_inertia)
    assert velocity < 1e-11
    assert position < 1e-13


@pytest.mark.parametrize("name", [name for name in PRESETS if name.startswith("nah2020")])
def test_the_predecessors_step_as_in_mujoco(name: str):
    velocity, position = worst_of_random_states(preset(name), 1e-9)
    assert velocity < 1e-11
    assert position < 1e-13


def test_node_inertia_of_the_reference_is_too_small_to_matter():
    """MuJoCo's nodes carry 1e-12 kg m^2, the compiled chain's none: the velocities agree to 1e-6 all the same."""
    model = preset("lemon2024")
    with_inertia, without = euler(model, 1e-12), euler(model, 0.0)
    rng = np.random.default_rng(0)
    q, v, tau = rng.uniform(-0.5, 0.5, model.n), rng.uniform(-3, 3, model.n), np.zeros(2)
    a, b = (np.array(f(q, v, tau)[1]) for f in (with_inertia, without))
    assert 0 < np.abs(a - b).max() < 1e-6
