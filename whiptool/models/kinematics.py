"""Kinematics in NumPy: positions of an arm's joints and a whip's nodes, and joint positions for a pose of the hand."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from whiptool.models.parameters import AnyArm, Model
from whiptool.models.spatial_arm import SpatialArm, SpatialLink
from whiptool.models.whip import KINDS


def rotation_vector(R: np.ndarray) -> np.ndarray:
    """Return the rotation vectors (..., 3) [rad] of rotation matrices (..., 3, 3), with a length of at most pi."""
    from scipy.spatial.transform import Rotation

    return Rotation.from_matrix(R.reshape(-1, 3, 3)).as_rotvec().reshape(*R.shape[:-2], 3)


def rotation_of(vector: np.ndarray) -> np.ndarray:
    """Return the rotation matrices (..., 3, 3) of rotation vectors (..., 3) [rad]."""
    from scipy.spatial.transform import Rotation

    return Rotation.from_rotvec(vector.reshape(-1, 3)).as_matrix().reshape(*vector.shape[:-1], 3, 3)


def quaternion_of(R: np.ndarray) -> np.ndarray:
    """Return the unit quaternions (..., 4) of rotation matrices (..., 3, 3): x, y, z, w, with w >= 0."""
    from scipy.spatial.transform import Rotation

    return Rotation.from_matrix(R.reshape(-1, 3, 3)).as_quat(canonical=True).reshape(*R.shape[:-2], 4)


def rotation_left(wanted: np.ndarray, present: np.ndarray) -> np.ndarray:
    """Return the rotations from present to wanted orientations (..., 3, 3), as axis times 2 sin(angle / 2), (..., 3).

    This is twice the vector part of the unit quaternion (Caccavale, Siciliano, Villani, Robotica 17, 1999). For small
    angles it equals the rotation vector, and its length increases up to an angle of pi.
    """
    return 2 * quaternion_of(wanted @ np.swapaxes(present, -1, -2))[..., :3]


def skew(vector: np.ndarray) -> np.ndarray:
    """Return the cross-product matrices (..., 3, 3) of vectors (..., 3): `skew(a) @ b` is a x b."""
    return np.cross(np.eye(3), vector[..., None, :])


def turning(vector: np.ndarray) -> np.ndarray:
    """Return the left Jacobians of SO(3), (..., 3, 3), at rotation vectors (..., 3) [rad]: they map the rate of a
    rotation vector to the angular velocity.
    """
    angle = np.linalg.norm(vector, axis=-1)[..., None, None]
    K = skew(vector)
    small = angle < 1e-4
    safe = np.where(small, 1.0, angle)
    first = np.where(small, 0.5, (1 - np.cos(safe)) / safe**2)
    second = np.where(small, 1 / 6, (safe - np.sin(safe)) / safe**3)
    return np.eye(3) + first * K + second * K @ K


class MovingFrame(NamedTuple):
    """A frame and its motion, for many states at once, in the base's axes."""

    origin: np.ndarray  # [m], (..., 3)
    rotation: np.ndarray  # (..., 3, 3)
    velocity: np.ndarray  # velocity of the origin [m/s], (..., 3)
    spin: np.ndarray  # angular velocity [rad/s], (..., 3)

    def carried(self, position: Sequence[float] | np.ndarray) -> MovingFrame:
        """Return the frame moved to a point that is fixed in it, (3,) [m]."""
        arm = self.rotation @ np.asarray(position, float)
        return self._replace(origin=self.origin + arm, velocity=self.velocity + np.cross(self.spin, arm))

    def turned(self, rotation: Sequence[Sequence[float]]) -> MovingFrame:
        """Return the frame rotated by a rotation that is fixed in it, (3, 3)."""
        return self._replace(rotation=self.rotation @ np.asarray(rotation, float))

    def hinged(self, axis: Sequence[float], q: np.ndarray, v: np.ndarray) -> MovingFrame:
        """Return the frame after a hinge about an axis (3,) at angles q [rad] and speeds v [rad/s], (...)."""
        spin = self.spin + (self.rotation @ np.asarray(axis, float)) * v[..., None]
        return self._replace(rotation=self.rotation @ rotation_about(axis, q), spin=spin)

    def slid(self, axis: Sequence[float], q: np.ndarray, v: np.ndarray) -> MovingFrame:
        """Return the frame after a prismatic joint along an axis (3,), given in this frame's axes, at positions q
        [m] and speeds v [m/s], (...).
        """
        along = self.rotation @ np.asarray(axis, float)
        moved = along * q[..., None]
        velocity = self.velocity + np.cross(self.spin, moved) + along * v[..., None]
        return self._replace(origin=self.origin + moved, velocity=velocity)


