"""The cost that OIAC minimises (Eqs. 5-7), evaluated along a trajectory."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from whiptool.errors import InputError, expect
from whiptool.models.numbers import number
from whiptool.models.parameters import Model
from whiptool.models.trajectory import Trajectory


@dataclass(frozen=True, repr=False)
class Cost:
    """Cost of a strike, `J = J_c + J_p` (Eq. 5).

    `J_c` is the cost of the impedance (Eq. 6), and `J_p` the change of the error's energy (Eq. 7).
    """

    J_c: float
    J_p: float

    def __repr__(self) -> str:
        return f"Cost(J={self.J:.6g}, J_c={self.J_c:.6g}, J_p={self.J_p:.6g})"

    @property
    def J(self) -> float:
        """Total cost, `J_c + J_p` (Eq. 5)."""
        return self.J_c + self.J_p


def impedance_cost(
    trajectory: Trajectory,
    model: Model,
    *,
    D: float,
    beta: float,
    Q_K: np.ndarray | None = None,
    Q_B: np.ndarray | None = None,
) -> Cost:
    """Return the cost of a strike from time 0 to D.

    Args:
        trajectory: Trajectory with T instants of an arm with a joints.
        model: Model whose arm gives the inertia I(q).
        D: Duration of the movement [s].
        beta: Weight of the velocity error in `eps = e + beta de` (Eq. 8) [s].
        Q_K, Q_B: Weights of vec(K) and vec(B), (a^2, a^2), symmetric positive; default: identity.

    Raises:
        InputError: A weight has the wrong shape, or the trajectory ends before D.
    """
    from whiptool.impedance.arm import Arm

    expect(Model, model=model)
    expect(Trajectory, trajectory=trajectory)
    D, beta = number("D", D, low=0, strict=True), number("beta", beta)
    a = trajectory.q_d.shape[1]
    for name, Q in (("Q_K", Q_K), ("Q_B", Q_B)):
        if Q is not None and np.shape(Q) != (a * a, a * a):
            raise InputError(name, np.shape(Q), f"a matrix of shape {(a * a, a * a)}")
    if trajectory.t[-1] < D - 1e-9:
        raise InputError("trajectory", f"{trajectory.t[-1]:.4g} s long", f"at least D = {D:.4g} s")

    def squared_norm(gain: np.ndarray, Q: np.ndarray | None) -> np.ndarray:  # (T, a, a) -> (T,)
        vec = gain.transpose(0, 2, 1).reshape(len(gain), -1)  # columns on top of each other
        return np.einsum("ti,ij,tj->t", vec, np.eye(a * a) if Q is None else Q, vec)

    arm = Arm(model)
    e = trajectory.q_d - trajectory.q[:, :a]
    epsilon = e + beta * (trajectory.v_d - trajectory.v[:, :a])  # Eq. 8
    rate = squared_norm(trajectory.K, Q_K) + squared_norm(trajectory.B, Q_B)
    grid = np.append(trajectory.t[trajectory.t < D], D)
    J_c = np.trapezoid(np.interp(grid, trajectory.t, rate), grid) / 2  # Eq. 6
    V = np.array([x @ arm.inertia(q) @ x / 2 for x, q in zip(epsilon, trajectory.q[:, :a], strict=True)])  # Eq. 7
    J_p = np.interp(D, trajectory.t, V) - V[0]  # the integral of dV/dt
    return Cost(J_c=float(J_c), J_p=float(J_p))
