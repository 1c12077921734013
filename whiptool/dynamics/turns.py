"""Rotations of symbols: by a rotation vector, and how far one is from another."""

from __future__ import annotations

import casadi as ca

_NONE = 1e-12  # [rad]; a smaller turn is taken as zero
_FLAT = 1e-15  # keeps what is left of half a turn finite


def turned_by(vector: ca.SX, share: ca.SX) -> ca.SX:
    """Return the rotation matrix (3, 3) by `share` times a rotation vector (3, 1) [rad], smooth also at zero
    (Rodrigues).
    """
    angle = ca.sqrt(ca.sumsqr(vector) + _NONE**2)
    K = ca.skew(vector)
    first, half = ca.sin(share * angle) / angle, ca.sin(share * angle / 2) / angle
    return ca.SX.eye(3) + first * K + 2 * half**2 * ca.mtimes(K, K)


def rotation_left(wanted: ca.SX, present: ca.SX) -> ca.SX:
    """Return the rotation `wanted @ present.T` from one orientation (3, 3) to another, as its unit axis in the world
    frame times 2 sin(angle / 2), (3, 1).

    It is computed from the antisymmetric part, which contains sin(angle), and the trace, 1 + 2 cos(angle).
    """
    R = ca.mtimes(wanted, present.T)
    sine = ca.vertcat(R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]) / 2
    return 2 * sine / ca.sqrt(1 + ca.trace(R) + _FLAT)
