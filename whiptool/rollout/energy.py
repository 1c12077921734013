"""Energies over a strike: kinetic energy of each node, potential energies, work of the motors, and losses."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from whiptool.dynamics.rods import RodDamping, half_square, rod_damping
from whiptool.errors import InputError
from whiptool.models.kinematics import MovingFrame, arm_frames, chain_motion, hinged_frames
from whiptool.models.parameters import Model
from whiptool.models.trajectory import Trajectory
from whiptool.models.whip import WhipParameters


@dataclass(frozen=True)
class Energies:
    """Energies at T instants of the arm's a links, followed by the whip's N nodes.

    Args:
        t: Times [s], (T,).
        kinetic: Kinetic energy of each arm link and each node [J], (T, a + N); that of a link includes its
            rotor, and that of the last link the whip's `hinge_mass`.
        weight: Potential energy in gravity [J], (T, a + N), zero at the base's height.
        springs: Energy in the springs of the joints [J], (T, a + N).
        work: Work done by the arm's motors so far [J], (T,).
        lost: Energy dissipated by dampers, friction and drag so far [J], (T,).
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
        """Energy error [J], (T,): increase of the stored energy, minus work, plus dissipation; 0 for exact motion."""
        return self.stored - self.stored[0] - self.work + self.lost


def energies(model: Model, trajectory: Trajectory) -> Energies:
    """Return the energies along a strike, in the plane or in space.

    Work and losses are trapezoidal integrals of power: of second order in the trajectory's steps for a continuous
    torque, of first order for one that is held for a control period.

    Args:
        model: Model with which the strike was simulated.
        trajectory: Trajectory of T instants.

    Raises:
        InputError: The trajectory has another number of joints.
    """
    whip, a, n = model.whip, model.arm.n, model.coordinates
    t, q, v = trajectory.t, trajectory.q, trajectory.v
    if q.shape[1] != n:
        raise InputError("trajectory", f"{q.shape[1]} joints", f"a trajectory of the model's {n} joints")
    moving = _motion(model, q, v)

    mass = np.r_[model.arm.per_link("mass"), whip.per_node("m")]
    kinetic = mass * (moving.speeds**2).sum(axis=2) / 2 + moving.turning  # (T, a + N)
    kinetic[:, a - 1] += whip.hinge_mass * (moving.velocities[:, a] ** 2).sum(axis=1) / 2
    weight = mass * model.gravity * moving.centres[:, :, -1]
    weight[:, a - 1] += whip.hinge_mass * model.gravity * moving.points[:, a, -1]

    lost = (model.arm.per_link("friction") * v[:, :a] ** 2).sum(axis=1) + moving.braking
    lost += _drag(model, np.diff(moving.points[:, a:], axis=1), moving.velocities[:, a + 1 :])
    return Energies(
        t=t,
        kinetic=kinetic,
        weight=weight,
        springs=np.hstack([np.zeros((len(t), a)), moving.springs]),
        work=_integral((trajectory.tau * v[:, :a]).sum(axis=1), t),
        lost=_integral(lost, t),
    )


class _Moving(NamedTuple):
    """How a chain moves at T instants, in d coordinates.

    Args:
        points, velocities: Points and velocities of base, joints and tip [m, m/s], (T, a + 1 + N, d).
        centres, speeds: Centres and speeds of the masses of the arm's links and of the nodes [m, m/s], (T, a + N, d).
        turning: Kinetic energy of each link's or node's turning about its centre, and of its rotor [J], (T, a + N).
        springs: Energy in the springs of each node [J], (T, N).
        braking: Power that the dampers and dry friction of the whip's joints take [W], (T,).
    """

    points: np.ndarray
    velocities: np.ndarray
    centres: np.ndarray
    speeds: np.ndarray
    turning: np.ndarray
    springs: np.ndarray
    braking: np.ndarray


