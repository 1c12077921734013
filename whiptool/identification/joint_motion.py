"""The motion of the whip's base with a measured arm or hand: its spline, and which of its directions a fit varies."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from scipy.linalg import solve_triangular

from whiptool.dynamics.swing import BASE, SPATIAL_BASE, hand_motion
from whiptool.errors import InputError
from whiptool.identification.motion import (
    JOINT_JERK,
    SAMPLES_A_KNOT,
    Moved,
    SmoothSpline,
    check_size,
    cross_validated,
    spacing,
)
from whiptool.models.parameters import AnyArm

_FINEST = 1e-8  # [rad], [m] of a log
_STILL = 0.1  # [rad/s^3], [m/s^3] of an arm that stands
# which numbers of a hand in space are those of a planar arm, of axis (0, -1, 0), behind its angle, and their signs: the
# angle's rates, and velocity, acceleration and place along x and z
_IN_PLANE, _SIGNS = [10, 16, 12, 14, 18, 20, 21, 23], np.array([-1.0, -1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0])


class JointMotion:
    """Motion of the whip's base at I equally spaced instants [s], with the hand of an arm whose a joints were measured:
    q (S, a) [rad or m] at times t (S,) [s]. The base rotates with the last link.

    The log errs as its differences say; where the spline differs from it by more, by as much. The spline's knots are
    `knots` [s] apart, by default as cross-validation says. The attribute `root` is the square root of the coefficients'
    covariance a priori, (C, C).
    """

    def __init__(
        self,
        t: np.ndarray,
        q: np.ndarray,
        arm: AnyArm,
        instants: np.ndarray,
        *,
        knots: float | None = None,
        at_rest: bool = False,
    ) -> None:
        if q.shape[1] != arm.n or len(t) < 8:
            raise InputError(
                "joints_q", f"shape {q.shape}", f"8 or more samples of {arm.n} joints, as many as the arm has"
            )
        width = BASE + 2 if arm.dimension == 2 else SPATIAL_BASE + 3
        check_size(instants, knots or spacing(t, max(SAMPLES_A_KNOT)), arm.n, width)
        noise, near = _noise(q, arm), (t >= instants[0]) & (t <= instants[-1])
        jerk = _jerk(t[near], q[near])
        knots = knots or cross_validated(t[near], q[near], noise, jerk=jerk, at_rest=at_rest)
        check_size(instants, knots, arm.n, width)
        spline = SmoothSpline(start=instants[0], end=instants[-1], knots=knots, jerk=jerk, d=arm.n, at_rest=at_rest)
        inside = (t >= instants[0] - knots) & (t <= instants[-1] + knots)
        basis = spline.basis(t[inside])
        self.start = spline.fit(t[inside], q[inside], np.broadcast_to(noise, q[inside].shape))
        off = _smoothed((q[inside] - basis @ self.start.reshape(-1, arm.n)) ** 2, t[inside], knots)
        sigma = np.sqrt(np.maximum(noise**2, off))
        C = len(self.start)
        self.rows, self.root = np.zeros((C, C)), np.zeros((C, C))
        for i in range(arm.n):  # the joints' coefficients are independent
            R = np.asarray(np.linalg.qr(np.vstack([basis / sigma[:, i, None], spline.prior]), mode="r"))
            own = slice(i, None, arm.n), slice(i, None, arm.n)
            self.rows[own], self.root[own] = R, solve_triangular(R, np.eye(len(R)))
        self.mean = self.rows @ self.start
        self._arm, self._bases = arm, np.stack([spline.basis(instants, i) for i in range(3)])  # (3, I, size)
        self._last: tuple[np.ndarray, tuple[np.ndarray, np.ndarray, np.ndarray]] | None = None

    def paths(self, directions: np.ndarray) -> np.ndarray:
        """Return how the joints and their first and second rates change along directions (C, k) of the coefficients,
        (I, 3 a, k)."""
        by_joint = directions.reshape(self._bases.shape[2], -1)
        found = (self._bases @ by_joint).reshape(*self._bases.shape[:2], self._arm.n, -1)
        return found.swapaxes(0, 1).reshape(found.shape[1], 3 * self._arm.n, -1)

    def at(self, c: np.ndarray, along: np.ndarray | None = None) -> Moved:
        """Return the motion of the whip's base for coefficients c (C,): one a joint for each function of the spline.
        Derivatives are by the k directions whose `paths` are given as `along`, by default by each coefficient."""
        a, d = self._arm.n, self._arm.dimension
        along = self.paths(np.eye(len(c))) if along is None else along
        joints, numbers, slopes = self._moved(c)
        changes = slopes.reshape(*slopes.shape[:2], -1) @ along  # (I, 24, k)
        if d == 2:  # the angle of the last link stands first
            numbers = np.column_stack([joints[0].sum(axis=1), numbers])
            changes = np.concatenate([along[:, :a].sum(axis=1)[:, None], changes], axis=1)
        changes = np.ascontiguousarray(changes.transpose(2, 0, 1))
        d_inputs = np.ascontiguousarray(changes[..., :-d])
        return Moved(numbers[:, :-d], d_inputs, numbers[:, -d:], changes[..., -d:], joints[0, 0], along[0, :a].T)

    def _moved(self, c: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Joints and their two rates (3, I, a), the base's motion (I, 24) and its derivatives by them (I, 24, 3, a); in
        the plane 7 numbers in place of 24. Where fits leave a motion as it is, they ask for the same again."""
        if self._last is None or not np.array_equal(c, self._last[0]):
            joints = self._bases @ c.reshape(-1, self._arm.n)
            found = hand_motion(self._arm.in_space(), *joints)
            numbers, slopes = np.hstack([found.inputs, found.place]), found.by_joints
            if self._arm.dimension == 2:
                numbers, slopes = _SIGNS * numbers[:, _IN_PLANE], _SIGNS[:, None, None] * slopes[:, _IN_PLANE]
            self._last = c.copy(), (joints, numbers, slopes)
        return self._last[1]


