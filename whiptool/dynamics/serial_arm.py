"""A serial arm of revolute and prismatic joints in CasADi: the torques due to its bodies, and its hand.

Featherstone, Rigid Body Dynamics Algorithms (2008), ch. 5 and 6: inertia by composite bodies, forces by recursive
Newton-Euler. Motions and forces are spatial vectors about the base's origin, in the world's axes, so that bodies are
added without transformation. Structural zeros stay the number 0 and generate no terms.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import casadi as ca

from whiptool.dynamics.articulated import Axis, Turned, scalars
from whiptool.models.spatial_arm import SpatialArm

Rotation = tuple[tuple[float, ...], ...]


class Body(NamedTuple):
    """A rigid body on a link: mass [kg], centre of mass (3, 1) [m], inertia about it (3, 3) [kg m^2]."""

    link: int
    mass: ca.SX
    com: ca.SX
    inertia: ca.SX


class ArmPosture(NamedTuple):
    """An arm's posture."""

    motions: list[ca.SX]  # spatial velocity of each joint per unit of its speed, (6, 1), angular first
    turned: list[Turned]  # orientation of each link's frame
    places: list[ca.SX]  # position of each link's frame [m], (3, 1)
    hand: ca.SX  # position of the hand [m], (3, 1)
    hand_turned: Turned  # orientation of the hand

    @property
    def jacobian(self) -> ca.SX:
        """Velocity of the hand in the base's axes per unit of the joints' speeds, (6, a): angular, then linear."""
        return ca.horzcat(*(ca.vertcat(S[:3], S[3:] + ca.cross(S[:3], self.hand)) for S in self.motions))


class ArmMotion(NamedTuple):
    """Dynamics of a moving arm with a joints under the load of a whip; gravity enters as the base's acceleration."""

    inertia: ca.SX  # joint-space mass matrix [kg m^2], (a, a)
    bias: ca.SX  # torques at zero joint acceleration [N m], (a, 1)
    jacobian: ca.SX  # velocity of the hand per unit of the joints' speeds, (6, a), angular first
    drift: ca.SX  # acceleration of the hand at zero joint acceleration, (6, 1), angular first
    weight: ca.SX  # torques that hold the weight of the compensated bodies, without the whip's [N m], (a, 1)
    place: ca.SX = ca.SX(0, 1)  # position of the hand (3, 1) [m] for a continuous law in its coordinates, else empty
    turned: ca.SX = ca.SX(0, 1)  # the hand's rotation by columns (9, 1), if that law has orientation, else empty

    def entries(self) -> list[ca.SX]:
        """Return all entries as scalars, field by field, each matrix column by column."""
        return [x for part in self for x in scalars(part)]

    def with_entries(self, entries: Sequence[ca.SX]) -> ArmMotion:
        """Return the motion with these entries."""
        parts, first = [], 0
        for part in self:
            parts.append(ca.reshape(ca.vertcat(*entries[first : first + part.numel()]), *part.shape))
            first += part.numel()
        return ArmMotion(*parts)


class LedMotion(NamedTuple):
    """An arm with prescribed motion as the whip feels it; gravity enters as the base's acceleration."""

    torque: ca.SX  # torques that the arm's own bodies need [N m], (a, 1)
    jacobian: ca.SX  # velocity of the hand per unit of the joints' speeds, (6, a), angular first
    acceleration: ca.SX  # acceleration of the hand, (6, 1), angular first

    def entries(self) -> list[ca.SX]:
        """Return the 7 a + 6 entries as scalars, field by field, each matrix column by column."""
        return [x for part in self for x in scalars(part)]

    def with_entries(self, entries: Sequence[ca.SX]) -> LedMotion:
        """Return the motion with these entries."""
        a = self.torque.numel()
        jacobian = ca.reshape(ca.vertcat(*entries[a : 7 * a]), 6, a)
        return LedMotion(ca.vertcat(*entries[:a]), jacobian, ca.vertcat(*entries[7 * a :]))


