"""The hand's way from pose to pose: its place along a straight line, its orientation about one axis, evenly."""

from __future__ import annotations

import numpy as np

from whiptool.models.inverse_kinematics import HandKinematics, HandPose
from whiptool.models.rotations import rotation_of, rotation_vector, skew, turning


class HandWay:
    """Straight paths of the hand between two poses, with the shortest rotation in space.

    Args:
        kinematics: Kinematics of the hand.
        ends: Coordinates of the hand at the start and the end, (..., 2, m).

    Attributes:
        start: Pose at the start: position (..., 3) [m] and rotation (..., 3, 3).
        moves: Displacement from start to end [m], (..., 3).
        turns: Rotation vector from start to end [rad], (..., 3); zero without orientation.
    """

    def __init__(self, kinematics: HandKinematics, ends: np.ndarray) -> None:
        self.kinematics, self._ends = kinematics, np.asarray(ends, float)
        place, rotation = kinematics.poses(self._ends)
        self.start = HandPose(place[..., 0, :], None if rotation is None else rotation[..., 0, :, :])
        self.moves = place[..., 1, :] - place[..., 0, :]
        self.turns = np.zeros_like(self.moves)
        if rotation is not None and kinematics.dimension == 2:  # angles may differ by more than half a turn
            self.turns = (self._ends[..., 1, 2:] - self._ends[..., 0, 2:]) * kinematics.rows[2, 3:]
        elif rotation is not None:
            self.turns = rotation_vector(rotation[..., 1, :, :] @ np.swapaxes(rotation[..., 0, :, :], -1, -2))

    @property
    def motion(self) -> np.ndarray:
        """Velocity and angular velocity of the hand per unit of the fraction of the path, (..., m)."""
        return np.concatenate([self.moves, self.turns], axis=-1) @ self.kinematics.rows.T

    def at(self, share: np.ndarray) -> HandPose:
        """Return the poses at fractions (K,) of the path: position (..., K, 3) [m] and rotation (..., K, 3, 3)."""
        place = self.start.place[..., None, :] + share[:, None] * self.moves[..., None, :]
        if self.start.rotation is None:
            return HandPose(place, None)
        turned = rotation_of(share[:, None] * self.turns[..., None, :])
        return HandPose(place, turned @ self.start.rotation[..., None, :, :])

    def slopes(self, share: np.ndarray) -> np.ndarray:
        """Return the derivatives of the hand's displacement and rotation at fractions (K,) of the path by its end
        coordinates.

        The shape is (..., K, m, 2 m), with the coordinates of the start first.
        """
        d, m = self.kinematics.dimension, self.kinematics.size
        slopes = np.zeros((*self._ends.shape[:-2], len(share), m, 2 * m))
        slopes[..., :d, :d], slopes[..., :d, m : m + d] = (s[:, None, None] * np.eye(d) for s in (1 - share, share))
        if m > d:
            of_start, of_turns = self.turn_slopes()
            start = rotation_of(share[:, None] * self.turns[..., None, :]) @ of_start[..., None, :, :]
            along = turning(share[:, None] * self.turns[..., None, :]) @ of_turns[..., None, :, :]
            turned = self.kinematics.rows[d:, 3:] @ (start + share[:, None, None] * along)
            slopes[..., d:, d:m], slopes[..., d:, m + d :] = np.split(turned, 2, axis=-1)
        return slopes

    def turn_slopes(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the derivatives of the start's rotation and of `turns` by the orientation's coordinates of start and
        end.

        The shape is (..., 3, 2 r) each, with r orientation coordinates.
        """
        d, r = self.kinematics.dimension, self.kinematics.size - self.kinematics.dimension
        spins = self.kinematics.rows[d:, 3:].T @ self.kinematics.spins(self._ends)[..., d:, d:]  # (..., 2, 3, r)
        at_start, at_end = spins[..., 0, :, :], spins[..., 1, :, :]
        of_start = np.concatenate([at_start, np.zeros_like(at_end)], axis=-1)
        left = np.concatenate([-rotation_of(self.turns) @ at_start, at_end], axis=-1)
        assert of_start.shape[-1] == 2 * r
        return of_start, np.linalg.solve(turning(self.turns), left)

    def start_slopes(self) -> np.ndarray:
        """Return the derivatives of the start's rotation matrix by the orientation's coordinates of start and end.

        The shape is (..., 3, 3, 2 r), with r orientation coordinates.
        """
        assert self.start.rotation is not None
        of_start, _ = self.turn_slopes()
        return np.moveaxis(skew(np.swapaxes(of_start, -1, -2)) @ self.start.rotation[..., None, :, :], -3, -1)
