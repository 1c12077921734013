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
    """Path of an arm's joints for a strike in hand space: the hand follows its straight path.

    Args:
        strike: Strike of the hand.
        nodes: Joint positions at the interpolation nodes of the hand's path, (DEGREE + 1, a).
        way: Path of the hand.
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
        """Return the desired pose of the hand at times t [s], and its velocity and angular velocity (*t.shape, m) (Eq.
        1).

        The pose is a position (*t.shape, 3) [m] and a rotation (*t.shape, 3, 3).
        """
        s, ds, _ = eased(np.asarray(t, float), self.D)
        place, rotation = self.way.at(np.ravel(s))
        rotation = None if rotation is None else rotation.reshape(*s.shape, 3, 3)
        return HandPose(place.reshape(*s.shape, 3), rotation), ds[..., None] * self.way.motion

    def errors(self, t: float | np.ndarray, hand: HandMotion, speed: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the hand's errors at times t [s], from which a control law computes forces, and their rates,
        (*t.shape, m).

        Position errors are differences; the orientation error is `rotation_left`.

        Args:
            t: Times [s], (...,).
            hand: Pose of the hand at these times.
            speed: Velocity and angular velocity of the hand at these times, (..., m).
        """
        wanted, motion = self.hand(t)
        left = wanted.place - hand.position
        turn = np.zeros_like(left) if wanted.rotation is None else rotation_left(wanted.rotation, hand.rotation)
        return np.concatenate([left, turn], axis=-1) @ self.way.kinematics.rows.T, motion - speed


def hand_poses(kinematics: HandKinematics, q: np.ndarray) -> np.ndarray:
    """Return the poses of the hand in the base's frame for a sequence of joint positions (T, a), (T, 7).

    They are position x, y, z [m] and unit quaternion x, y, z, w with a continuous sign. For a planar arm the plane is
    vertical: y is 0.
    """
    at = kinematics.motion(q)
    quaternions = quaternion_of(at.rotation)
    flips = np.vecdot(quaternions[1:], quaternions[:-1]) < 0
    signs = np.where(np.r_[False, np.cumsum(flips) % 2 == 1], -1.0, 1.0)
    return np.hstack([at.position, signs[:, None] * quaternions])