@dataclass(frozen=True)
class SerialArm:
    """A serial arm of symbols or numbers."""

    kinds: tuple[str, ...]  # of the joints, `revolute` or `prismatic`
    axes: tuple[Axis, ...]  # axis of each joint in its link's frame
    positions: list[ca.SX]  # of each joint in the frame of the previous link [m], (3, 1)
    rotations: tuple[Rotation, ...]  # of each link's frame in that of the previous link, with its joint at 0
    hand_position: ca.SX  # in the last link's frame [m], (3, 1)
    hand_rotation: Rotation  # in the last link's frame
    armatures: ca.SX  # inertia of the joints' rotors (a, 1) [kg m^2; kg for a prismatic joint]
    bodies: list[Body]  # that its links carry

    @classmethod
    def of(cls, arm: SpatialArm) -> SerialArm:
        """Return the arm of a model, with numeric parameters."""
        bodies = [
            Body(i, ca.SX(link.mass), ca.SX(ca.DM(link.com)), ca.SX(ca.DM(link.inertia_matrix)))
            for i, link in enumerate(arm.links)
        ]
        return cls(
            kinds=tuple(link.kind for link in arm.links),
            axes=tuple(link.axis for link in arm.links),
            positions=[ca.SX(ca.DM(link.position)) for link in arm.links],
            rotations=tuple(link.rotation for link in arm.links),
            hand_position=ca.SX(ca.DM(arm.hand_position)),
            hand_rotation=arm.hand_rotation,
            armatures=ca.SX(ca.DM(arm.per_link("armature"))),
            bodies=bodies,
        )

    @property
    def n(self) -> int:
        """The number a of the arm's joints."""
        return len(self.kinds)

    def posture(self, q: ca.SX) -> ArmPosture:
        """Return the arm's posture at joint positions q (a, 1) [rad or m]."""
        turned, place = Turned(ca.densify(ca.SX.eye(3)), ca.SX(0)), ca.SX.zeros(3)
        motions, all_turned, places = [], [], []
        for i, q_i in enumerate(ca.vertsplit(q)):
            place = place + _rotated(turned, self.positions[i])
            turned = turned.offset(self.rotations[i])
            if self.kinds[i] == "revolute":
                turned, axis = turned.hinged(self.axes[i], q_i)
                motions.append(ca.vertcat(axis, ca.cross(place, axis)))
            else:
                axis = _rotated(turned, ca.SX(ca.DM(self.axes[i])))
                place = place + axis * q_i
                motions.append(ca.vertcat(ca.SX.zeros(3), axis))
            all_turned.append(turned)
            places.append(place)
        hand = place + _rotated(turned, self.hand_position)
        return ArmPosture(motions, all_turned, places, hand, turned.offset(self.hand_rotation))

    def motion(self, q: ca.SX, v: ca.SX, gravity: ca.SX | float, weights: list[Body]) -> ArmMotion:
        """Return what couples the arm to the whip at joint positions q [rad or m] and speeds v [per s], (a, 1), under
        gravity [m/s^2]; `weights` are the bodies whose weight the gravity compensation holds.
        """
        at = self.posture(q)
        world = [_World.of(body, at) for body in self.bodies]
        drifts, speeds = self._drifts(at, v, ca.vertcat(0, 0, 0, 0, 0, gravity))
        return ArmMotion(
            inertia=self._inertia(at, world),
            bias=self._torques(at, world, drifts, speeds),
            jacobian=at.jacobian,
            drift=_of_point(drifts[-1], speeds[-1], at.hand),
            weight=self.weight(at, weights, gravity),
        )

    def led(self, q: ca.SX, v: ca.SX, a: ca.SX, gravity: ca.SX | float) -> LedMotion:
        """Return the torques and the hand's motion of an arm whose joint positions [rad or m], speeds [per s] and
        accelerations [per s^2], (a, 1) each, are prescribed.
        """
        at = self.posture(q)
        drifts, speeds = self._drifts(at, v, ca.vertcat(0, 0, 0, 0, 0, gravity), a)
        bodies = [_World.of(body, at) for body in self.bodies]
        torque = self._torques(at, bodies, drifts, speeds) + self.armatures * a
        return LedMotion(torque, at.jacobian, _of_point(drifts[-1], speeds[-1], at.hand))

    def weight(self, at: ArmPosture, bodies: list[Body], gravity: ca.SX | float) -> ca.SX:
        """Return the torques (a, 1) [N m] that hold the weight of the given bodies (Eq. 3)."""
        up = ca.vertcat(0, 0, gravity)
        forces = []
        for body in bodies:
            force = body.mass * up
            forces.append((body.link, ca.vertcat(ca.cross(_World.of(body, at).com, force), force)))
        return ca.vertcat(*(
            sum((ca.dot(S, force) for link, force in forces if link >= j), ca.SX(0)) for j, S in enumerate(at.motions)
        ))  # fmt: skip

    def inverse(self, q: ca.SX, v: ca.SX, a: ca.SX, gravity: ca.SX | float) -> ca.SX:
        """Return the torques (a, 1) [N m] that move the arm's bodies with accelerations `a` (a, 1)."""
        return self.led(q, v, a, gravity).torque

    def kinetic(self, q: ca.SX, v: ca.SX) -> ca.SX:
        """Return the kinetic energy of the arm's bodies and rotors [J]."""
        at = self.posture(q)
        return ca.dot(v, ca.mtimes(self._inertia(at, [_World.of(body, at) for body in self.bodies]), v)) / 2

    def potential(self, at: ArmPosture, gravity: ca.SX | float) -> ca.SX:
        """Return the potential energy of the arm's bodies in gravity [J], zero at the base's height."""
        bodies = [_World.of(body, at) for body in self.bodies]
        return sum((body.first[2] * gravity for body in bodies), ca.SX(0))

    def _drifts(self, at: ArmPosture, v: ca.SX, base: ca.SX, a: ca.SX | None = None) -> tuple[list[ca.SX], list[ca.SX]]:
        """Spatial accelerations and velocities of all links, (6, 1) each."""
        drift, speed, drifts, speeds = base, ca.SX.zeros(6), [], []
        for i, (S, v_i) in enumerate(zip(at.motions, ca.vertsplit(v), strict=True)):
            drift = drift + _moved(speed, S) * v_i + (0 if a is None else S * a[i])
            speed = speed + S * v_i
            drifts.append(drift)
            speeds.append(speed)
        return drifts, speeds

    def _torques(self, at: ArmPosture, world: list[_World], drifts: list[ca.SX], speeds: list[ca.SX]) -> ca.SX:
        """Torques (a, 1) of links that move so."""
        forces = [ca.SX.zeros(6) for _ in range(self.n)]
        for body in world:
            speed = speeds[body.link]
            momentum = body.times(speed)
            forces[body.link] += body.times(drifts[body.link]) + _forced(speed, momentum)
        torques, total = list[ca.SX](), ca.SX.zeros(6)
        for S, force in zip(reversed(at.motions), reversed(forces), strict=True):
            total = total + force
            torques.append(ca.dot(S, total))
        return ca.vertcat(*reversed(torques))

    def _inertia(self, at: ArmPosture, world: list[_World]) -> ca.SX:
        a = self.n
        H, carried = ca.densify(ca.diag(self.armatures)), _World.nothing()
        for j in reversed(range(a)):
            for body in world:
                if body.link == j:
                    carried = carried.plus(body)
            force = carried.times(at.motions[j])
            H[j, j] += ca.dot(at.motions[j], force)
            for i in range(j):
                H[i, j] = H[j, i] = ca.dot(at.motions[i], force)
        return H


