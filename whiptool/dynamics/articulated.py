"""The articulated-body algorithm in space, one link at a time, in CasADi.

Featherstone, Rigid Body Dynamics Algorithms (2008), ch. 7: axes stay parallel to the world's, moments are taken about
each link's own joint, and accelerations are those of material points, so that a link's only velocity term is
centripetal. A link is attached by one or more hinges at one point; these are eliminated together, last to first, so
that the velocity terms between them are counted once.

Structural zeros and ones stay numbers and generate no terms. Angles of successive parallel hinges are summed before
sine and cosine, so that a chain of parallel axes only generates the terms of a planar chain.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import casadi as ca
import numpy as np

Axis = tuple[float, float, float]


class Link(NamedTuple):
    """A link of a whip along -z of its frame, with the same inertia about all axes."""

    length: ca.SX  # [m]
    mass: ca.SX  # [kg]
    com: ca.SX  # distance of the centre of mass from the link's joint [m]
    inertia: ca.SX  # moment of inertia about the centre of mass [kg m^2]
    drag: ca.SX  # air drag at the far end, see `WhipParameters`
    drag_ratio: ca.SX  # see `WhipParameters`

    @property
    def is_point_mass(self) -> bool:
        """Whether the link is a point mass at its far end: `com` and `length` are the same expression."""
        return ca.is_equal(self.com, self.length)


class Turned(NamedTuple):
    """An orientation as a product of rotations: `before` (3, 3), a rotation by `angle` about `axis`, and the constant
    `after` (3, 3).
    """

    before: ca.SX
    angle: ca.SX
    axis: Axis = (0.0, -1.0, 0.0)
    after: tuple[tuple[float, ...], ...] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))

    @property
    def matrix(self) -> ca.SX:
        """The orientation as one rotation matrix (3, 3)."""
        if self.angle.is_zero():
            return ca.mtimes(self.before, ca.SX(ca.DM(self.after)))
        return ca.mtimes(self.before, ca.mtimes(turn(self.axis, self.angle), ca.SX(ca.DM(self.after))))

    @property
    def settled(self) -> Turned:
        """Return the same orientation in the form `before` times a rotation by zero."""
        return Turned(self.matrix, ca.SX(0))

    def hinged(self, axis: Axis, q: ca.SX) -> tuple[Turned, ca.SX]:
        """Return the orientation after a hinge rotation by q about `axis` in the current frame, and that axis in the
        world (3, 1).

        If the axis is that of the preceding rotation, only the angles are added.
        """
        along = np.asarray(self.after) @ np.asarray(axis)  # in the axes of `before`
        share = float(along @ np.asarray(self.axis))
        if not self.angle.is_zero() and abs(abs(share) - 1) < 1e-12:
            sign = 1.0 if share > 0 else -1.0
            return self._replace(angle=self.angle + sign * q), sign * ca.mtimes(self.before, ca.SX(ca.DM(self.axis)))
        start = self.settled
        return Turned(start.before, q, axis), ca.mtimes(start.before, ca.SX(ca.DM(axis)))

    def offset(self, by: Sequence[Sequence[float]]) -> Turned:
        """Return the orientation after a further constant rotation `by` (3, 3) in the current frame."""
        after = np.asarray(self.after) @ np.asarray(by)
        return self._replace(after=tuple(map(tuple, after.tolist())))


def turn(axis: Axis, angle: ca.SX) -> ca.SX:
    """Return the matrix (3, 3) of a rotation by `angle` [rad] about the constant unit vector `axis` (3,); about a
    coordinate axis its constant entries are exactly 0 or 1."""
    a, sin, cos = np.asarray(axis, float), ca.sin(angle), ca.cos(angle)
    main = np.flatnonzero(np.abs(a) == 1)
    R = ca.SX.zeros(3, 3)
    if len(main):
        k = int(main[0])
        i, j = (k + 1) % 3, (k + 2) % 3
        R[k, k], R[i, i], R[j, j] = 1, cos, cos
        R[i, j], R[j, i] = (-sin, sin) if a[k] > 0 else (sin, -sin)
        return R
    skew = np.array([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]])
    both = np.outer(a, a)
    for i in range(3):
        for j in range(3):
            R[i, j] = cos * (float(i == j) - both[i, j]) + sin * skew[i, j] + both[i, j]
    return R


class SpatialFrame(NamedTuple):
    """Frame in which a link begins; vectors are (3, 1), in the world's axes."""

    turned: Turned  # orientation
    speed: ca.SX  # angular velocity [rad/s]
    velocity: ca.SX  # velocity of the origin [m/s]
    place: ca.SX  # position of the origin [m]

    ANGLE = 9  # where it is among the entries
    VELOCITY = 13  # where it begins
    PLACE = 16

    @classmethod
    def at_rest(cls) -> SpatialFrame:
        """Return the frame at the origin, at rest, with the world's axes."""
        return cls(Turned(ca.densify(ca.SX.eye(3)), ca.SX(0)), *(ca.SX.zeros(3) for _ in range(3)))

    def entries(self) -> list[ca.SX]:
        """All entries that vary along a whip, as scalars; velocity and position last."""
        parts = (self.turned.before, self.turned.angle, self.speed, self.velocity, self.place)
        return [x for part in parts for x in scalars(part)]

    def with_entries(self, entries: Sequence[ca.SX]) -> SpatialFrame:
        """Return the frame with these entries, rotated about the same axis."""
        turned = self.turned._replace(before=ca.reshape(ca.vertcat(*entries[:9]), 3, 3), angle=entries[9])
        speed, velocity, place = (ca.vertcat(*entries[i : i + 3]) for i in (10, 13, 16))
        return SpatialFrame(turned, speed, velocity, place)


