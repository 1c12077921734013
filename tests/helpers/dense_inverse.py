"""Inverse dynamics of a whole chain in space as one expression, and its derivatives by CasADi."""

from __future__ import annotations

import casadi as ca
import numpy as np

from whiptool.dynamics import inverse
from whiptool.dynamics.closed_loop import ClosedLoop


def inverse_dynamics(loop: ClosedLoop, q: ca.SX, v: ca.SX, qdd: ca.SX) -> ca.SX:
    """Torques of all joints [N m] that give accelerations, beside those of springs, dampers, friction and drag; of a
    rod the torque on its turning, in the world's axes (3, 1)."""
    a, K, pulls, torques = loop.n_drive, loop.link_size, [], []
    q, v, qdd = (ca.SX(x) for x in (q, v, qdd))
    of_arm = q[:a], v[:a], qdd[:a]
    at = inverse.at_hand(loop, *of_arm)
    for i in range(loop.n_links):
        w = ca.vertcat(*(loop.p[first + i * by] for first, by in loop.link_columns.values()))
        at, pull = inverse.outward(loop, at, *(x[a + K * i : a + K * (i + 1)] for x in (q, v, qdd)), w)
        pulls.append(pull)
    felt = inverse.at_tip(loop, at.frame)
    for pull in reversed(pulls):
        felt, torque = inverse.inward(loop, felt, pull)
        torques.append(torque)
    return ca.vertcat(inverse.of_arm(loop, *of_arm, felt), *reversed(torques))


def dense_slopes(
    loop: ClosedLoop, p: np.ndarray, q0: np.ndarray, v0: np.ndarray, across: np.ndarray | None
) -> tuple[np.ndarray, ...]:
    """M, C and K of a chain of hinges, or of rods whose deviations are along `across` (N, 3, 2)."""
    a = loop.n_drive
    n = a + 2 * loop.n_links
    x, dx, ddx = (ca.SX.sym(name, n) for name in ("x", "dx", "ddx"))
    start, rate = q0, v0
    if across is None:
        torque = inverse_dynamics(loop, x, dx, ddx)
    else:
        start = np.r_[q0[:a], np.zeros(n - a)]
        rate = np.r_[v0[:a], np.einsum("nij,ni->nj", across, v0[a:].reshape(-1, 3)).ravel()]
        moved = [q0[a + 3 * i : a + 3 * i + 3] + across[i] @ x[a + 2 * i : a + 2 * i + 2] for i in range(len(across))]
        directions = [d / ca.norm_2(d) for d in moved]
        q = ca.vertcat(x[:a], *directions)
        v = ca.jtimes(q, x, dx)
        turned = [ca.mtimes(ca.skew(d), ca.jacobian(d, x)) for d in directions]
        turns = ca.vertcat(ca.jacobian(x[:a], x), *turned)
        acceleration = ca.jtimes(v, x, dx) + ca.jtimes(q, x, ddx)
        torque = ca.mtimes(turns.T, inverse_dynamics(loop, q, v, acceleration))
    found = ca.Function("slopes", [x, dx, ddx, loop.p], [ca.jacobian(torque, y) for y in (ddx, dx, x)], {"cse": True})
    return tuple(matrix.full() for matrix in found(start, rate, 0, p))
