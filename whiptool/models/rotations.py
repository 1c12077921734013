"""Rotations and their vectors: axis times angle [rad]."""

from __future__ import annotations

import numpy as np


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
    """Return the matrices (..., 3, 3) of vectors (..., 3): `skew(a) @ b` is a x b."""
    return np.cross(np.eye(3), vector[..., None, :])


def turning(vector: np.ndarray) -> np.ndarray:
    """Return the matrix from a rotation vector's rate to the angular velocity, the left Jacobian of SO(3), (..., 3,
    3)."""
    angle = np.linalg.norm(vector, axis=-1)[..., None, None]
    K = skew(vector)
    small = angle < 1e-4
    safe = np.where(small, 1.0, angle)
    first = np.where(small, 0.5, (1 - np.cos(safe)) / safe**2)
    second = np.where(small, 1 / 6, (safe - np.sin(safe)) / safe**3)
    return np.eye(3) + first * K + second * K @ K