class SpatialMoving(NamedTuple):
    """Motion of a link on K hinges; vectors are (3, 1), in the world's axes."""

    r: ca.SX  # vector from the link's joint to its far end [m]
    centripetal: ca.SX  # centripetal acceleration of the far end [m/s^2]
    com: ca.SX  # vector from the link's joint to its centre of mass [m]
    com_centripetal: ca.SX  # centripetal acceleration of the centre of mass [m/s^2]
    com_twist: ca.SX  # moment of `com_centripetal` about the joint, per mass [m^2/s^2]
    turning: ca.SX  # angular acceleration at constant speeds of the hinges [rad/s^2]
    drag: ca.SX  # air drag on the far end [N]
    axes: ca.SX  # axes of the hinges, (3, K)

    def entries(self) -> list[ca.SX]:
        """Return the 21 + 3 K entries as scalars, field by field, `axes` (3, K) column by column."""
        return [x for part in self for x in scalars(part)]

    def with_entries(self, entries: Sequence[ca.SX]) -> SpatialMoving:
        """Return the motion of a link with these entries."""
        parts = [ca.vertcat(*entries[i : i + 3]) for i in range(0, 21, 3)]
        parts.append(ca.reshape(ca.vertcat(*entries[21:]), 3, self.axes.shape[1]))
        return SpatialMoving(*parts)


class SpatialCarried(NamedTuple):
    """Inertia and load that a link's end carries, as an affine function of two accelerations.

    For the link's angular acceleration alpha [rad/s^2] and the end's acceleration a [m/s^2], the end has to exert the
    moment `J alpha + H a + moment` [N m] and the force `H^T alpha + M a + force` [N]. Matrices are (3, 3), vectors (3,
    1).
    """

    J: ca.SX = ca.SX.zeros(3, 3)
    H: ca.SX = ca.SX.zeros(3, 3)
    M: ca.SX = ca.SX.zeros(3, 3)
    moment: ca.SX = ca.SX.zeros(3)
    force: ca.SX = ca.SX.zeros(3)

    def entries(self) -> list[ca.SX]:
        """Return all entries as scalars; for symmetric matrices those on and above the diagonal."""
        parts = (upper(self.J), scalars(self.H), upper(self.M), scalars(self.moment), scalars(self.force))
        return [x for part in parts for x in part]

    def with_entries(self, entries: Sequence[ca.SX]) -> SpatialCarried:
        """Return the same quantities with these entries."""
        J, H, M = symmetric(entries[:6]), ca.reshape(ca.vertcat(*entries[6:15]), 3, 3), symmetric(entries[15:21])
        return SpatialCarried(J, H, M, ca.vertcat(*entries[21:24]), ca.vertcat(*entries[24:27]))


class SpatialJoint(NamedTuple):
    """Coefficients that give the accelerations of K hinges at one point, see `accelerate`.

    The accelerations are `qdd = free - gains.T [alpha; a] - among qdd`, with the angular acceleration alpha of the
    previous link [rad/s^2] and the acceleration a of the hinges' point [m/s^2], (3, 1) each. `gains` is (6, K), `free`
    (K, 1), and row k of `among` (K, K) multiplies the accelerations of the hinges before hinge k.
    """

    gains: ca.SX
    free: ca.SX
    among: ca.SX

    def entries(self) -> list[ca.SX]:
        """Return the 7 K + K K entries as scalars, field by field, each matrix column by column."""
        return [x for part in self for x in scalars(part)]

    def with_entries(self, entries: Sequence[ca.SX]) -> SpatialJoint:
        """Return the hinges' coefficients with these entries."""
        K = self.free.numel()
        gains, among = ca.reshape(ca.vertcat(*entries[: 6 * K]), 6, K), ca.vertcat(*entries[7 * K :])
        return SpatialJoint(gains, ca.vertcat(*entries[6 * K : 7 * K]), ca.reshape(among, K, K))