class ResolvedMotion:
    """A measured motion of the base with coefficients `log.start + log.root @ e` (C,), in which e differs from `point`,
    by default 0, only along k orthonormal directions (C, k). The k lengths along them are the unknowns; like e, they
    are standard normal."""

    def __init__(self, log: JointMotion, directions: np.ndarray, point: np.ndarray | None = None) -> None:
        self.log, self.directions = log, directions
        self._point = np.zeros(len(log.start)) if point is None else point
        self._along = log.paths(log.root @ directions)
        k = directions.shape[1]
        self.start, self.rows, self.mean = np.zeros(k), np.eye(k), np.zeros(k)

    def whole(self, x: np.ndarray) -> np.ndarray:
        """Return the e of unknowns x (k,), (C,)."""
        return self._point + self.directions @ x

    def outside(self, e: np.ndarray) -> np.ndarray:
        """Return the part of vectors e (C, any) that is not in the directions."""
        return e - self.directions @ (self.directions.T @ e)

    def at(self, c: np.ndarray) -> Moved:
        """Return the motion of the whip's base, with derivatives, for unknowns c (k,)."""
        return self.log.at(self.log.start + self.log.root @ self.whole(c), self._along)


def _noise(q: np.ndarray, arm: AnyArm) -> np.ndarray:
    """Return each joint's noise in a log (S, a), from differences that no smooth motion has, (a,)."""

    def rough(kind: np.ndarray) -> float:
        return float(np.median(np.abs(np.diff(q[:, kind], n=4, axis=0)))) / 0.6745 / math.sqrt(math.comb(8, 4))

    return np.maximum(_by_kind(arm, rough), _FINEST)


def _jerk(t: np.ndarray, q: np.ndarray) -> float:
    """Return the usual third derivative between samples (S, a) at times (S,) [s]: ten times the largest that they
    show, for an arm that stands at all of them hardly moves between them, and at most `JOINT_JERK`."""
    step = float(np.median(np.diff(t)))
    shown = float(np.abs(np.diff(q, n=3, axis=0)).max(initial=0.0)) / step**3
    return float(np.clip(10 * shown, _STILL, JOINT_JERK))


def _smoothed(values: np.ndarray, t: np.ndarray, knots: float) -> np.ndarray:
    """Return means of values (S, a) over the two pieces of a spline to each side of each time, (S, a)."""
    first, last = np.searchsorted(t, t - 2 * knots), np.searchsorted(t, t + 2 * knots, side="right")
    summed = np.concatenate([np.zeros((1, values.shape[1])), values.cumsum(axis=0)])
    return (summed[last] - summed[first]) / (last - first)[:, None]


def _by_kind(arm: AnyArm, of: Callable[[np.ndarray], float]) -> np.ndarray:
    """Return one number for all joints that turn, and one for all that slide, by a mask of them (a,): (a,)."""
    found = np.zeros(arm.n)
    for kind in (~arm.turns, arm.turns):
        if kind.any():
            found[kind] = of(kind)
    return found
