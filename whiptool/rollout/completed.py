"""References, gains and the tip's path from the states of a strike."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from whiptool.impedance.controller import Controller
from whiptool.models.hand_space import HandPath, HandSpace
from whiptool.models.kinematics import chain_motion
from whiptool.models.parameters import Model
from whiptool.models.strike import StrikePath
from whiptool.models.trajectory import Trajectory


class States(NamedTuple):
    """Times, joint positions, joint velocities and torques of a strike at T instants, as in `Trajectory`.

    `tip` is the tip's positions [m] and velocities [m/s], (T, d) each; None: not known.
    """

    t: np.ndarray
    q: np.ndarray
    v: np.ndarray
    tau: np.ndarray
    diverged: bool = False
    tip: tuple[np.ndarray, np.ndarray] | None = None


def complete_trajectory(model: Model, controller: Controller, strike: StrikePath, states: States) -> Trajectory:
    """Return the trajectory with the simulated states of a strike, to which the controller's references and gains are
    added and, if `states` has none, the tip's path.

    For control in hand space the gains are those in joint space, `J^T K J` and `J^T B J`.
    """
    t, q, v, tau, diverged, tip = states
    a = model.arm.n
    q_d, v_d, _ = strike.reference(t)
    space = controller.strike_space(model.arm)
    if isinstance(strike, HandPath) and isinstance(space, HandSpace) and not controller.prescribed:
        K, B = _hand_gains(controller, strike, space, t, q[:, :a], v[:, :a])
    else:
        K, B = controller.law.gains(q_d - q[:, :a], v_d - v[:, :a])
    if tip is None:
        points, velocities = chain_motion(model, q, v)
        tip = points[:, -1], velocities[:, -1]
    return Trajectory(t, q, v, q_d, v_d, tau, K, B, *tip, diverged=diverged, names=model.coordinate_names)


def _hand_gains(
    controller: Controller, path: HandPath, space: HandSpace, t: np.ndarray, q: np.ndarray, v: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Stiffness and damping (T, a, a) that an arm's joints (T, a) feel of a law of the hand's errors."""
    hand = space.kinematics.motion(q)
    J = space.kinematics.rows @ hand.jacobian
    K, B = controller.law.gains(*path.errors(t, hand, np.einsum("tmj,tj->tm", J, v)))
    back = np.swapaxes(J, 1, 2)
    return back @ K @ J, back @ B @ J
