"""The planar chain derived the other way, from its energies by Lagrange's equations, and where its links end.

Nothing here is shared with the recursive algorithms of `whiptool.dynamics.chain` but the parameters.
"""

from __future__ import annotations

import casadi as ca

from whiptool.dynamics.chain import Chain


def lagrangian(chain: Chain, q: ca.SX, v: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Kinetic and potential energy [J] from the positions of all masses, `v` entering through their Jacobians."""
    mass, com = ca.SX(chain.mass), ca.SX(chain.com)
    angles, ends = _links(chain, q)
    centres = [end + com[i] * _along(angle) for i, (end, angle) in enumerate(zip(ends, angles, strict=False))]
    velocities = _pairs(ca.jtimes(ca.vertcat(*centres), q, v))
    T, V = ca.SX(0), ca.SX(0)
    for i in range(chain.n):
        T += mass[i] * ca.sumsqr(velocities[i]) / 2 + ca.SX(chain.inertia)[i] * ca.sum1(v[: i + 1]) ** 2 / 2
        V += mass[i] * chain.gravity * centres[i][1]
        bent = q[i] - ca.SX(chain.rest_angle)[i]
        V += ca.SX(chain.stiffness)[i] * bent**2 / 2 + ca.SX(chain.cubic_stiffness)[i] * bent**4 / 4
    return T, V


def lagrangian_dynamics(chain: Chain, torque: ca.SX, q: ca.SX, v: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Mass matrix `M` (n, n) and right-hand side `r` (n, 1) of `M a = r` from d/dt dL/dv - dL/dq = Q.

    The generalised forces Q are `torque` (without springs, which are in the potential), dampers and dry friction
    from a dissipation function, and drag by virtual work at the links' ends.
    """
    T, V = lagrangian(chain, q, v)
    momentum = ca.gradient(T, v)
    M = ca.jacobian(momentum, v)
    Q = torque - ca.SX(chain.damping) * v
    Q -= ca.SX(chain.dry_friction) * v / ca.sqrt(v**2 + chain.friction_velocity**2)
    drag = ca.SX(chain.drag)
    if not drag.is_zero():
        angles, (_, *ends) = _links(chain, q)
        velocities, forces = _pairs(ca.jtimes(ca.vertcat(*ends), q, v)), []
        for i, (u, angle) in enumerate(zip(velocities, angles, strict=True)):
            along, across = _along(angle), ca.vertcat(ca.cos(angle), ca.sin(angle))
            braked = across * ca.dot(across, u) + chain.drag_ratio * along * ca.dot(along, u)
            forces.append(-drag[i] * ca.sqrt(ca.sumsqr(u) + 1e-12) * braked)
        Q += ca.jtimes(ca.vertcat(*ends), q, ca.vertcat(*forces), True)
    return M, Q - ca.jtimes(momentum, q, v) + ca.gradient(T - V, q)


def _links(chain: Chain, q: ca.SX) -> tuple[list[ca.SX], list[ca.SX]]:
    """Angles of the n links against the vertical, and their n + 1 ends from the base to the tip, (2, 1) each."""
    length, angles, ends = ca.SX(chain.length), [], [ca.SX.zeros(2)]
    for i in range(chain.n):
        angles.append(q[i] if i == 0 else angles[-1] + q[i])
        ends.append(ends[-1] + length[i] * _along(angles[-1]))
    return angles, ends


def _along(angle: ca.SX) -> ca.SX:
    """Along a link, (2, 1)."""
    return ca.vertcat(ca.sin(angle), -ca.cos(angle))


def _pairs(column: ca.SX) -> list[ca.SX]:
    return ca.vertsplit(column, 2)


def link_ends(chain: Chain, q: ca.SX) -> ca.SX:
    """Positions of the links' far ends [m], shape (n, 2); the last row is the tip."""
    theta = ca.cumsum(ca.SX(q))
    l = ca.SX(chain.length)
    return ca.horzcat(ca.cumsum(l * ca.sin(theta)), ca.cumsum(-l * ca.cos(theta)))


def tip_state(chain: Chain, q: ca.SX, v: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Tip position [m] and velocity [m/s], each (2, 1)."""
    theta, omega, l = ca.cumsum(ca.SX(q)), ca.cumsum(ca.SX(v)), ca.SX(chain.length)
    s, c = l * ca.sin(theta), l * ca.cos(theta)
    return ca.vertcat(ca.sum1(s), -ca.sum1(c)), ca.vertcat(ca.dot(c, omega), ca.dot(s, omega))
