"""Where the energy of a strike is: in which node it moves, in what it is stored, where it comes from and goes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from whiptool.errors import InputError
from whiptool.models.parameters import Model
from whiptool.models.spatial_arm import SpatialArm
from whiptool.rollout.trajectory import Trajectory, joint_points


@dataclass(frozen=True)
class Energies:
    """Energies over T instants of a chain of n links: those of the arm, then the whip's nodes on theirs.

    Args:
        t: Times [s], (T,).
        kinetic: Of each arm link and each node [J], (T, n); the whip's `hinge_mass` counts with the arm's last link.
        weight: Potential energy of their weight [J], (T, n), from the shoulder's height.
        springs: Energy in the spring of each joint [J], (T, n).
        work: Done by the arm's motors so far [J], (T,).
        lost: To dampers, friction and drag so far [J], (T,).
    """

    t: np.ndarray
    kinetic: np.ndarray
    weight: np.ndarray
    springs: np.ndarray
    work: np.ndarray
    lost: np.ndarray

    @property
    def stored(self) -> np.ndarray:
        """Kinetic and potential energy of the whole chain [J], (T,)."""
        return (self.kinetic + self.weight + self.springs).sum(axis=1)

    @property
    def imbalance(self) -> np.ndarray:
        """What is stored more than at the start, less work done, plus what was lost [J], (T,); 0 for exact motion."""
        return self.stored - self.stored[0] - self.work + self.lost


def joint_velocities(model: Model, q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Velocities of shoulder, joints and tip [m/s], shape (..., n + 1, 2), for joint positions q [rad] and velocities
    v [rad/s] of shape (..., n); the points are those of `joint_points`."""
    theta, omega = np.cumsum(q, axis=-1), np.cumsum(v, axis=-1)
    l = np.r_[model.arm.per_link("length"), model.whip.per_node("l")]
    steps = (l * omega)[..., None] * np.stack([np.cos(theta), np.sin(theta)], axis=-1)
    return np.concatenate([np.zeros((*steps.shape[:-2], 1, 2)), np.cumsum(steps, axis=-2)], axis=-2)


def energies(model: Model, trajectory: Trajectory) -> Energies:
    """Energies along a strike.

    Work and losses are the trapezoidal integrals of power, of second order in the trajectory's steps where the torque
    is continuous, and of first order where it is held for a control period.

    Args:
        model: The model that the strike was rolled out with.
        trajectory: Of T instants.

    Raises:
        InputError: The trajectory is of another number of joints.
    """
    arm, whip, a, n = model.arm, model.whip, model.arm.n, model.n
    t, q, v = trajectory.t, trajectory.q, trajectory.v
    if isinstance(arm, SpatialArm):
        raise InputError("model", model.name, "a model in the plane, for energies")
    if q.shape[1] != n:
        raise InputError("trajectory", f"of {q.shape[1]} joints", f"one of the model's {n}")
    points, velocities = joint_points(model, q), joint_velocities(model, q, v)
    square = (velocities**2).sum(axis=2)  # (T, n + 1)

    mass = np.r_[arm.per_link("mass"), whip.per_node("m")]
    share = np.r_[arm.per_link("com") / arm.per_link("length"), np.ones(whip.N)][:, None]  # of the link, to the mass
    centre = points[:, :-1] + share * np.diff(points, axis=1)  # (T, n, 2)
    speed = velocities[:, :-1] + share * np.diff(velocities, axis=1)
    kinetic = mass * (speed**2).sum(axis=2) / 2  # (T, n)
    kinetic[:, :a] += arm.per_link("inertia") * np.cumsum(v, axis=1)[:, :a] ** 2 / 2
    kinetic[:, a - 1] += whip.hinge_mass * square[:, a] / 2
    weight = mass * model.gravity * centre[:, :, 1]
    weight[:, a - 1] += whip.hinge_mass * model.gravity * points[:, a, 1]

    joints = ("k", "cubic_stiffness", "rest_angle", "b", "dry_friction")
    k, cubic, rest, b, dry = (np.r_[np.zeros(a), whip.per_node(x)] for x in joints)
    b[:a] = arm.per_link("friction")
    losses = b * v**2 + dry * v**2 / np.sqrt(v**2 + whip.friction_velocity**2)  # (T, n)
    theta = np.cumsum(q, axis=1)[:, a:]
    along = velocities[:, a + 1 :, 0] * np.sin(theta) - velocities[:, a + 1 :, 1] * np.cos(theta)  # (T, N)
    braked = square[:, a + 1 :] - (1 - whip.drag_ratio) * along**2
    drag = whip.per_node("drag") * np.sqrt(square[:, a + 1 :]) * braked  # (T, N)
    return Energies(
        t=t,
        kinetic=kinetic,
        weight=weight,
        springs=k * (q - rest) ** 2 / 2 + cubic * (q - rest) ** 4 / 4,
        work=_integral((trajectory.tau * v[:, :a]).sum(axis=1), t),
        lost=_integral(losses.sum(axis=1) + drag.sum(axis=1), t),
    )


def _integral(power: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Of a power (T,) [W] from the first instant to each [J], (T,)."""
    return np.r_[0.0, np.cumsum((power[1:] + power[:-1]) / 2 * np.diff(t))]
