"""The hand's way from pose to pose: its place along a straight line, its orientation about one axis, evenly."""

from __future__ import annotations

import numpy as np

from whiptool.models.inverse_kinematics import HandKinematics, HandPose
from whiptool.models.rotations import rotation_of, rotation_vector, skew, turning


class HandWay:
    """Ways of the hand between coordinates; they turn by the rotation that is left, the shortest in space.

    Args:
        kinematics: Kinematics of the hand.
        ends: Its coordinates at the start and at the end, (..., 2, m).

    Attributes:
        start: Its pose there: place (..., 3) and rotation (..., 3, 3).
        moves: From the start's place to the end's (..., 3) [m].
        turns: From the start's orientation to the end's, a rotation vector (..., 3) [rad]; zero where orientation does
            not count.
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
        """The hand's velocity and angular velocity per unit of the share of the way that is behind, (..., m)."""
        return np.concatenate([self.moves, self.turns], axis=-1) @ self.kinematics.rows.T

    def at(self, share: np.ndarray) -> HandPose:
        """Return the poses at shares (K,) of the way: place (..., K, 3) and rotation (..., K, 3, 3)."""
        place = self.start.place[..., None, :] + share[:, None] * self.moves[..., None, :]
        if self.start.rotation is None:
            return HandPose(place, None)
        turned = rotation_of(share[:, None] * self.turns[..., None, :])
        return HandPose(place, turned @ self.start.rotation[..., None, :, :])

    def slopes(self, share: np.ndarray) -> np.ndarray:
        """Return the hand's displacement and turn at shares (K,) of the way per unit of the coordinates of its start
        and end, (..., K, m, 2 m)."""
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
        """Return how the hand turns at the start, and how `turns` change, per unit of the orientation's coordinates of
        start and end, (..., 3, 2 r) each."""
        d, r = self.kinematics.dimension, self.kinematics.size - self.kinematics.dimension
        spins = self.kinematics.rows[d:, 3:].T @ self.kinematics.spins(self._ends)[..., d:, d:]  # (..., 2, 3, r)
        at_start, at_end = spins[..., 0, :, :], spins[..., 1, :, :]
        of_start = np.concatenate([at_start, np.zeros_like(at_end)], axis=-1)
        left = np.concatenate([-rotation_of(self.turns) @ at_start, at_end], axis=-1)
        assert of_start.shape[-1] == 2 * r
        return of_start, np.linalg.solve(turning(self.turns), left)

    def start_slopes(self) -> np.ndarray:
        """Return the derivatives of the start's rotation by the orientation's coordinates of start and end, (..., 3, 3,
        2 r)."""
        assert self.start.rotation is not None
        of_start, _ = self.turn_slopes()
        return np.moveaxis(skew(np.swapaxes(of_start, -1, -2)) @ self.start.rotation[..., None, :, :], -3, -1)
