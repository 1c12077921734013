"""Where arm and whip are over a strike, for a scene in space: the plane's y is the height z."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from whiptool.models.capsules import Capsule
from whiptool.models.kinematics import arm_poses, chain_motion, quaternion_of, upright
from whiptool.models.parameters import Model
from whiptool.models.trajectory import Trajectory
from whiptool.viz.drawn_posture import at_times

RATE = 100.0  # [1/s] at which postures are kept
_THIN = 0.028  # of the arm's length, radius of links without shapes


@dataclass(frozen=True, eq=False)
class ScenePostures:
    """Arm and whip at T equally spaced instants.

    Args:
        t: Times [s], (T,).
        origins: Origins of the frames of the links, and last of the hand [m], (T, a + 1, 3).
        quaternions: Their rotations, w first, (T, a + 1, 4).
        whip: Positions of the hand and the nodes [m], (T, N + 1, 3).
        rods: Rotations that turn z along the piece of the whip behind each of these but the last, w first, (T, N, 4).
    """

    t: np.ndarray
    origins: np.ndarray
    quaternions: np.ndarray
    whip: np.ndarray
    rods: np.ndarray

    def at(self, time: float) -> int:
        """Return the index of the instant nearest to a time [s]."""
        return int(np.clip(np.round((time - self.t[0]) * RATE), 0, len(self.t) - 1))


def postures(model: Model, trajectory: Trajectory) -> ScenePostures:
    """Return arm and whip over a strike."""
    t = np.arange(trajectory.t[0], trajectory.t[-1] + 0.5 / RATE, 1 / RATE)
    q, a = at_times(t, trajectory.t, trajectory.q), model.arm.n
    origins, rotations = arm_poses(model.arm.in_space(), q[:, :a])
    x, y, z, w = np.moveaxis(quaternion_of(rotations), -1, 0)
    whip = upright(chain_motion(model, q)[0][:, a:])
    return ScenePostures(t, origins, np.stack([w, x, y, z], axis=-1), whip, _along(np.diff(whip, axis=1)))


def _along(pieces: np.ndarray) -> np.ndarray:
    """Return rotations (..., 4), w first, that turn z along vectors (..., 3)."""
    x, y, z = np.moveaxis(pieces / np.linalg.norm(pieces, axis=-1, keepdims=True), -1, 0)
    half = np.sqrt(np.maximum(1 + z, 0.0) / 2)  # cosine of half the angle
    up = half > 1e-6
    safe = np.where(up, 2 * half, 1.0)
    # straight down: half a turn about x
    return np.stack([half, np.where(up, -y / safe, 1.0), np.where(up, x / safe, 0.0), np.zeros_like(x)], axis=-1)


def shapes(model: Model) -> list[tuple[Capsule, ...]]:
    """Return the shapes of the base and of each link in its frame, (a + 1,); of an arm without them thin capsules from
    joint to joint."""
    arm = model.arm.in_space()
    if any(not x.name for x in arm.base) or any(link.capsules for link in arm.links):
        return [arm.base, *(link.capsules for link in arm.links)]
    ends = [*(link.position for link in arm.links[1:]), arm.hand_position]
    thin = _THIN * arm.length
    found: list[tuple[Capsule, ...]] = [(Capsule((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 1.6 * thin), *arm.base)]
    for end in ends:
        found.append((Capsule((0.0, 0.0, 0.0), end, thin),) if any(end) else ())
    return found
