"""A swing of an arm and whip in space, made up by hand and not simulated, and where MuJoCo says its bodies are."""

from __future__ import annotations

import mujoco
import numpy as np

from whiptool.impedance import ConstantImpedance, Controller
from whiptool.models import Model
from whiptool.models.strike import Strike
from whiptool.models.trajectory import Trajectory
from whiptool.rollout.completed import States, complete_trajectory
from whiptool.rollout.mujoco_model import build_spec


def swing(model: Model, *, seed: int = 0, instants: int = 301) -> Trajectory:
    """Every joint swings on its own, in 0.6 s; the arm is wanted elsewhere, with stiffness on and off the diagonal."""
    rng, t, n, a = np.random.default_rng(seed), np.linspace(0, 0.6, instants), model.n, model.arm.n
    start, size, phase = rng.uniform(-0.6, 0.6, n), rng.uniform(0.1, 0.5, n), rng.uniform(0, 6, n)
    rate = rng.uniform(2, 8, n)
    angle = rate * t[:, None] + phase
    q, v = start + size * np.sin(angle), size * rate * np.cos(angle)
    gains = np.eye(a) * 20 + 1
    controller = Controller(ConstantImpedance(tuple(map(tuple, gains)), tuple(map(tuple, gains / 10))))
    strike = Strike.from_vector([*rng.uniform(-0.5, 0.5, a), *rng.uniform(0.6, 1, a), 0.4])
    tau = 5 * np.sin(angle[:, :a])
    return complete_trajectory(model, controller, strike, States(t, q, v, tau))


def places(model: Model, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Base, joints and hand, and hand, nodes and tip [m], as MuJoCo has them; of an arm without massless links."""
    mj = build_spec(model).compile()
    data = mujoco.MjData(mj)
    data.qpos[:] = q
    mujoco.mj_kinematics(mj, data)
    mujoco.mj_comPos(mj, data)
    bodies = [data.body(f"whip{i + 1}").xpos.copy() for i in range(model.whip.N)]
    whip = np.array([*bodies, data.site("tip").xpos])
    joints = [data.joint(name).xanchor.copy() for name in model.arm.joints]
    return np.array([np.zeros(3), *joints, whip[0]]), whip
