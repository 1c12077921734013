"""A hand without an arm, as motion capture sees it: three slides and three turns that nothing holds.

An arm of six massless joints, so that what moves a whip by measured joints moves it by the hand's measured pose, too.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from scipy.spatial.transform import Rotation

from whiptool.errors import InputError
from whiptool.models.joint_trajectory import POSE
from whiptool.models.spatial_arm import JointLimits, SpatialArm, SpatialLink, Vector

_STEEPEST = np.deg2rad(65)  # of the middle turn: at 90 degrees the other two are one
_FARTHEST = 20.0  # [m]
_AXES: tuple[Vector, ...] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


def free_hand(turned: np.ndarray) -> SpatialArm:
    """Return a virtual arm for a hand: three prismatic joints for its position, and rotations about z, y, x from
    `turned` (3, 3).
    """
    slides = [_link(axis, JointLimits((-_FARTHEST, _FARTHEST)), "prismatic") for axis in _AXES]
    first = _link(_AXES[2], JointLimits(), rotation=turned)
    turns = [first, *(_link(axis, JointLimits()) for axis in (_AXES[1], _AXES[0]))]
    return SpatialArm((*slides, *turns), joints=(*POSE[:3], "hand_yaw", "hand_pitch", "hand_roll"))


def hand_joints(poses: np.ndarray) -> tuple[SpatialArm, np.ndarray]:
    """Return a virtual arm for a sequence of hand poses, and its joint positions [m, rad], (S, 6), without jumps.

    Rotations are relative to that of the 24 rotations of a cube that keeps them farthest from gimbal lock; if none
    avoids it, relative to these rotations of the hand's mean orientation.

    Args:
        poses: Position [m] and unit quaternion (x, y, z, w) of the hand in the base's frame, (S, 7).

    Raises:
        InputError: The hand rotates so far that gimbal lock cannot be avoided.
    """
    turned = Rotation.from_quat(poses[:, 3:])
    cube = Rotation.create_group("O").as_matrix().round()
    way, steepest = _best_way(cube, turned)
    if steepest > _STEEPEST:
        way, steepest = _best_way(turned.mean().as_matrix() @ cube, turned)
    if steepest > _STEEPEST:
        rule = f"turns of the hand that stay within {np.rad2deg(_STEEPEST):.0f} degrees about one axis of it"
        raise InputError("hand", f"{np.rad2deg(steepest):.0f} degrees", rule)
    return free_hand(way), np.hstack([poses[:, :3], np.unwrap(_turns(way, turned), axis=0)])


def _best_way(ways: np.ndarray, turned: Rotation) -> tuple[np.ndarray, float]:
    """Return that of some orientations (W, 3, 3) from which the turn about y is smallest, and how large it is."""
    steepest = [float(np.abs(_turns(way, turned)[:, 1]).max()) for way in ways]
    best = int(np.argmin(steepest))
    return ways[best], steepest[best]


def _turns(way: np.ndarray, turned: Rotation) -> np.ndarray:
    """Return the turns about z, y and x that lead from an orientation to others [rad], (S, 3)."""
    return (Rotation.from_matrix(way).inv() * turned).as_euler("ZYX")


def _link(
    axis: Vector,
    limits: JointLimits,
    kind: Literal["revolute", "prismatic"] = "revolute",
    rotation: np.ndarray | None = None,
) -> SpatialLink:
    given = np.eye(3) if rotation is None else rotation
    turned = tuple(map(tuple, given.tolist()))
    return SpatialLink(0.0, (0, 0, 0), (0.0,) * 6, axis, (0, 0, 0), turned, kind=kind, limits=limits)
