"""Inverse kinematics of an arm's hand: of all postures that hold it somewhere, that nearest to a given posture.

With `f(q)` the hand's pose and `q_0` the given posture, `min |q - q_0|^2 / 2` so that `f(q) = x`. Newton's method
solves the conditions of that minimum, `q - q_0 = J^T lambda` and `f(q) = x`, from the hand's pose at `q_0` in steps
along the straight line to x. A posture is therefore a smooth function of the pose, whatever path led there.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from whiptool.models.kinematics import upright
from whiptool.models.planar_arm import AnyArm
from whiptool.models.rotations import rotation_of, rotation_vector, turning
from whiptool.models.spatial_arm import SpatialLink

STEPS = 8  # of the way from the given posture's pose
NEWTON = 2  # iterations at each
AT_END = 12  # at the last, at most
FOUND = 1e-9  # [rad or m] that joints move in the last iteration, at most, where a posture is found
REACHED = 1e-7  # [m or rad] that the hand is away from its pose then, at most
_LARGEST = 0.5  # [rad or m] that a joint moves in one iteration
_DAMPING = 1e-12  # of the multipliers: keeps the equations solvable where the hand cannot move in some direction


class HandMotion(NamedTuple):
    """Forward kinematics of the hand in the base's frame.

    Args:
        position: Position of the hand [m], (..., 3).
        rotation: Rotation of the hand, (..., 3, 3).
        jacobian: Velocity and angular velocity of the hand per unit of the joints' speeds, (..., 6, a).
    """

    position: np.ndarray
    rotation: np.ndarray
    jacobian: np.ndarray


class HandPose(NamedTuple):
    """Desired pose of the hand: position `place` (..., 3) [m] and rotation (..., 3, 3), or None if it is free."""

    place: np.ndarray
    rotation: np.ndarray | None


class Postures(NamedTuple):
    """Result of inverse kinematics.

    Args:
        q: Joint positions [rad or m], (..., a).
        slopes: Derivatives of q by displacement and rotation of the hand, (..., a, m).
        missed: Remaining distance of the hand from the pose [m or rad], (...,); infinite if no solution was found.
    """

    q: np.ndarray
    slopes: np.ndarray
    missed: np.ndarray


class _Link(NamedTuple):
    """A link's joint: its place (3,), rotation (3, 3) and axis (3,), the axis' cross product and its square (3, 3)."""

    position: np.ndarray
    rotation: np.ndarray
    axis: np.ndarray
    skew: np.ndarray
    twice: np.ndarray

    @classmethod
    def of(cls, link: SpatialLink) -> _Link:
        """Return the joint of a link."""
        x, y, z = link.axis
        skew = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        return cls(np.array(link.position), np.array(link.rotation), np.array(link.axis), skew, skew @ skew)


class HandKinematics:
    """Forward and inverse kinematics of the hand, in m coordinates, for an arm with a joints.

    The coordinates are the hand's position (x and y in the plane) and, with orientation, its rotation relative to that
    in the given posture: an angle in the plane, a rotation vector in the base's axes in space.

    Args:
        arm: Arm in the plane or in space.
        posture: The given posture [rad or m], (a,).
        orientation: Whether the coordinates include the hand's orientation.

    Attributes:
        rows: Matrix (m, 6) that selects the coordinates' rates from the hand's velocity and angular velocity in space.
        upright: The hand's rotation in the given posture, (3, 3).
    """

    def __init__(self, arm: AnyArm, posture: np.ndarray, *, orientation: bool = False) -> None:
        self.dimension, self.orientation, self.posture = arm.dimension, orientation, np.asarray(posture, float)
        self._arm, self._turns = arm.in_space(), arm.turns
        self._links = [_Link.of(link) for link in self._arm.links]
        if arm.dimension == 2:
            rows = np.array([[1, 0, 0, 0, 0, 0], [0, 0, 1, 0, 0, 0], [0, 0, 0, 0, -1, 0]], float)
        else:
            rows = np.eye(6)
        self.rows = rows if orientation else rows[: arm.dimension]
        self.upright = self.motion(self.posture).rotation

    @property
    def size(self) -> int:
        """Number of coordinates."""
        return len(self.rows)

    def motion(self, q: np.ndarray) -> HandMotion:
        """Return the forward kinematics of the hand for joint positions (..., a)."""
        axes, places = np.empty((2, *q.shape, 3))
        place, rotation = np.zeros((*q.shape[:-1], 3)), np.broadcast_to(np.eye(3), (*q.shape[:-1], 3, 3))
        sin, cos = np.sin(q)[..., None, None], np.cos(q)[..., None, None]
        for i, link in enumerate(self._links):
            place, rotation = place + rotation @ link.position, rotation @ link.rotation
            axes[..., i, :] = rotation @ link.axis
            if self._turns[i]:
                rotation = rotation @ (np.eye(3) + sin[..., i, :, :] * link.skew + (1 - cos[..., i, :, :]) * link.twice)
            else:
                place = place + axes[..., i, :] * q[..., i, None]
            places[..., i, :] = place
        place = place + rotation @ np.array(self._arm.hand_position)
        turning = axes * self._turns[:, None]  # (..., a, 3)
        moving = np.where(self._turns[:, None], _cross(axes, place[..., None, :] - places), axes)
        jacobian = np.concatenate([moving, turning], axis=-1)
        return HandMotion(place, rotation @ np.array(self._arm.hand_rotation), np.swapaxes(jacobian, -1, -2))

    def coordinates(self, q: np.ndarray) -> np.ndarray:
        """Return the hand's coordinates (..., m) at postures (..., a)."""
        at = self.motion(q)
        place = at.position[..., [0, 2]] if self.dimension == 2 else at.position
        if not self.orientation:
            return place
        turned = rotation_vector(at.rotation @ self.upright.T)
        return np.concatenate([place, -turned[..., 1:2] if self.dimension == 2 else turned], axis=-1)

    def jacobian(self, q: np.ndarray) -> np.ndarray:
        """Return the hand's velocity, and angular velocity, per unit of the joints' speeds (..., m, a)."""
        return self.rows @ self.motion(q).jacobian

    def left(self, at: HandMotion, pose: HandPose) -> np.ndarray:
        """Return the displacement and rotation vector from the hand to poses, (..., m)."""
        left = pose.place - at.position
        if pose.rotation is not None:
            turn = rotation_vector(pose.rotation @ np.swapaxes(at.rotation, -1, -2))
            left = np.concatenate([left, turn], axis=-1)
        else:
            left = np.concatenate([left, np.zeros_like(left)], axis=-1)
        return left @ self.rows.T

    def poses(self, x: np.ndarray) -> HandPose:
        """Return the poses of coordinates (..., m); without orientation the rotation is None."""
        d = self.dimension
        places = upright(x[..., :d])
        if not self.orientation:
            return HandPose(places, None)
        turned = x[..., 3:]
        if d == 2:
            turned = np.stack([np.zeros_like(x[..., 2]), -x[..., 2], np.zeros_like(x[..., 2])], axis=-1)
        return HandPose(places, rotation_of(turned) @ self.upright)

    def solve(self, x: np.ndarray) -> Postures:
        """Return the joint positions at which the hand is at coordinates (..., m), nearest to the given posture."""
        start = self.coordinates(self.posture)
        q, multipliers = np.broadcast_to(self.posture, (*x.shape[:-1], len(self.posture))).copy(), np.zeros(x.shape)
        for share in np.arange(1, STEPS) / STEPS:
            pose = self.poses(start + share * (x - start))
            for _ in range(NEWTON):
                q, multipliers, *_ = self._improved(q, multipliers, pose)
        return self.settle(self.poses(x), q, multipliers)

    def settle(self, pose: HandPose, q: np.ndarray, multipliers: np.ndarray | None = None) -> Postures:
        """Return the joint positions near q (..., a) at which the hand is at the given poses."""
        held = self._multipliers(q) if multipliers is None else multipliers
        slopes, missed = np.empty((*q.shape, self.size)), np.full(q.shape[:-1], np.inf)
        for _ in range(AT_END):
            q, held, left, moved, slopes = self._improved(q, held, pose)
            missed = np.where((moved < FOUND) & (left < REACHED), left, np.inf)
            if (moved < FOUND).all():
                break
        return Postures(q, slopes, missed)

    def spins(self, x: np.ndarray) -> np.ndarray:
        """Return the matrix from the coordinates' rates to the hand's velocity and angular velocity at x (..., m),
        (..., m, m).
        """
        found = np.broadcast_to(np.eye(self.size), (*x.shape, self.size)).copy()
        if self.size == 6:
            found[..., 3:, 3:] = turning(x[..., 3:])
        return found

    def _multipliers(self, q: np.ndarray) -> np.ndarray:
        """Multipliers (..., m) that come nearest to holding postures q (..., a) away from the given one."""
        return np.einsum("...ji,...j->...i", np.linalg.pinv(self.jacobian(q)), q - self.posture)

    def _improved(
        self, q: np.ndarray, multipliers: np.ndarray, pose: HandPose
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """One of Newton's iterations: joint positions, multipliers, what was left of the pose, how far the joints
        moved, and the postures' derivatives by the hand's motion."""
        at, a, m = self.motion(q), len(self.posture), self.size
        J, left = self.rows @ at.jacobian, self.left(at, pose)
        matrix = np.zeros((*q.shape[:-1], a + m, a + m))
        weighed = np.einsum("...m,mr->...r", multipliers, self.rows)
        matrix[..., :a, :a] = np.eye(a) - self._curvature(at.jacobian, weighed)
        matrix[..., :a, a:], matrix[..., a:, :a] = -np.swapaxes(J, -1, -2), J
        matrix[..., a:, a:] = _DAMPING * np.eye(m)
        right = np.zeros((*q.shape[:-1], a + m, 1 + m))
        right[..., :a, 0], right[..., a:, 0] = self.posture - q, left
        right[..., a:, 1:] = np.eye(m)
        found = np.linalg.solve(matrix, right)
        step = found[..., :a, 0]
        moved = np.abs(step).max(axis=-1)
        shorter = np.minimum(1, _LARGEST / np.maximum(moved, _LARGEST))[..., None]
        new = multipliers + shorter * (found[..., a:, 0] - multipliers)
        return q + shorter * step, new, np.linalg.norm(left, axis=-1), moved, found[..., :a, 1:]

    def _curvature(self, jacobian: np.ndarray, weights: np.ndarray) -> np.ndarray:
        """Derivatives of `J^T weights` by the joints (..., a, a), for weights of all six motions (..., 6).

        A joint turns what is behind it: `d J_j / d q_i = omega_i x J_j` where joint i is not behind j, and a velocity
        changes by `omega_j x J_i` where it is.
        """
        a = jacobian.shape[-1]
        velocity, spin = np.swapaxes(jacobian[..., :3, :], -1, -2), np.swapaxes(jacobian[..., 3:, :], -1, -2)
        # weights . (omega_i x J_j) = J_j . (weights x omega_i)
        turned = _cross(weights[..., None, :3], spin)  # (..., i, 3)
        first = np.einsum("...jc,...ic->...ji", velocity, turned)  # row j, column i: i is before j or j itself
        before = np.tril(np.ones((a, a)))  # i <= j
        by_place = first * before + np.swapaxes(first, -1, -2) * (1 - before)
        if not self.orientation:
            return by_place
        turned = _cross(weights[..., None, 3:], spin)
        return by_place + np.einsum("...jc,...ic->...ji", spin, turned) * np.tril(np.ones((a, a)), -1)


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the cross products of vectors (..., 3); `np.cross` is slower."""
    x, y, z = (a[..., i] * b[..., j] - a[..., j] * b[..., i] for i, j in ((1, 2), (2, 0), (0, 1)))
    return np.stack([x, y, z], axis=-1)
