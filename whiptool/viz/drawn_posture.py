"""Where arm and whip are, as pictures draw them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from whiptool.models.kinematics import joint_points, universal_angles
from whiptool.models.parameters import Model


def arm_and_whip(model: Model, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the places of the arm from the base to the hand, and of the whip from the hand to the tip.

    In the plane the arm's first joint is the base.

    Args:
        model: With an arm of a joints and a whip of N nodes, in d dimensions.
        q: Joint positions, (..., n), or of rods a trajectory's.

    Returns:
        The base, the joints and the hand [m], (..., a + 1, 2), in space (..., a + 2, 3); the hand and the nodes [m],
        (..., N + 1, d).
    """
    points, a = joint_points(model, q), model.arm.n
    arm, whip = points[..., : a + 1, :], points[..., a:, :]
    return (_from_base(arm) if model.dimension == 3 else arm), whip


def _from_base(arm: np.ndarray) -> np.ndarray:
    return np.concatenate([np.zeros_like(arm[..., :1, :]), arm], axis=-2)


def at_times(times: np.ndarray, t: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Return rows of x (T, n) between instants t (T,): (len(times), n)."""
    return np.stack([np.interp(times, t, column) for column in x.T], axis=1)


def as_mujoco_shows(model: Model, q: np.ndarray) -> tuple[Model, np.ndarray]:
    """Return a model that MuJoCo has joints for, and its joint positions (..., n) where its bodies are in these places.

    A whip of rods becomes one of universal joints, others stay as they are.
    """
    if model.whip.kind.hinges:
        return model, q
    return replace(model, whip=replace(model.whip, joints="universal")), universal_angles(model.arm.in_space(), q)