def rotation_about(axis: Sequence[float] | np.ndarray, angle: np.ndarray | float) -> np.ndarray:
    """Return the rotations about a unit vector (3,) by angles [rad] of any shape, (..., 3, 3); Rodrigues' formula."""
    K = _cross_matrix(axis)
    angle = np.asarray(angle, float)[..., None, None]
    return np.eye(3) + np.sin(angle) * K + (1 - np.cos(angle)) * (K @ K)


def _cross_matrix(axis: Sequence[float] | np.ndarray) -> np.ndarray:
    """Return the matrix (3, 3) that takes a vector to its cross product with an axis (3,)."""
    x, y, z = axis
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def arm_frames(arm: SpatialArm, q: np.ndarray, v: np.ndarray | None = None) -> list[MovingFrame]:
    """Return the frame of every link, after its joint, and last the hand's, at joint positions q [rad or m] and speeds
    v [rad/s or m/s], (..., a) each; default: at rest.
    """
    q = np.asarray(q, float)
    v = np.zeros_like(q) if v is None else np.asarray(v, float)
    zeros = np.zeros((*q.shape[:-1], 3))
    frame = MovingFrame(zeros, np.broadcast_to(np.eye(3), (*zeros.shape, 3)), zeros, zeros)
    frames = []
    for i, link in enumerate(arm.links):
        at_joint = frame.carried(link.position).turned(link.rotation)
        move = at_joint.hinged if link.kind == "revolute" else at_joint.slid
        frame = move(link.axis, q[..., i], v[..., i])
        frames.append(frame)
    return [*frames, frame.carried(arm.hand_position).turned(arm.hand_rotation)]