class _World(NamedTuple):
    """Bodies together in the world: link, mass, first moment (3, 1) and inertia (3, 3) about the origin."""

    link: int
    mass: ca.SX
    first: ca.SX
    inertia: ca.SX
    com: ca.SX

    @classmethod
    def of(cls, body: Body, at: ArmPosture) -> _World:
        """The body of an arm in this posture."""
        turned = at.turned[body.link]
        com = at.places[body.link] + _rotated(turned, body.com)
        first = body.mass * com
        inertia = ca.SX.zeros(3, 3)
        if not body.inertia.is_zero():
            R = turned.matrix
            inertia = ca.mtimes(ca.mtimes(R, body.inertia), R.T)
        about_origin = ca.dot(first, com) * ca.densify(ca.SX.eye(3)) - ca.mtimes(first, com.T)
        return cls(body.link, body.mass, first, _upper_twice(inertia + about_origin), com)

    @classmethod
    def nothing(cls) -> _World:
        """Return a body without mass, inertia or first moment, to which others are added."""
        return cls(0, ca.SX(0), ca.SX.zeros(3), ca.SX.zeros(3, 3), ca.SX.zeros(3))

    def plus(self, other: _World) -> _World:
        """Return both bodies together: the sums of their masses, first moments (3, 1) and inertias (3, 3)."""
        return self._replace(
            mass=self.mass + other.mass, first=self.first + other.first, inertia=self.inertia + other.inertia
        )

    def times(self, motion: ca.SX) -> ca.SX:
        """Spatial force or momentum (6, 1) of a spatial acceleration or velocity."""
        angular, linear = motion[:3], motion[3:]
        return ca.vertcat(
            ca.mtimes(self.inertia, angular) + ca.cross(self.first, linear),
            self.mass * linear - ca.cross(self.first, angular),
        )