class SpatialAcceleration(NamedTuple):
    """Angular acceleration of the link to which a joint is attached [rad/s^2], and acceleration of the joint's point
    [m/s^2], (3, 1) each.
    """

    angular: ca.SX
    linear: ca.SX

    def entries(self) -> list[ca.SX]:
        """Return the six entries as scalars, those of the angular acceleration first."""
        return [x for part in self for x in scalars(part)]

    def with_entries(self, entries: Sequence[ca.SX]) -> SpatialAcceleration:
        """Return the acceleration with these entries."""
        return SpatialAcceleration(ca.vertcat(*entries[:3]), ca.vertcat(*entries[3:]))


# ---------------------------------------------------------------------------------------------------------------------
# One link


def outward(
    frame: SpatialFrame, q: ca.SX, v: ca.SX, link: Link, axes: Sequence[Axis]
) -> tuple[SpatialFrame, SpatialMoving]:
    """Return the frame at a link's far end and the link's motion, for hinge positions q [rad] and velocities v [rad/s],
    (K, 1).
    """
    turned, speed, turning, world = frame.turned, frame.speed, ca.SX.zeros(3), []
    for axis, q_k, v_k in zip(axes, ca.vertsplit(q), ca.vertsplit(v), strict=True):
        turned, along = turned.hinged(axis, q_k)
        turning = turning + ca.cross(speed, along * v_k)
        speed = speed + along * v_k
        world.append(along)
    down = -turned.matrix[:, 2]
    r = link.length * down
    by_turning = ca.cross(speed, r)
    velocity = frame.velocity + by_turning
    end = SpatialFrame(turned if len(axes) == 1 else turned.settled, speed, velocity, frame.place + r)
    drag = drag_force(link, velocity, down)
    centripetal = ca.cross(speed, by_turning)
    of_com = (r, centripetal, ca.SX.zeros(3))
    if not link.is_point_mass:
        com = link.com * down
        along = ca.dot(speed, com)
        of_com = (com, along * speed - ca.sumsqr(speed) * com, along * ca.cross(com, speed))
    return end, SpatialMoving(r, centripetal, *of_com, turning, drag, ca.horzcat(*world))


def drag_force(link: Link, velocity: ca.SX, down: ca.SX) -> ca.SX:
    """Return the quadratic drag (3, 1) [N] on a link's far end; `velocity` [m/s] and the link's direction `down` are
    (3, 1).

    A tiny constant keeps the square root differentiable at rest.
    """
    if link.drag.is_zero():
        return ca.SX.zeros(3)
    size = ca.sqrt(ca.sumsqr(velocity) + 1e-12)
    less = (1 - link.drag_ratio) * ca.dot(velocity, down)  # of the velocity along the link, not braked
    return -link.drag * size * (velocity - less * down)


def inward(carried: SpatialCarried, moving: SpatialMoving, link: Link) -> SpatialCarried:
    """Return the inertia and load on a link's hinges: those of the link, and `carried` on its far end."""
    body = link.mass * ca.densify(ca.SX.eye(3))
    M, H, force = carried.M, carried.H, carried.force - moving.drag
    if link.is_point_mass:  # joins what the end carries
        M = M + body
    across = _across(moving.r)
    lever = ca.mtimes(across, M)
    J = carried.J + link.inertia * ca.densify(ca.SX.eye(3))
    J = J - _mirrored(ca.mtimes(H + lever, across), ca.mtimes(H, across))
    force = force + ca.mtimes(M, moving.centripetal)
    moment = carried.moment + ca.mtimes(H, moving.centripetal) + ca.cross(moving.r, force)
    H = H + lever
    if not link.is_point_mass:
        across, own = _across(moving.com), link.mass * moving.com_centripetal
        lever = link.mass * across
        M, H, J = M + body, H + lever, J - _mirrored(ca.mtimes(lever, across), ca.SX.zeros(3, 3))
        force, moment = force + own, moment + link.mass * moving.com_twist
    if not moving.turning.is_zero():
        force, moment = force + ca.mtimes(H.T, moving.turning), moment + ca.mtimes(J, moving.turning)
    return SpatialCarried(J, H, M, moment, force)


