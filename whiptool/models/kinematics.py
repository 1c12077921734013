"""Where the joints of an arm and whip are and, in space, how they move: forward kinematics in NumPy."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from whiptool.models.parameters import Model
from whiptool.models.spatial_arm import SpatialArm
from whiptool.models.whip import KINDS


class MovingFrame(NamedTuple):
    """A frame and its motion, for many states at once, in the base's axes.

    Args:
        origin: Origin [m], (..., 3).
        rotation: Rotation of the frame, (..., 3, 3).
        velocity: Velocity of the origin [m/s], (..., 3).
        spin: Angular velocity [rad/s], (..., 3).
    """

    origin: np.ndarray
    rotation: np.ndarray
    velocity: np.ndarray
    spin: np.ndarray

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
        """Return the frame after a prismatic joint along an axis (3,) at positions q [m] and speeds v [m/s], (...)."""
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
    """Return the frame of every link, after its joint, and last the hand's.

    Args:
        arm: Arm with a joints.
        q: Joint positions [rad or m], (..., a).
        v: Joint speeds [rad/s or m/s], (..., a); default: at rest.
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
    """Return the poses of every link's frame and, last, of the hand's, as `arm_frames` but without velocities.

    Args:
        arm: Arm with a joints.
        q: Joint positions [rad or m], (T, a).

    Returns:
        Origins [m], (T, a + 1, 3); rotations, (T, a + 1, 3, 3).
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
    """Return the positions of shoulder, joints and tip [m], (..., n + 1, 2), for joint positions q (..., n).

    In space they are those of the arm's a joints, the hand and the N nodes, (..., a + 1 + N, 3).
    """
    return chain_motion(model, q)[0]


def upright(places: np.ndarray) -> np.ndarray:
    """Return places in space (..., 3); those of the strike plane (..., 2) stand upright, y becoming z."""
    return places if places.shape[-1] == 3 else np.insert(places, 1, 0.0, axis=-1)


def chain_motion(model: Model, q: np.ndarray, v: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Return positions and velocities of the arm's joints, the hand and the whip's nodes.

    Args:
        model: Model with an arm of a joints, and a whip of N nodes, in d dimensions.
        q: Joint positions: behind the arm's, those of universal nodes x1, y1, x2, y2, ..., (..., a + 2 N), or the
            directions of rods in the world, unit vectors (3,) one after the other, (..., a + 3 N); in the plane those
            of hinges, (..., a + N).
        v: Rates of q, in the same shape; default: at rest.

    Returns:
        Positions [m] and velocities [m/s], (..., a + 1 + N, d): those of the joints, the hand, the nodes; last the tip.
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
    """Return positions [m] and velocities [m/s] of the nodes of a whip in space, (..., N, 3) each.

    Args:
        model: Model with the whip.
        hand: The hand's frame.
        q, v: Positions and rates of the whip's joints, as in `chain_motion` without the arm's; v's default: at rest.
    """
    v, lengths, hinges = np.zeros_like(q) if v is None else v, model.whip.per_node("l"), model.whip.kind.hinges
    if not hinges:
        return _rods(hand, lengths, q, v)
    frames = hinged_frames(hand, lengths, hinges, q, v)
    return np.stack([f.origin for f in frames], axis=-2), np.stack([f.velocity for f in frames], axis=-2)


def whip_places(model: Model, origin: np.ndarray, rotation: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Return the positions of the nodes of a whip in space [m], (T, N, 3).

    Args:
        model: Model with the whip.
        origin, rotation: Origin and rotation of the hand's frame, (T, 3) and (T, 3, 3).
        q: Positions of the whip's joints, as in `chain_motion` without the arm's.
    """
    if not model.whip.kind.hinges:
        steps = q.reshape(len(q), -1, 3) * model.whip.per_node("l")[:, None]
        return origin[:, None] + np.cumsum(steps, axis=1)
    rest = np.zeros_like(origin)
    return whip_motion(model, MovingFrame(origin, rotation, rest, rest), q)[0]


def hinged_frames(
    hand: MovingFrame, lengths: np.ndarray, hinges: Sequence[Sequence[float]], q: np.ndarray, v: np.ndarray
) -> list[MovingFrame]:
    """Return the frame at each of N nodes on hinges.

    Args:
        hand: The frame of the hand, for states of any shape (...).
        lengths: Lengths of the links [m], (N,).
        hinges: Axes of each node's h hinges, (h, 3).
        q, v: Positions and speeds of the hinges [rad, rad/s], (..., h N).
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
    """Convert rod coordinates (..., a + 3 N) to those of universal joints with the same directions, (..., a + 2 N).

    Args:
        arm: Arm with a joints.
        q: The arm's joint positions, then the directions of N rods in the base's axes, not necessarily unit vectors.
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
    """Return the angles (..., 2) [rad] of the first universal joint with which the whip hangs straight down.

    Args:
        arm: Arm with a joints.
        q: Joint positions of the arm [rad or m], (..., a).
    """
    down = -arm_frames(arm, q)[-1].rotation[..., 2, :]  # the world's -z in the hand's frame
    # behind both hinges the whip points along (sin y, sin x cos y, -cos x cos y)
    x, y = np.arctan2(down[..., 1], -down[..., 2]), np.arcsin(np.clip(down[..., 0], -1, 1))
    return np.stack([x, y], axis=-1)