def _rotated(turned: Turned, x: ca.SX) -> ca.SX:
    return ca.SX.zeros(3) if x.is_zero() else ca.mtimes(turned.matrix, x)


def _moved(velocity: ca.SX, motion: ca.SX) -> ca.SX:
    """Return the spatial product `velocity x motion`."""
    turning, linear = velocity[:3], velocity[3:]
    return ca.vertcat(ca.cross(turning, motion[:3]), ca.cross(turning, motion[3:]) + ca.cross(linear, motion[:3]))


def _forced(velocity: ca.SX, force: ca.SX) -> ca.SX:
    """Return the spatial product `velocity x* force`."""
    turning, linear = velocity[:3], velocity[3:]
    return ca.vertcat(ca.cross(turning, force[:3]) + ca.cross(linear, force[3:]), ca.cross(turning, force[3:]))


def _of_point(drift: ca.SX, speed: ca.SX, point: ca.SX) -> ca.SX:
    """Return the angular acceleration and that of a material point (6, 1) of a spatial acceleration and velocity."""
    velocity = speed[3:] + ca.cross(speed[:3], point)
    linear = drift[3:] + ca.cross(drift[:3], point) + ca.cross(speed[:3], velocity)
    return ca.vertcat(drift[:3], linear)


def _upper_twice(A: ca.SX) -> ca.SX:
    """Return the symmetric matrix of the entries on and above the diagonal."""
    for i in range(3):
        for j in range(i):
            A[i, j] = A[j, i]
    return A


def solve(A: ca.SX, b: ca.SX) -> ca.SX:
    """Return x of `A x = b` by elimination without pivoting: for small matrices near a positive definite one."""
    A, b, n, inverse = ca.SX(A), ca.SX(b), b.numel(), []
    for i in range(n):
        inverse.append(ca.SX(-1) / A[i, i])
        for j in range(i + 1, n):
            factor = A[j, i] * inverse[i]
            A[j, i:] += factor * A[i, i:]
            b[j] += factor * b[i]
    for i in reversed(range(n)):
        b[i] = (sum((A[i, j] * b[j] for j in range(i + 1, n)), ca.SX(0)) - b[i]) * inverse[i]
    return b
