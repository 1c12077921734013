"""Whips of rods in MuJoCo: bodies on ball joints, on which the rods' own torques act from outside.

MuJoCo has no joint with a rod's bending: a ball joint's spring is another function of the bend, and its damper would
brake spin. Torques have no part along a rod, so that its body keeps the spin of 0 that it starts with; how the whip
spins is found as its dampers have it (`rod_damping`).
"""

from __future__ import annotations

import numpy as np

from whiptool.dynamics.modes import linearise
from whiptool.dynamics.posture import start_posture
from whiptool.dynamics.rods import half_square, rod_damping
from whiptool.models.kinematics import arm_frames
from whiptool.models.parameters import Model
from whiptool.rollout.mujoco_import import mujoco


class MujocoRods:
    """Joint torques of a whip of rods in MuJoCo, and conversion between MuJoCo's and whiptool's coordinates.

    Args:
        model: Model with a whip of N rods on an arm of a joints.
        mj: MuJoCo model from `build_spec`.
    """

    def __init__(self, model: Model, mj: mujoco.MjModel) -> None:
        whip, self._whip, self._arm = model.whip, model.whip, model.arm.in_space()
        self._nodes = np.array([mj.body(f"whip{i + 1}").id for i in range(whip.N)])
        self._hand = mj.body_parentid[self._nodes[0]]
        self._bodies = np.r_[self._hand, self._nodes]
        self._turning = np.flatnonzero(model.arm.turns)
        data = mujoco.MjData(mj)
        mujoco.mj_kinematics(mj, data)
        hand = data.xmat[self._hand].reshape(3, 3)
        self._down = hand.T @ -arm_frames(self._arm, np.zeros(model.arm.n))[-1].rotation[:, 2]  # in the hand's body
        self._k, self._cubic = (whip.per_node(name)[:, None] for name in ("k", "cubic_stiffness"))
        self._bends = slice(*(mj.body_dofadr[self._nodes[[0, -1]]] + [0, 3]))  # velocities of the balls, in turn

    def positions(self, q: np.ndarray) -> np.ndarray:
        """Convert coordinates of rods (a + 3 N,) to MuJoCo's positions with a quaternion per rod (a + 4 N,)."""
        a = self._arm.n
        frame, quaternions = arm_frames(self._arm, q[:a])[-1].rotation, []
        for d in q[a:].reshape(-1, 3):
            x, y, z = frame.T @ d
            # the least turn from -z
            turn = np.array([1 - z, y, -x, 0.0]) if z < 1 - 1e-9 else np.array([0.0, 1.0, 0.0, 0.0])
            turn /= np.linalg.norm(turn)
            quaternions.append(turn)
            matrix = np.empty(9)
            mujoco.mju_quat2Mat(matrix, turn)
            frame = frame @ matrix.reshape(3, 3)
        return np.r_[q[:a], np.concatenate(quaternions)]

    def coordinates(self, data: mujoco.MjData) -> tuple[np.ndarray, np.ndarray]:
        """Return the rods' coordinates and their rates, (a + 3 N,) each, from MuJoCo's data with current kinematics."""
        directions, spins = self._rods(data)
        rates = _cross(spins, directions)
        a = self._arm.n
        return np.r_[data.qpos[:a], directions[1:].ravel()], np.r_[data.qvel[:a], rates[1:].ravel()]

    def apply(self, data: mujoco.MjData) -> None:
        """Write the joints' torques at the data's positions and speeds to its applied generalised forces."""
        directions, spins = self._rods(data)
        before, d = directions[:-1], directions[1:]
        w, slope = half_square(1 - np.vecdot(before, d)[:, None])
        spring = (self._k + 2 * self._cubic * w) * slope * _cross(before, d)
        torques = rod_damping(self._whip, directions, spins).torques - spring  # (N, 3), on each rod
        on_rods = torques.copy()
        on_rods[:-1] -= torques[1:]
        on_rods -= np.vecdot(on_rods, d)[:, None] * d
        beyond = np.cumsum(on_rods[::-1], axis=0)[::-1]  # on all rods from each one on
        axes = data.xmat[self._nodes].reshape(-1, 3, 3)  # of a ball's velocities: its body's
        data.qfrc_applied[self._bends] = np.einsum("nij,ni->nj", axes, beyond).ravel()
        data.qfrc_applied[self._turning] = data.xaxis[self._turning] @ (beyond[0] - torques[0])

    def _rods(self, data: mujoco.MjData) -> tuple[np.ndarray, np.ndarray]:
        """Directions and angular velocities of the hand and the rods' bodies, (N + 1, 3) each."""
        frames = data.xmat[self._bodies].reshape(-1, 3, 3)
        directions = -frames[:, :, 2]
        directions[0] = frames[0] @ self._down
        return directions, data.cvel[self._bodies, :3]


def _cross(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return cross products of vectors (N, 3); NumPy's own takes four times as long for so few."""
    found = np.empty_like(x)
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        found[:, i] = x[:, j] * y[:, k] - x[:, k] * y[:, j]
    return found


def stable_timestep(model: Model) -> float:
    """Return a time step [s] well within RK4's stability limit for the hanging rods."""
    hanging = start_posture(model, np.zeros((1, model.arm.n)))[0]
    return 1.0 / np.abs(np.linalg.eigvals(linearise(model, hanging).A)).max()
