"""Where arm and whip are in space, as pictures draw them."""

from __future__ import annotations

import numpy as np

from whiptool.models.kinematics import arm_frames
from whiptool.models.parameters import Model
from whiptool.models.spatial_arm import SpatialArm
from whiptool.rollout.trajectory import joint_points


def arm_and_whip(model: Model, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the places of the arm from the base to the hand, and of the whip from the hand to the tip.

    Args:
        model: In space, with an arm of a joints and a whip of N nodes.
        q: Joint positions, (..., n).

    Returns:
        The base, the joints and the hand [m], (..., a + 2, 3); the hand and the nodes [m], (..., N + 1, 3).
    """
    points, a = joint_points(model, q), model.arm.n
    base = np.zeros((*points.shape[:-2], 1, 3))
    return np.concatenate([base, points[..., : a + 1, :]], axis=-2), points[..., a:, :]


def arm_alone(model: Model, q: np.ndarray) -> np.ndarray:
    """Return the places of base, joints and hand [m], (..., a + 2, 3), for joint positions of the arm (..., a)."""
    assert isinstance(model.arm, SpatialArm)
    places = [frame.origin for frame in arm_frames(model.arm, q)]
    return np.stack([np.zeros_like(places[0]), *places], axis=-2)


def at_times(times: np.ndarray, t: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Return rows of x (T, n) between instants t (T,): (len(times), n)."""
    return np.stack([np.interp(times, t, column) for column in x.T], axis=1)
