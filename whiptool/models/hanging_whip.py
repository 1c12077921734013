"""A whip that hangs above the floor before a strike, as a smooth function of it: what a search can keep."""

from __future__ import annotations

import math

import numpy as np

from whiptool.models.kinematics import arm_poses
from whiptool.models.parameters import Model

_BENDS = 4.0  # of the length over which a hanging whip bends downward from any direction of the hand


class HangingWhip:
    """Constraint on the distance of the hanging whip from the floor before a strike.

    A heavy whip bends downward within a few times the length `sqrt(EI / (m g))`, with EI its largest bending stiffness
    and m g its weight. This length is subtracted, so that no feasible strike is excluded.

    Args:
        model: Model with an arm in space.
        floor: Height of the floor [m].
        least: Smallest allowed distance [m].
    """

    def __init__(self, model: Model, floor: float, least: float = 0.0) -> None:
        self._arm, self._lowest = model.arm.in_space(), floor + least + _depth(model)
        self._turns = model.arm.turns

    def constraints(self, strike: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return by how much the whip hangs too low [m], (1,), at most 0 if it does not, and the derivatives (1, 2 a +
        1).

        Args:
            strike: Strike vector, (2 a + 1,).
        """
        a = self._arm.n
        origins, rotations = arm_poses(self._arm, strike[None, :a])
        axes = np.einsum("jik,jk->ji", rotations[0, :-1], self._arm.per_link("axis"))
        turning = np.cross(axes, origins[0, -1] - origins[0, :-1])
        upward = np.where(self._turns, turning[:, 2], axes[:, 2])
        slopes = np.concatenate([-upward, np.zeros(a + 1)])
        return self._lowest - origins[0, -1, 2:], slopes[None]

    def kept(self, strikes: np.ndarray) -> np.ndarray:
        """Return whether the whips of strikes (B, 2 a + 1) hang high enough, (B,)."""
        return arm_poses(self._arm, strikes[:, : self._arm.n])[0][:, -1, 2] >= self._lowest


def _depth(model: Model) -> float:
    """Return how far the tip hangs below the hand at least [m]; 0 of a whip that is stiff, or without gravity."""
    whip, weight = model.whip, model.whip.mass * model.gravity
    stiffness = float((whip.per_node("k") * whip.per_node("l")).max())
    return max(0.0, whip.length - _BENDS * math.sqrt(stiffness / weight)) if weight > 0 else 0.0
