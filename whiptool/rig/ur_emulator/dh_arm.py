"""Kinematics of a UR5e by the maker's Denavit-Hartenberg parameters, in the frame `base` of its controller.

These are not the numbers of whiptool's preset, which is in the frame `base_link`: the two frames differ by half a turn
about z, so that x and y have the opposite sign.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

# https://www.universal-robots.com/articles/ur/application-installation/dh-parameters-for-calculations-of-kinematics-and-dynamics/
_A = (0.0, -0.425, -0.3922, 0.0, 0.0, 0.0)
_D = (0.1625, 0.0, 0.0, 0.1333, 0.0997, 0.0996)
_ALPHA = (np.pi / 2, 0.0, 0.0, np.pi / 2, -np.pi / 2, 0.0)
_ELBOW = 2  # the frame after the second joint is at the elbow


def _frames(q: np.ndarray) -> list[np.ndarray]:
    """Homogeneous matrices of the base and of each link's frame, (4, 4) each."""
    frames = [np.eye(4)]
    for angle, a, d, alpha in zip(q, _A, _D, _ALPHA, strict=True):
        c, s, ca, sa = np.cos(angle), np.sin(angle), np.cos(alpha), np.sin(alpha)
        step = [[c, -s * ca, s * sa, a * c], [s, c * ca, -c * sa, a * s], [0, sa, ca, d], [0, 0, 0, 1]]
        frames.append(frames[-1] @ np.array(step))
    return frames


def tool_pose(q: np.ndarray, offset: np.ndarray) -> np.ndarray:
    """Return the tool's position [m] and rotation vector [rad] in `base`, (6,).

    Args:
        q: Joint positions [rad], (6,).
        offset: Pose of the tool in the flange's frame, as position and rotation vector, (6,).
    """
    flange = _frames(q)[-1]
    turned = Rotation.from_matrix(flange[:3, :3])
    turn = (turned * Rotation.from_rotvec(offset[3:])).as_rotvec()
    return np.concatenate([flange[:3, 3] + turned.apply(offset[:3]), turn])


def speeds(q: np.ndarray, v: np.ndarray, offset: np.ndarray) -> tuple[float, float, float]:
    """Return the speeds of the elbow, the flange and the tool [m/s].

    Args:
        q, v: Joint positions [rad] and speeds [rad/s], (6,).
        offset: As in `tool_pose`.
    """
    frames = _frames(q)
    flange = frames[-1]
    tool = flange[:3, 3] + flange[:3, :3] @ offset[:3]
    found = []
    for point, joints in ((frames[_ELBOW][:3, 3], _ELBOW), (flange[:3, 3], 6), (tool, 6)):
        arms = [np.cross(frame[:3, 2], point - frame[:3, 3]) for frame in frames[:joints]]
        found.append(float(np.linalg.norm(v[:joints] @ np.array(arms))))
    return found[0], found[1], found[2]
