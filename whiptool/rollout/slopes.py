"""Exact derivatives of what a closest approach tells."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

SLOPES = ("tip", "velocity", "effort", "max_torque")  # of which an outcome's columns hold derivatives by name


@dataclass(frozen=True, eq=False)
class ApproachSlopes:
    """Derivatives of an `Approach` of B strikes by m parameters, in d dimensions, for an arm with a joints.

    Args:
        distance: Derivatives of the distance of the tip from the target [m per unit of the parameter], (B, m).
        tip: Derivatives of the tip's position at the closest approach [m per unit], (B, d, m).
        velocity: Derivatives of the tip's velocity there [m/s per unit], (B, d, m).
        effort: Derivatives of each joint's integral of squared torque [N^2 m^2 s per unit], (B, a, m).
        max_torque: Derivatives of each joint's largest torque [N m per unit], (B, a, m).
    """

    distance: np.ndarray
    tip: np.ndarray
    velocity: np.ndarray
    effort: np.ndarray
    max_torque: np.ndarray
