"""Positions of arm and whip for pictures."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from whiptool.models.kinematics import joint_points, universal_angles
from whiptool.models.parameters import Model


def arm_and_whip(model: Model, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the points of the arm from base to hand, and of the whip from hand to tip.

    In the plane the arm's first joint is the base.

    Args:
        model: Model with an arm with a joints and a whip with N nodes, in d dimensions.
        q: Joint positions, (..., n), for rods as in a trajectory.

    Returns:
        Base, joints and hand [m], (..., a + 1, 2), in space (..., a + 2, 3); hand and nodes [m], (..., N + 1, d).
    """
    points, a = joint_points(model, q), model.arm.n
    arm, whip = points[..., : a + 1, :], points[..., a:, :]
    return (_from_base(arm) if model.dimension == 3 else arm), whip


def _from_base(arm: np.ndarray) -> np.ndarray:
    return np.concatenate([np.zeros_like(arm[..., :1, :]), arm], axis=-2)


def at_times(times: np.ndarray, t: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Return x (T, n) at times t (T,), interpolated linearly at `times`, (len(times), n)."""
    return np.stack([np.interp(times, t, column) for column in x.T], axis=1)


def as_mujoco_shows(model: Model, q: np.ndarray) -> tuple[Model, np.ndarray]:
    """Return a model with joints that MuJoCo supports, and its joint positions (..., n) with the bodies at the same
    positions.

    A whip of rods is converted to universal joints; other models are unchanged.
    """
    if model.whip.kind.hinges:
        return model, q
    return replace(model, whip=replace(model.whip, joints="universal")), universal_angles(model.arm.in_space(), q)
