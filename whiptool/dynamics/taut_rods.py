"""Rods in explicit steps, which transmit forces only along themselves.

Without the terms of an implicit integrator, the only inertia of a rod is the mass m at its end. The load on its joint
is then a mass M along its direction d and a force, with the recursion

    M = m / (1 - s^2 kappa),    s = d . d',    kappa = M' / (m + M'),

with d', M' of the next rod. With e the acceleration of the rod's end and a that of its joint, e - a is the direction's
acceleration times the length, and the force along d follows from d . (e - a) = -l |d d / dt|^2. The joint's torque B
and the reaction of the next joint, B', give a force across the rod: n = (B - B') x d / l. The result is that of `rods`
with gain 0, with a fifth of the operations.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import casadi as ca

from whiptool.dynamics.articulated import Link, SpatialCarried, SpatialMoving, scalars


class TautCarried(NamedTuple):
    """Inertia and load on a rod's joint."""

    mass: ca.SX = ca.SX(0)  # [kg], along `direction`
    direction: ca.SX = ca.SX.zeros(3)  # (3, 1)
    moment: ca.SX = ca.SX.zeros(3)  # [N m], (3, 1)
    force: ca.SX = ca.SX.zeros(3)  # [N], (3, 1)

    def entries(self) -> list[ca.SX]:
        """Return the 10 entries as scalars, field by field."""
        return [x for part in self for x in scalars(part)]

    def with_entries(self, entries: Sequence[ca.SX]) -> TautCarried:
        """Return the same quantities with these entries."""
        return TautCarried(entries[0], *(ca.vertcat(*entries[i : i + 3]) for i in (1, 4, 7)))

    @property
    def spatial(self) -> SpatialCarried:
        """The inertia and load in spatial form, for the drive."""
        M = self.mass * ca.mtimes(self.direction, self.direction.T)
        return SpatialCarried(M=M, moment=self.moment, force=self.force)


class TautJoint(NamedTuple):
    """Coefficients of a rod for `accelerate`.

    The force along the rod is `mass` [kg] times its joint's acceleration along it, plus `pull` [N].
    """

    mass: ca.SX  # [kg]
    pull: ca.SX  # [N]
    push: ca.SX  # other forces on the rod's end [N], (3, 1)
    kappa: ca.SX  # mass that the next rod adds along `beyond`, as a fraction of its sum with the rod's mass
    beyond: ca.SX  # direction of the next rod, (3, 1)
    per_mass: ca.SX  # inverse of the rod's mass [1/kg]
    per_length: ca.SX  # inverse of the rod's length [1/m]

    def entries(self) -> list[ca.SX]:
        """Return the 11 entries as scalars, field by field."""
        return [x for part in self for x in scalars(part)]

    def with_entries(self, entries: Sequence[ca.SX]) -> TautJoint:
        """Return the rod's coefficients with these entries."""
        mass, pull, kappa, per_mass, per_length = (entries[i] for i in (0, 1, 5, 9, 10))
        push, beyond = (ca.vertcat(*entries[i : i + 3]) for i in (2, 6))
        return TautJoint(mass, pull, push, kappa, beyond, per_mass, per_length)


class PointAcceleration(NamedTuple):
    """Acceleration of the point where the next rod begins, (3, 1) [m/s^2]."""

    linear: ca.SX

    def entries(self) -> list[ca.SX]:
        """Return the three entries as scalars."""
        return scalars(self.linear)

    def with_entries(self, entries: Sequence[ca.SX]) -> PointAcceleration:
        """Return the acceleration with these entries."""
        return PointAcceleration(ca.vertcat(*entries))


def give_way(carried: TautCarried, moving: SpatialMoving, link: Link, torque: ca.SX) -> tuple[TautCarried, TautJoint]:
    """Return the inertia and load of this rod, with what its end carries, on the previous rod, and this rod's
    coefficients for `accelerate`; its length and mass are those of `link`, its joint's torque is (3, 1) [N m].
    """
    d, after = moving.axes[:, 0], carried.direction
    per_mass, per_length = 1 / link.mass, 1 / link.length
    across = ca.cross(torque - carried.moment, d) * per_length
    push = across + moving.drag - carried.force
    kappa, s = carried.mass / (link.mass + carried.mass), ca.dot(d, after)
    mass = link.mass / (1 - kappa * s**2)
    along = per_mass * (ca.dot(d, push) - kappa * s * ca.dot(after, push))
    pull = mass * (ca.dot(d, moving.centripetal) - along)
    joint = TautJoint(mass, pull, push, kappa, after, per_mass, per_length)
    return TautCarried(mass, d, torque, across + pull * d), joint


def accelerate(at: PointAcceleration, joint: TautJoint, moving: SpatialMoving) -> tuple[ca.SX, PointAcceleration]:
    """Return the second derivative of a rod's unit direction (3, 1) [1/s^2], and the acceleration at its far end."""
    d = moving.axes[:, 0]
    force = joint.push + (joint.mass * ca.dot(d, at.linear) + joint.pull) * d
    end = joint.per_mass * (force - joint.kappa * ca.dot(joint.beyond, force) * joint.beyond)
    return joint.per_length * (end - at.linear), PointAcceleration(end)
