"""The way of an arm's joints that holds its hand on a path: polynomials of the share of the path."""

from __future__ import annotations

import numpy as np
from numpy.polynomial import chebyshev

from whiptool.models.hand_strike import HandStrike
from whiptool.models.hand_way import HandWay
from whiptool.models.inverse_kinematics import HandKinematics, HandMotion, HandPose
from whiptool.models.rotations import quaternion_of, rotation_left
from whiptool.models.strike import eased

DEGREE = 12  # of the polynomials
NODES = (1 - np.cos(np.pi * np.arange(DEGREE + 1) / DEGREE)) / 2  # of Chebyshev and Lobatto, shares of the path
TO_SERIES = np.linalg.inv(chebyshev.chebvander(2 * NODES - 1, DEGREE))  # of values at the nodes
_EACH = np.eye(DEGREE + 1)
TO_POWERS = np.array([np.pad(chebyshev.cheb2poly(row), (0, DEGREE - i)) for i, row in enumerate(_EACH)]).T


class HandPath:
    """A strike of the hand for its arm: the joints' path that holds the hand on its own.

    Args:
        strike: Strike of the hand.
        nodes: Joint positions (DEGREE + 1, a) where the hand is at the nodes of its path.
        way: Path of the hand, from pose to pose.
    """

    def __init__(self, strike: HandStrike, nodes: np.ndarray, way: HandWay) -> None:
        self.strike, self.D, self.q_i, self.way = strike, strike.D, tuple(map(float, nodes[0])), way
        self._series = [TO_SERIES @ nodes]
        for _ in range(2):
            self._series.append(2 * chebyshev.chebder(self._series[-1], axis=0))  # by the share of the path

    def reference(self, t: float | np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Desired positions, velocities and accelerations of the joints at times t [s], each (*t.shape, a)."""
        s, ds, dds = (np.asarray(x, float)[..., None] for x in eased(np.asarray(t, float), self.D))
        q, by_s, twice = (np.moveaxis(chebyshev.chebval(2 * s[..., 0] - 1, c), 0, -1) for c in self._series)
        return q, by_s * ds, twice * ds**2 + by_s * dds

    def hand(self, t: float | np.ndarray) -> tuple[HandPose, np.ndarray]:
        """Desired place (*t.shape, 3) and rotation (*t.shape, 3, 3) of the hand at times t [s], and its velocity and
        angular velocity (*t.shape, m); Eq. 1."""
        s, ds, _ = eased(np.asarray(t, float), self.D)
        place, rotation = self.way.at(np.ravel(s))
        rotation = None if rotation is None else rotation.reshape(*s.shape, 3, 3)
        return HandPose(place.reshape(*s.shape, 3), rotation), ds[..., None] * self.way.motion

    def errors(self, t: float | np.ndarray, hand: HandMotion, speed: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the hand's errors at times t [s], of which a law of the hand is one, and their rates, (*t.shape, m).

        Those of its place are differences, that of its orientation is `rotation_left`.

        Args:
            t: (...,)
            hand: Pose of the hand at that time.
            speed: Its velocity and angular velocity then (..., m).
        """
        wanted, motion = self.hand(t)
        left = wanted.place - hand.position
        turn = np.zeros_like(left) if wanted.rotation is None else rotation_left(wanted.rotation, hand.rotation)
        return np.concatenate([left, turn], axis=-1) @ self.way.kinematics.rows.T, motion - speed


def hand_poses(kinematics: HandKinematics, q: np.ndarray) -> np.ndarray:
    """Return where postures (T, a) that follow each other hold the hand, in the base's axes, (T, 7).

    Place x, y, z [m], then the unit quaternion x, y, z, w, whose sign is the one nearer to the quaternion before. A
    strike plane stands upright: y is 0.
    """
    at = kinematics.motion(q)
    quaternions = quaternion_of(at.rotation)
    flips = np.vecdot(quaternions[1:], quaternions[:-1]) < 0
    signs = np.where(np.r_[False, np.cumsum(flips) % 2 == 1], -1.0, 1.0)
    return np.hstack([at.position, signs[:, None] * quaternions])