def arm_poses(arm: SpatialArm, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the origins [m], (T, a + 1, 3), and rotations, (T, a + 1, 3, 3), of every link's frame and, last, of the
    hand's, at joint positions q [rad or m], (T, a).
    """
    T = len(q)
    origins, rotations = np.empty((T, arm.n + 1, 3)), np.empty((T, arm.n + 1, 3, 3))
    origin, rotation = np.zeros((T, 3)), np.tile(np.eye(3), (T, 1))  # of the rotation its rows, (3 T, 3)
    for i, link in enumerate(arm.links):
        origin = origin + (rotation @ np.array(link.position)).reshape(T, 3)
        rotation = rotation @ np.array(link.rotation)
        if link.kind == "revolute":  # Rodrigues' formula
            across = rotation @ _cross_matrix(link.axis)
            angle = np.repeat(q[:, i], 3)[:, None]
            rotation = rotation + np.sin(angle) * across + (1 - np.cos(angle)) * (across @ _cross_matrix(link.axis))
        else:
            origin = origin + q[:, i, None] * (rotation @ np.array(link.axis)).reshape(T, 3)
        origins[:, i], rotations[:, i] = origin, rotation.reshape(T, 3, 3)
    origins[:, -1] = origin + (rotation @ np.array(arm.hand_position)).reshape(T, 3)
    rotations[:, -1] = (rotation @ np.array(arm.hand_rotation)).reshape(T, 3, 3)
    return origins, rotations


def joint_points(model: Model, q: np.ndarray) -> np.ndarray:
    """Return the positions of all joints, shoulder first, and of the tip [m], (..., n + 1, 2), for angles q (..., n).

    In space they are those of the arm's a joints, the hand and the N nodes, (..., a + 1 + N, 3).
    """
    return chain_motion(model, q)[0]


def upright(places: np.ndarray) -> np.ndarray:
    """Return positions in space (..., 3); y of positions in the strike plane (..., 2) becomes z."""
    return places if places.shape[-1] == 3 else np.insert(places, 1, 0.0, axis=-1)


def chain_motion(model: Model, q: np.ndarray, v: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Return positions and velocities of the arm's joints, the hand and the whip's nodes.

    Args:
        model: Model with an arm of a joints, and a whip of N nodes, in d dimensions.
        q: Joint positions of the arm, then of the whip: in the plane the angles of its hinges, (..., a + N); in space
            the angles x1, y1, x2, y2, ... of universal joints, (..., a + 2 N), or unit vectors along rods in the
            world's axes, (..., a + 3 N).
        v: Rates of q, in the same shape; default: at rest.

    Returns:
        Positions [m] and velocities [m/s], (..., a + 1 + N, d): joints, hand, nodes; the last is the tip.
    """
    v = np.zeros_like(q) if v is None else v
    if model.dimension == 2:
        return _hinges(np.r_[model.arm.lengths, model.whip.per_node("l")], q, v)
    a = model.arm.n
    frames = arm_frames(model.arm.in_space(), q[..., :a], v[..., :a])
    points, velocities = (np.stack([getattr(f, part) for f in frames], axis=-2) for part in ("origin", "velocity"))
    nodes, speeds = whip_motion(model, frames[-1], q[..., a:], v[..., a:])
    return np.concatenate([points, nodes], axis=-2), np.concatenate([velocities, speeds], axis=-2)


def _hinges(lengths: np.ndarray, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Positions and velocities (..., n + 1, 2) of the ends of n links in the plane, q and v (..., n)."""
    theta, omega = np.cumsum(q, axis=-1), np.cumsum(v, axis=-1)
    steps = np.stack([lengths * np.sin(theta), -lengths * np.cos(theta)], axis=-1)
    changes = (lengths * omega)[..., None] * np.stack([np.cos(theta), np.sin(theta)], axis=-1)
    start = np.zeros((*steps.shape[:-2], 1, 2))
    points, velocities = (np.concatenate([start, np.cumsum(x, axis=-2)], axis=-2) for x in (steps, changes))
    return points, velocities


def whip_motion(
    model: Model, hand: MovingFrame, q: np.ndarray, v: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Return positions [m] and velocities [m/s] of the nodes of a whip in space, (..., N, 3) each, for the hand's frame
    and the positions q and rates v (default: at rest) of the whip's joints, as in `chain_motion` without the arm's.
    """
    v, lengths, hinges = np.zeros_like(q) if v is None else v, model.whip.per_node("l"), model.whip.kind.hinges
    if not hinges:
        return _rods(hand, lengths, q, v)
    frames = hinged_frames(hand, lengths, hinges, q, v)
    return np.stack([f.origin for f in frames], axis=-2), np.stack([f.velocity for f in frames], axis=-2)


def whip_places(model: Model, origin: np.ndarray, rotation: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Return the positions of the nodes of a whip in space [m], (T, N, 3), for origins (T, 3) [m] and rotations (T, 3,
    3) of the hand's frame and positions q of the whip's joints, as in `chain_motion` without the arm's.
    """
    if not model.whip.kind.hinges:
        steps = q.reshape(len(q), -1, 3) * model.whip.per_node("l")[:, None]
        return origin[:, None] + np.cumsum(steps, axis=1)
    rest = np.zeros_like(origin)
    return whip_motion(model, MovingFrame(origin, rotation, rest, rest), q)[0]


def hinged_frames(
    hand: MovingFrame, lengths: np.ndarray, hinges: Sequence[Sequence[float]], q: np.ndarray, v: np.ndarray
) -> list[MovingFrame]:
    """Return the frames at the N nodes of a whip whose links, of lengths (N,) [m], are connected by h hinges each,
    about axes (h, 3), for the hand's frame and the hinges' positions q and speeds v [rad, rad/s], (..., h N).
    """
    frame, frames = hand, []
    for i, length in enumerate(lengths):
        for j, axis in enumerate(hinges, start=len(hinges) * i):
            frame = frame.hinged(axis, q[..., j], v[..., j])
        frame = frame.carried((0.0, 0.0, -length))
        frames.append(frame)
    return frames


def _rods(hand: MovingFrame, lengths: np.ndarray, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Positions and velocities (..., N, 3) of the ends of rods of these directions and rates, q and v (..., 3 N)."""
    steps = (x.reshape(*x.shape[:-1], -1, 3) * lengths[:, None] for x in (q, v))
    along, change = (np.cumsum(x, axis=-2) for x in steps)
    return hand.origin[..., None, :] + along, hand.velocity[..., None, :] + change


def universal_angles(arm: SpatialArm, q: np.ndarray) -> np.ndarray:
    """Convert positions of an arm's a joints and directions of N rods in the base's axes, not necessarily unit vectors,
    (..., a + 3 N), to coordinates of universal joints with the same directions, (..., a + 2 N).
    """
    a, frame = arm.n, arm_frames(arm, q[..., : arm.n])[-1]
    angles, rest = [q[..., :a]], np.zeros(q.shape[:-1])
    for d in np.moveaxis(q[..., a:].reshape(*q.shape[:-1], -1, 3), -2, 0):  # N times (..., 3)
        # behind both hinges a node points along (sin y, sin x cos y, -cos x cos y)
        p = np.einsum("...ji,...j->...i", frame.rotation, d / np.linalg.norm(d, axis=-1, keepdims=True))
        pair = np.stack([np.arctan2(p[..., 1], -p[..., 2]), np.arcsin(np.clip(p[..., 0], -1, 1))], axis=-1)
        for j, axis in enumerate(KINDS["universal"].hinges):
            frame = frame.hinged(axis, pair[..., j], rest)
        angles.append(pair)
    return np.concatenate(angles, axis=-1)


def hanging_angles(arm: SpatialArm, q: np.ndarray) -> np.ndarray:
    """Return the angles (..., 2) [rad] of the first universal joint with which the whip hangs straight down, at joint
    positions q [rad or m] of the arm, (..., a).
    """
    down = -arm_frames(arm, q)[-1].rotation[..., 2, :]  # the world's -z in the hand's frame
    # behind both hinges the whip points along (sin y, sin x cos y, -cos x cos y)
    x, y = np.arctan2(down[..., 1], -down[..., 2]), np.arcsin(np.clip(down[..., 0], -1, 1))
    return np.stack([x, y], axis=-1)


STEPS = 8  # of the way from the given posture's pose
NEWTON = 2  # iterations at each
AT_END = 12  # at the last, at most
FOUND = 1e-9  # [rad or m] that joints move in the last iteration, at most, where a posture is found
REACHED = 1e-7  # [m or rad] that the hand is away from its pose then, at most
_LARGEST = 0.5  # [rad or m] that a joint moves in one iteration
_DAMPING = 1e-12  # of the multipliers: keeps the equations solvable where the hand cannot move in some direction


class HandMotion(NamedTuple):
    """Forward kinematics of the hand in the base's frame."""

    position: np.ndarray  # [m], (..., 3)
    rotation: np.ndarray  # (..., 3, 3)
    jacobian: np.ndarray  # velocity and angular velocity of the hand per unit of the joints' speeds, (..., 6, a)


class HandPose(NamedTuple):
    """Desired pose of the hand: position `place` (..., 3) [m], and rotation (..., 3, 3) or None for any orientation."""

    place: np.ndarray
    rotation: np.ndarray | None


class Postures(NamedTuple):
    """Result of inverse kinematics."""

    q: np.ndarray  # joint positions [rad or m], (..., a)
    slopes: np.ndarray  # derivatives of q by displacement and rotation of the hand in its m coordinates, (..., a, m)
    missed: np.ndarray  # remaining distance of the hand from the pose [m or rad], (...,); infinite: no solution


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

    The coordinates are the hand's position (x and y in the plane) and, with `orientation`, its rotation relative to
    that in the given `posture` (a,) [rad or m], `upright` (3, 3): an angle in the plane, a rotation vector in the
    base's axes in space. The matrix `rows` (m, 6) selects their rates from the hand's velocity and angular velocity in
    space.
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
        """Return the hand's coordinates (..., m) [m, rad] at joint positions (..., a) [rad or m]."""
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
        """Return the displacement and the rotation vector from the hand's present pose to the desired one, (..., m)."""
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
        """Return the joint positions near q (..., a) at which the hand is at the given poses, found by Newton's method.

        The iteration starts with Lagrange multipliers (..., m) of the poses; default: those that suit q.
        """
        held = multipliers
        if held is None:  # those that come nearest to holding the postures away from the given one
            held = np.einsum("...ji,...j->...i", np.linalg.pinv(self.jacobian(q)), q - self.posture)
        slopes, missed = np.empty((*q.shape, self.size)), np.full(q.shape[:-1], np.inf)
        for _ in range(AT_END):
            q, held, left, moved, slopes = self._improved(q, held, pose)
            missed = np.where((moved < FOUND) & (left < REACHED), left, np.inf)
            if (moved < FOUND).all():
                break
        return Postures(q, slopes, missed)

    def spins(self, x: np.ndarray) -> np.ndarray:
        """Return, at coordinates x (..., m), the matrices (..., m, m) that map the coordinates' rates to the hand's
        velocity and angular velocity.
        """
        found = np.broadcast_to(np.eye(self.size), (*x.shape, self.size)).copy()
        if self.size == 6:
            found[..., 3:, 3:] = turning(x[..., 3:])
        return found

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
