"""Positions of arm and whip for pictures, and their extent in time and space."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from whiptool.goals.target import Target
from whiptool.models.kinematics import joint_points, universal_angles
from whiptool.models.parameters import Model
from whiptool.models.trajectory import Trajectory


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
    if model.dimension == 3:
        arm = np.concatenate([np.zeros_like(arm[..., :1, :]), arm], axis=-2)
    return arm, whip


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


def planned_end(trajectory: Trajectory) -> float | None:
    """Return D, the end of the planned movement [s]; None if the arm never moves or the trajectory ends earlier."""
    speed = np.abs(trajectory.v_d).max(axis=1)
    moving = np.flatnonzero(speed > 1e-9 * speed.max())
    return float(trajectory.t[moving[-1] + 1]) if len(moving) and moving[-1] + 1 < len(speed) else None


_NARROWEST = 0.6  # share of the widest side of what is shown that every side has


def box_around(places: np.ndarray, target: Target) -> tuple[np.ndarray, np.ndarray]:
    """Return the lowest and the highest corner (d,) [m] of a box that contains all points (..., d) and a target.

    The box has a margin, and no side is much shorter than the longest.
    """
    place, radius = np.array(target.position), target.hit_radius
    every = np.concatenate([places, [place - radius, place + radius]])
    low, high = np.nanmin(every, axis=0), np.nanmax(every, axis=0)
    side = np.maximum(high - low, _NARROWEST * (high - low).max()) * 1.1
    return (low + high - side) / 2, (low + high + side) / 2
