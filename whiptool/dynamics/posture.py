"""How a strike starts: the arm at q_i, the whip at rest below the hand."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from whiptool.dynamics.closed_loop import Structure, closed_loop
from whiptool.models.kinematics import hanging_angles
from whiptool.models.parameters import Model
from whiptool.models.spatial_arm import SpatialArm

_AT_ONCE = 24  # postures in one call


def hangs_straight(model: Model) -> bool:
    """Whether the whip hangs straight down: its hinge has no spring, and no joint a rest angle."""
    return hinge_is_free(model) and not model.whip.per_node("rest_angle").any()


def hinge_is_free(model: Model) -> bool:
    """Whether the whip's hinge has no spring, so that the whip's shape at rest does not depend on the arm."""
    return not any(model.whip.per_node(name)[0] for name in ("k", "cubic_stiffness"))


def start_posture(model: Model, q_i: np.ndarray) -> np.ndarray:
    """Joint positions at the start [rad], shape (B, n), for arm postures q_i of shape (B, a).

    A whip that does not hang straight starts where weight and springs balance, found by Newton's method from straight
    down.
    """
    a, n = model.arm.n, model.n
    q = np.zeros((len(q_i), n))
    q[:, :a] = q_i
    if isinstance(model.arm, SpatialArm):
        q[:, a : a + 2] = hanging_angles(model.arm, q_i)
        return q
    q[:, a] = -q_i.sum(axis=1)
    if hangs_straight(model):
        return q
    if not hinge_is_free(model):
        _settle(model, q)
        return q
    hanging = np.zeros((1, n))
    _settle(model, hanging)
    q[:, a:] += hanging[0, a:]
    return q


def _settle(model: Model, q: np.ndarray) -> None:
    """Moves the whip's joints to where weight and springs balance, in place."""
    a, n = model.arm.n, model.n
    balance, p = _balance(model)
    for row in q:
        for _ in range(100):
            gradient, hessian, _ = (x.full() for x in balance(row, p, 0, 0))
            # a negative curvature would lead uphill: damp until the Hessian is positive
            shift = max(0.0, 1e-9 - np.linalg.eigvalsh(hessian)[0])
            step = np.linalg.solve(hessian + shift * np.eye(n - a), gradient[:, 0])
            largest = np.abs(step).max()
            row[a:] -= step if largest < 0.5 else step * (0.5 / largest)
            if largest < 1e-12:
                break


def start_derivative(model: Model, structure: Structure, q: np.ndarray, p: np.ndarray, dp: np.ndarray) -> np.ndarray:
    """Change of the start postures q (B, n) along changes dp (B, P) of the parameters p (B, P): (B, n).

    Where the whip is bent, balance is kept: `H dq_whip = -(change of the energy's gradient)`.
    """
    a = structure.n_arm
    dq = np.zeros_like(q)
    dq[:, :a] = dp[:, :a]  # q_i stands first
    dq[:, a] = -dp[:, :a].sum(axis=1)
    springs = ["whip.k", *(["whip.cubic_stiffness"] if "cubic_stiffness" in structure.optional else [])]
    hinge = [structure.columns(name).start for name in springs]  # a spring at the hinge would bend the whip
    if hangs_straight(model) and "rest_angle" not in structure.optional and not dp[:, hinge].any():
        return dq
    dq[:, a:] = 0
    balance, n = _at_once(structure), structure.n - a
    for i in range(0, len(q), _AT_ONCE):
        some = slice(i, i + _AT_ONCE)
        columns = [np.pad(x[some], ((0, _AT_ONCE - len(q[some])), (0, 0)), "edge").T for x in (q, p, dq, dp)]
        _, hessian, change = (x.full() for x in balance(*columns))
        hessians = hessian.reshape(n, _AT_ONCE, n).transpose(1, 0, 2)
        dq[some, a:] = -np.linalg.solve(hessians, change.T[..., None])[: len(q[some]), :, 0]
    return dq


@lru_cache(maxsize=8)
def _at_once(structure: Structure):
    return closed_loop(structure).whip_balance.map(_AT_ONCE)


def _balance(model: Model):
    from whiptool.impedance.controller import Controller

    controller = Controller()  # any: only the potential energy is used
    structure = Structure.of(model, controller)
    return closed_loop(structure).whip_balance, structure.pack(model, controller, np.zeros((1, 2 * model.arm.n + 1)))[0]