def give_way(
    carried: SpatialCarried, axes: ca.SX, torque: ca.SX, armature: ca.SX
) -> tuple[SpatialCarried, SpatialJoint]:
    """Return the inertia and load on the previous link through free hinges (one step of the articulated-body
    algorithm), and the hinges' coefficients for `accelerate`, from their world axes (3, K), torques [N m] and armatures
    [kg m^2], (K, 1).
    """
    K, world = axes.shape[1], ca.horzsplit(axes)
    sides = [ca.vertcat(ca.mtimes(carried.J, s), ca.mtimes(carried.H.T, s)) for s in world]  # moment and force
    D = [[ca.dot(s, side[:3]) for side in sides] for s in world]
    left = [t - ca.dot(s, carried.moment) for t, s in zip(ca.vertsplit(torque), world, strict=True)]
    J, H, M, moment, force = carried
    gains, free, among = [ca.SX.zeros(6)] * K, [ca.SX(0)] * K, ca.SX.zeros(K, K)
    for k in reversed(range(K)):
        extra = armature[k]
        # the sign keeps one division a hinge: CasADi writes x * (1 / D) as a division, x * (-1 / D) as a product
        negative = ca.SX(-1) / (D[k][k] + extra)
        gain = sides[k] * negative
        less = left[k] * negative
        gains[k], free[k] = -gain, -less
        for l in range(k):
            share = D[l][k] * negative
            among[k, l] = -share
            sides[l] = sides[l] + sides[k] * share
            left[l] = left[l] + left[k] * share
            for m in range(l + 1):
                D[m][l] = D[m][l] + D[m][k] * share
        of, to = sides[k], gain
        J, M = _added(J, to[:3], of[:3]), _added(M, to[3:], of[3:])
        H = H + ca.mtimes(to[:3], of[3:].T)
        main = _world_axis(world[k]) if K == 1 else None
        if main is not None:  # of its row, only what the armature keeps
            stays = -extra * negative * world[k][main]
            for j in range(3):
                J[main, j] = J[j, main] = of[j] * stays
                H[main, j] = of[3 + j] * stays
        moment, force = moment - of[:3] * less, force - of[3:] * less
    return SpatialCarried(J, H, M, moment, force), SpatialJoint(ca.horzcat(*gains), ca.vertcat(*free), among)


def accelerate(
    at: SpatialAcceleration, joint: SpatialJoint, moving: SpatialMoving
) -> tuple[ca.SX, SpatialAcceleration]:
    """Return the hinges' accelerations (K, 1) [rad/s^2], and the acceleration at their link's far end."""
    both, found, angular = ca.vertcat(*at), [], at.angular + moving.turning
    for k, axis in enumerate(ca.horzsplit(moving.axes)):
        qdd = joint.free[k] - ca.dot(joint.gains[:, k], both)
        for l in range(k):
            qdd = qdd - joint.among[k, l] * found[l]
        found.append(qdd)
        angular = angular + axis * qdd
    return ca.vertcat(*found), SpatialAcceleration(
        angular, at.linear + ca.cross(angular, moving.r) + moving.centripetal
    )


# ---------------------------------------------------------------------------------------------------------------------
# Matrices of symbols and numbers


def scalars(x: ca.SX) -> list[ca.SX]:
    """Return the entries of a matrix, column by column."""
    return [ca.SX(value) for value in ca.vertsplit(ca.vec(ca.densify(ca.SX(x))))]


_UPPER = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))


def _across(r: ca.SX) -> ca.SX:
    """Return the matrix of the product `r x`."""
    return ca.densify(ca.skew(r))


def upper(A: ca.SX) -> list[ca.SX]:
    """Return a symmetric matrix's (3, 3) six entries on and above the diagonal."""
    return [A[i, j] for i, j in _UPPER]


def symmetric(entries: Sequence[ca.SX]) -> ca.SX:
    """Return the symmetric matrix (3, 3) from its six entries on and above the diagonal."""
    A = ca.SX.zeros(3, 3)
    for (i, j), x in zip(_UPPER, entries, strict=True):
        A[i, j] = A[j, i] = x
    return A


def _mirrored(A: ca.SX, B: ca.SX) -> ca.SX:
    """Return the symmetric `A + B^T`."""
    return symmetric([A[i, j] + B[j, i] for i, j in _UPPER])


def _added(A: ca.SX, x: ca.SX, y: ca.SX) -> ca.SX:
    """Return the symmetric `A + x y^T`."""
    return symmetric([A[i, j] + x[i] * y[j] for i, j in _UPPER])


def _world_axis(s: ca.SX) -> int | None:
    """Return which of the world's axes a constant axis lies along, if any."""
    if not s.is_constant():
        return None
    main = np.flatnonzero(np.abs(np.array(ca.DM(s))[:, 0]) == 1)
    return int(main[0]) if len(main) else None
