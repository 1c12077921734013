"""How a strike moves the hand, how that lies to the arm's compliance, and Nah's measure of a miss.

The measure is that of whichever of the whip's last nodes comes nearest, until a fixed instant.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from whiptool import CompiledRollout, Trajectory
from whiptool.models.kinematics import arm_frames
from whiptool.models.spatial_arm import SpatialArm
from whiptool.models.strike import T_STAY, AnyStrike
from whiptool.models.trajectory import Approach, Points
from whiptool.rollout.interface import Rollout, Strikes

RATE = 60.0  # [1/s] at which the authors sample a movement


def hand_jacobian(arm: SpatialArm, q: np.ndarray) -> np.ndarray:
    """Return the derivatives of the hand's place by the joint positions (..., a), (..., 3, a) [m/rad; 1 on slides]."""
    frames = arm_frames(arm, q)
    hand, columns = frames[-1].origin, []
    for link, frame in zip(arm.links, frames, strict=False):
        axis = frame.rotation @ np.asarray(link.axis, float)
        columns.append(np.cross(axis, hand - frame.origin) if link.kind == "revolute" else axis)
    return np.stack(columns, axis=-1)


@dataclass(frozen=True, eq=False)
class Plane:
    """The plane nearest to points, by their singular values.

    Args:
        centre: Mean of the points (3,) [m].
        axes: Rows: the direction in which they spread most, the next, and the plane's normal, (3, 3).
        spread: Root mean square distance from the centre along each of them (3,) [m]; last: from the plane.
    """

    centre: np.ndarray
    axes: np.ndarray
    spread: np.ndarray

    @classmethod
    def through(cls, points: np.ndarray) -> Plane:
        """Fit to points (T, 3) [m]."""
        centre = points.mean(axis=0)
        _, values, axes = np.linalg.svd(points - centre, full_matrices=False)
        return cls(centre, axes, values / np.sqrt(len(points)))

    @property
    def outside(self) -> float:
        """Share of the points' variance that lies outside the plane, 0 to 1/3."""
        return float(self.spread[2] ** 2 / (self.spread**2).sum())


def shares(vectors: np.ndarray, axes: np.ndarray) -> np.ndarray:
    """Return how much of vectors' squared length lies along each axis, summed over time, (k,); they sum to 1.

    Args:
        vectors: (T, k).
        axes: Orthonormal columns, the same at all times (k, k) or not (T, k, k).
    """
    along = np.einsum("ti,...tij->tj" if axes.ndim == 3 else "ti,ij->tj", vectors, axes)
    squared = (along**2).sum(axis=0)
    return squared / squared.sum()


def task_compliance(arm: SpatialArm, K: np.ndarray, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the compliances of the hand along its principal axes, and these: `J inv(K) J'`, the most compliant first.

    Its inverse is the stiffness at the hand, whose softest direction is that of the largest compliance.

    Args:
        arm: Arm of a joints.
        K: Joint stiffness (a, a) [N m/rad].
        q: Joint positions (..., a) [rad].

    Returns:
        Compliances (..., 3) [m/N], and unit vectors in columns (..., 3, 3).
    """
    J = hand_jacobian(arm, q)
    values, axes = np.linalg.eigh(J @ np.linalg.inv(K) @ np.swapaxes(J, -1, -2))
    return values[..., ::-1], axes[..., ::-1]


def joint_compliance(K: np.ndarray) -> np.ndarray:
    """Return unit vectors along the principal axes of a joint stiffness (a, a), in columns, most compliant first."""
    return np.linalg.eigh(K)[1]


@dataclass(frozen=True)
class HandMeasures:
    """Of one movement, from its beginning until D.

    Args:
        rms: Root mean square distance of the hand from the nearest plane [m].
        outside: Share of its path's variance outside that plane.
        task: Shares of the hand's squared velocity along the principal compliances at the hand, largest first, (3,).
        joint: Shares of the squared deviation of the joints from their reference along the principal compliances of
            the joints, the largest first, (a,).
    """

    rms: float
    outside: float
    task: list[float]
    joint: list[float]


def measure(arm: SpatialArm, K: np.ndarray, path: Trajectory, D: float) -> HandMeasures:
    """Measure a strike's movement.

    Args:
        arm: Arm of a joints.
        K: Joint stiffness (a, a) [N m/rad].
        path: The strike.
        D: Duration of the movement [s].
    """
    moving = path.t <= D
    q, v = path.q[moving, : arm.n], path.v[moving, : arm.n]
    frames = arm_frames(arm, q, v)
    t = np.arange(0, D, 1 / RATE)
    hand = np.stack([np.interp(t, path.t[moving], x) for x in frames[-1].origin.T], axis=-1)
    plane = Plane.through(hand)
    deviation = q - path.q_d[moving]
    return HandMeasures(
        rms=float(plane.spread[2]),
        outside=plane.outside,
        task=shares(frames[-1].velocity, task_compliance(arm, K, q)[1]).tolist(),
        joint=shares(deviation, joint_compliance(K)).tolist(),
    )


class LastNodes(Rollout):
    """Rolls strikes out, and takes for the tip whichever of the last nodes comes nearest to the target.

    Args:
        rollout: What rolls them out.
        count: Number of nodes, the tip included.
        until: Instant after the movement's beginning at which a strike ends, whatever its duration is [s].
    """

    def __init__(self, rollout: CompiledRollout, count: int, until: float) -> None:
        self.model, self.engine, self.timestep = rollout.model, rollout.engine, rollout.timestep
        self.rollout, self.count, self.until = rollout, count, until

    def trajectory(self, strike: AnyStrike | np.ndarray, *, t_stay: float = T_STAY) -> Trajectory:
        """Return the whole of one strike until the fixed instant; `t_stay` says nothing here."""
        vector = self.one_vector(strike)
        return self.rollout.trajectory(vector, t_stay=self.until - float(vector[-1]))

    def approach(self, strikes: Strikes, target: Points, *, t_stay: float = T_STAY) -> Approach:
        """Return the closest approaches of the nearest of the nodes; `t_stay` says nothing here."""
        vectors = self.vectors(strikes)
        N = self.model.whip.N
        stay = self.until - vectors[:, -1]
        return self.rollout.nearest_node(vectors, target, nodes=range(N - self.count, N), t_stay=stay)