def _motion(model: Model, q: np.ndarray, v: np.ndarray) -> _Moving:
    """The motion of an arm and whip, in the plane or in space."""
    whip, a, arm = model.whip, model.arm.n, model.arm.in_space()
    points, velocities = chain_motion(model, q, v)
    seen = [0, 1, 2] if model.dimension == 3 else [0, 2]
    *frames, hand = arm_frames(arm, q[:, :a], v[:, :a])
    centres = [frame.carried(link.com) for frame, link in zip(frames, arm.links, strict=True)]
    spins = (np.einsum("tji,tj->ti", frame.rotation, frame.spin) for frame in frames)  # in the links' axes, (T, 3)
    turning = np.zeros((len(q), a + whip.N))
    for i, (link, spin) in enumerate(zip(arm.links, spins, strict=True)):
        turning[:, i] = np.einsum("ti,ij,tj->t", spin, link.inertia_matrix, spin) / 2 + link.armature * v[:, i] ** 2 / 2
    if whip.kind.hinges:
        bends, slips = (x.reshape(len(q), whip.N, -1) ** 2 for x in (q[:, a:] - whip.rest_angles, v[:, a:]))
        springs = np.sum([_spring_energy(model, x) for x in np.moveaxis(bends, 2, 0)], axis=0)
        braking = np.sum([_braking_power(model, x) for x in np.moveaxis(slips, 2, 0)], axis=0)
        nodes = hinged_frames(hand, whip.per_node("l"), whip.kind.hinges, q[:, a:], v[:, a:])
        spin = np.stack([frame.spin for frame in nodes], axis=1)
        turning[:, a:] = whip.per_node("node_inertia") * (spin**2).sum(axis=2) / 2
    else:
        squares, bending = _bends_of_rods(hand, whip, q[:, a:], v[:, a:])
        springs, braking = _spring_energy(model, squares), bending.power
    origins, speeds = (
        np.stack([getattr(at, name) for at in centres], axis=1)[..., seen] for name in ("origin", "velocity")
    )
    return _Moving(
        points=points,
        velocities=velocities,
        centres=np.concatenate([origins, points[:, a + 1 :]], axis=1),
        speeds=np.concatenate([speeds, velocities[:, a + 1 :]], axis=1),
        turning=turning,
        springs=springs,
        braking=braking.sum(axis=1),
    )


def _bends_of_rods(
    hand: MovingFrame, whip: WhipParameters, q: np.ndarray, v: np.ndarray
) -> tuple[np.ndarray, RodDamping]:
    """Squares of each rod's bend, by the series of `dynamics.rods`, (T, N), and what damps it."""
    d, rate = (x.reshape(len(x), -1, 3) for x in (q, v))
    directions = np.concatenate([-hand.rotation[:, None, :, 2], d], axis=1)  # (T, N + 1, 3)
    turns = np.concatenate([hand.spin[:, None], np.cross(d, rate)], axis=1)
    u = 1 - (directions[:, :-1] * directions[:, 1:]).sum(axis=2)
    return 2 * half_square(u)[0], rod_damping(whip, directions, turns)


def _spring_energy(model: Model, squares: np.ndarray) -> np.ndarray:
    """Of joints whose bends have these squares [rad^2], (T, N): [J]."""
    return model.whip.per_node("k") * squares / 2 + model.whip.per_node("cubic_stiffness") * squares**2 / 4


def _braking_power(model: Model, squares: np.ndarray) -> np.ndarray:
    """Of dampers and dry friction of joints whose speeds have these squares [rad^2/s^2], (T, N): [W]."""
    whip = model.whip
    root = np.sqrt(squares + whip.friction_velocity**2)
    return (whip.per_node("b") + whip.per_node("dry_friction") / root) * squares


def _drag(model: Model, links: np.ndarray, velocities: np.ndarray) -> np.ndarray:
    """Power that drag takes [W], (T,), from nodes at the ends of these links and of these velocities, (T, N, d)."""
    whip = model.whip
    square = (velocities**2).sum(axis=2)
    along = (velocities * links).sum(axis=2) / whip.per_node("l")
    return (whip.per_node("drag") * np.sqrt(square) * (square - (1 - whip.drag_ratio) * along**2)).sum(axis=1)


def _integral(power: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Of a power (T,) [W] from the first instant to each [J], (T,)."""
    return np.r_[0.0, np.cumsum((power[1:] + power[:-1]) / 2 * np.diff(t))]
