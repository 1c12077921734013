"""The same chain derived the other way, from its energies by Lagrange's equations: for analysis and as a check.

Nothing here is shared with the recursive algorithms of `chain.py` but the parameters.
"""

from __future__ import annotations

import casadi as ca

from whiptool.dynamics.chain import Chain


def lagrangian(chain: Chain, q: ca.SX, v: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Kinetic and potential energy [J] from the positions of all masses, `v` entering through their Jacobians."""
    n = chain.n
    length, mass, com = (ca.SX(x) for x in (chain.length, chain.mass, chain.com))
    T, V = ca.SX(0), ca.SX(0)
    for i in range(n):
        angles = [ca.sum1(q[: j + 1]) for j in range(i + 1)]
        arms = [length[j] for j in range(i)] + [com[i]]
        centre = ca.vertcat(
            sum((r * ca.sin(t) for r, t in zip(arms, angles, strict=True)), ca.SX(0)),
            -sum((r * ca.cos(t) for r, t in zip(arms, angles, strict=True)), ca.SX(0)),
        )
        velocity = ca.jtimes(centre, q, v)
        T += mass[i] * ca.sumsqr(velocity) / 2 + ca.SX(chain.inertia)[i] * ca.sum1(v[: i + 1]) ** 2 / 2
        V += mass[i] * chain.gravity * centre[1]
    for i in range(n):
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
    for i in range(chain.n):
        if drag[i].is_zero():
            continue
        angles = [ca.sum1(q[: j + 1]) for j in range(i + 1)]
        end = ca.vertcat(
            sum((ca.SX(chain.length)[j] * ca.sin(angles[j]) for j in range(i + 1)), ca.SX(0)),
            -sum((ca.SX(chain.length)[j] * ca.cos(angles[j]) for j in range(i + 1)), ca.SX(0)),
        )
        u = ca.jtimes(end, q, v)
        along = ca.vertcat(ca.sin(angles[i]), -ca.cos(angles[i]))
        across = ca.vertcat(ca.cos(angles[i]), ca.sin(angles[i]))
        braked = across * ca.dot(across, u) + chain.drag_ratio * along * ca.dot(along, u)
        Q += ca.jtimes(end, q, -drag[i] * ca.sqrt(ca.sumsqr(u) + 1e-12) * braked, True)
    return M, Q - ca.jtimes(momentum, q, v) + ca.gradient(T - V, q)
