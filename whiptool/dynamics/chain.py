"""The planar serial chain in CasADi: kinematics, articulated-body dynamics, energies.

Parameters are symbols or numbers; parameters that are the number 0 generate no terms. Link i hangs from joint i; its
absolute angle is `theta_i = q_0 + ... + q_i`, zero straight down, positive toward +x; y is up.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import casadi as ca
import numpy as np

from whiptool.dynamics import articulated
from whiptool.dynamics.articulated import Link, SpatialAcceleration, SpatialCarried, SpatialFrame
from whiptool.models.parameters import Model

PLANAR_AXIS = (0.0, -1.0, 0.0)  # of a hinge in the plane: a positive angle turns what hangs toward +x
Scalar = ca.SX | float
Vector = ca.SX | ca.DM | np.ndarray | Sequence  # (n,) of symbols or numbers


@dataclass(frozen=True)
class Chain:
    """Parameters of a planar chain of n links, each a column (n, 1) of symbols or numbers.

    `length`, `mass`, `com` (distance from the joint) and `inertia` (about the centre of mass) describe links;
    `stiffness`, `cubic_stiffness`, `rest_angle`, `damping` and `dry_friction` their joints; `drag` acts at each link's
    far end. `drag_ratio`, `friction_velocity` and `gravity` are single values. Units: see `WhipParameters`, `ArmLink`.
    """

    length: Vector
    mass: Vector
    com: Vector
    inertia: Vector
    stiffness: Vector
    damping: Vector
    rest_angle: Vector
    dry_friction: Vector
    drag: Vector
    cubic_stiffness: Vector
    drag_ratio: ca.SX | float = 1.0
    friction_velocity: ca.SX | float = 0.1
    gravity: ca.SX | float = 9.81

    def __post_init__(self) -> None:
        sizes = {f.name: ca.SX(getattr(self, f.name)).numel() for f in fields(self)}
        scalars = ("drag_ratio", "friction_velocity", "gravity")
        hinges = sizes.pop("rest_angle")  # one for each of a universal joint's two
        assert hinges in (self.n, 2 * self.n), hinges
        assert all(size == (1 if name in scalars else self.n) for name, size in sizes.items()), sizes

    @property
    def n(self) -> int:
        """Number of links of the chain."""
        return ca.SX(self.length).numel()

    def each(self, name: str) -> list[ca.SX]:
        """Return the field `name`, a quantity of the n links, as n CasADi scalars."""
        return ca.vertsplit(ca.SX(getattr(self, name)))

    @property
    def links(self) -> list[Link]:
        """The n links, each with its own parameters."""
        length, mass, com, inertia, drag = (self.each(x) for x in ("length", "mass", "com", "inertia", "drag"))
        return [Link(length[i], mass[i], com[i], inertia[i], drag[i], ca.SX(self.drag_ratio)) for i in range(self.n)]


def ride_on_end(
    mass: Scalar, com: Scalar, inertia: Scalar, length: Scalar, load: Scalar
) -> tuple[Scalar, Scalar, Scalar]:
    """Return mass, centre of mass and inertia of a link with a point mass `load` on its far end."""
    total = mass + load
    c = (mass * com + load * length) / total
    return total, c, inertia + mass * (c - com) ** 2 + load * (length - c) ** 2


def chain_of(model: Model, *, node_inertia: float = 0.0) -> Chain:
    """Return arm and whip of a model in the plane as one chain with numeric parameters; nodes have at least the inertia
    `node_inertia` [kg m^2], for engines that need a positive one.
    """
    arm, whip = model.arm, model.whip
    zeros, l = np.zeros(arm.n), whip.per_node("l")
    length, mass, com, inertia = (arm.per_link(name) for name in ("length", "mass", "com", "inertia"))
    if whip.hinge_mass:
        carried = ride_on_end(mass[-1], com[-1], inertia[-1], length[-1], whip.hinge_mass)
        mass[-1], com[-1], inertia[-1] = carried
    return Chain(
        length=np.r_[length, l],
        mass=np.r_[mass, whip.per_node("m")],
        com=np.r_[com, l],
        inertia=np.r_[inertia, np.maximum(whip.per_node("node_inertia"), node_inertia)],
        stiffness=np.r_[zeros, whip.per_node("k")],
        damping=np.r_[arm.per_link("friction"), whip.per_node("b")],
        rest_angle=np.r_[zeros, whip.per_node("rest_angle")],
        dry_friction=np.r_[zeros, whip.per_node("dry_friction")],
        drag=np.r_[zeros, whip.per_node("drag")],
        cubic_stiffness=np.r_[zeros, whip.per_node("cubic_stiffness")],
        drag_ratio=whip.drag_ratio,
        friction_velocity=whip.friction_velocity,
        gravity=model.gravity,
    )


def passive_torque(chain: Chain, q: ca.SX, v: ca.SX) -> ca.SX:
    """Torque of springs, dampers and smoothed dry friction [N m], shape (n, 1)."""
    bent = q - ca.SX(chain.rest_angle)
    spring = -ca.SX(chain.stiffness) * bent - ca.SX(chain.cubic_stiffness) * bent**3
    friction = -ca.SX(chain.dry_friction) * v / ca.sqrt(v**2 + chain.friction_velocity**2)
    return spring - ca.SX(chain.damping) * v + friction


def forward_dynamics(chain: Chain, q: ca.SX, v: ca.SX, torque: ca.SX, *, armature: ca.SX | None = None) -> ca.SX:
    """Return joint accelerations [rad/s^2], (n, 1), by the articulated-body algorithm, for all joint torques [N m],
    including passive ones. `armature` [kg m^2], (n, 1), is added to the diagonal of the mass matrix; the integrator
    adds its implicit damping here.
    """
    n, links = chain.n, chain.links
    qs, vs, tau = (ca.vertsplit(ca.SX(x)) for x in (q, v, torque))
    extra = ca.vertsplit(ca.SX.zeros(n) if armature is None else ca.SX(armature))
    frame, moving = SpatialFrame.at_rest(), []
    for link, q_i, v_i in zip(links, qs, vs, strict=True):
        frame, link_moves = articulated.outward(frame, q_i, v_i, link, (PLANAR_AXIS,))
        moving.append(link_moves)
    carried, joints = SpatialCarried(), []
    for i in reversed(range(n)):
        carried = articulated.inward(carried, moving[i], links[i])
        carried, joint = articulated.give_way(carried, moving[i].axes, tau[i], extra[i])
        joints.append(joint)
    gravity = ca.vertcat(0, 0, chain.gravity)  # enters as the base's acceleration
    acceleration, result = SpatialAcceleration(ca.SX.zeros(3), gravity), []
    for joint, moves in zip(reversed(joints), moving, strict=True):
        qdd, acceleration = articulated.accelerate(acceleration, joint, moves)
        result.append(qdd)
    return ca.vertcat(*result)


def inverse_dynamics(chain: Chain, q: ca.SX, v: ca.SX, a: ca.SX) -> ca.SX:
    """Return the joint torques [N m], (n, 1), that give accelerations `a` [rad/s^2], by recursive Newton-Euler.

    Drag is included; passive torques (springs, dampers, friction) are not.
    """
    theta, omega, alpha = (ca.vertsplit(ca.cumsum(ca.SX(z))) for z in (q, v, a))
    length, mass, com, inertia = (chain.each(x) for x in ("length", "mass", "com", "inertia"))
    ux, uy, ax, ay = ca.SX(0), ca.SX(0), ca.SX(0), ca.SX(chain.gravity)
    links = []
    for i, link in enumerate(chain.links):
        s, c, w2 = ca.sin(theta[i]), ca.cos(theta[i]), omega[i] ** 2
        x, y, cx, cy = length[i] * s, -length[i] * c, com[i] * s, -com[i] * c
        Fx, Fy = mass[i] * (ax - alpha[i] * cy - w2 * cx), mass[i] * (ay + alpha[i] * cx - w2 * cy)
        ux, uy = ux - omega[i] * y, uy + omega[i] * x
        drag = articulated.drag_force(link, ca.vertcat(ux, 0, uy), ca.vertcat(s, 0, -c))
        links.append((x, y, cx, cy, Fx, Fy, inertia[i] * alpha[i], drag[0], drag[2]))
        ax, ay = ax - alpha[i] * y - w2 * x, ay + alpha[i] * x - w2 * y
    fx, fy, moment, torques = ca.SX(0), ca.SX(0), ca.SX(0), list[ca.SX]()
    for x, y, cx, cy, Fx, Fy, N, dx, dy in reversed(links):
        moment = moment + N + cx * Fy - cy * Fx + x * (fy - dy) - y * (fx - dx)
        fx, fy = fx - dx + Fx, fy - dy + Fy
        torques.append(moment)
    return ca.vertcat(*reversed(torques))


def bias_forces(chain: Chain, q: ca.SX, v: ca.SX) -> ca.SX:
    """Torques due to gravity, velocities and drag [N m], shape (n, 1): inverse dynamics at zero acceleration."""
    return inverse_dynamics(chain, q, v, ca.SX.zeros(chain.n))


def mass_matrix(chain: Chain, q: ca.SX) -> ca.SX:
    """Joint-space mass matrix [kg m^2], shape (n, n)."""
    a = ca.SX.sym("a", chain.n)
    return ca.jacobian(inverse_dynamics(chain, q, ca.SX.zeros(chain.n), a), a)


def kinetic_energy(chain: Chain, q: ca.SX, v: ca.SX) -> ca.SX:
    """Kinetic energy [J], summed over the links."""
    theta, omega = ca.vertsplit(ca.cumsum(ca.SX(q))), ca.vertsplit(ca.cumsum(ca.SX(v)))
    length, mass, com, inertia = (chain.each(x) for x in ("length", "mass", "com", "inertia"))
    ux, uy, T = ca.SX(0), ca.SX(0), ca.SX(0)
    for i in range(chain.n):
        ex, ey = omega[i] * ca.cos(theta[i]), omega[i] * ca.sin(theta[i])  # velocity per length along the link
        T += (mass[i] * ((ux + com[i] * ex) ** 2 + (uy + com[i] * ey) ** 2) + inertia[i] * omega[i] ** 2) / 2
        ux, uy = ux + length[i] * ex, uy + length[i] * ey
    return T


def potential_energy(chain: Chain, q: ca.SX) -> ca.SX:
    """Potential energy of gravity and springs [J], with height counted from the first joint."""
    theta = ca.vertsplit(ca.cumsum(ca.SX(q)))
    length, mass, com = (chain.each(x) for x in ("length", "mass", "com"))
    y, V = ca.SX(0), ca.SX(0)
    for i in range(chain.n):
        V += mass[i] * chain.gravity * (y - com[i] * ca.cos(theta[i]))
        y = y - length[i] * ca.cos(theta[i])
    bent = q - ca.SX(chain.rest_angle)
    return V + ca.dot(ca.SX(chain.stiffness), bent**2) / 2 + ca.dot(ca.SX(chain.cubic_stiffness), bent**4) / 4
