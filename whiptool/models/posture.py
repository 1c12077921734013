"""How a strike starts: the arm at q_i, the whip at rest below the hand."""

from __future__ import annotations

import numpy as np

from whiptool.impedance.controller import Controller
from whiptool.models.closed_loop import Structure, closed_loop
from whiptool.models.parameters import Model


def start_posture(model: Model, q_i: np.ndarray) -> np.ndarray:
    """Joint positions at the start [rad], shape (B, n), for arm postures q_i of shape (B, a).

    The whip hangs straight down. One with rest angles, or with a spring at its hinge, does not hang straight: it
    starts where weight and springs balance, found by Newton's method from straight down.
    """
    a, n = model.arm.n, model.n
    q = np.zeros((len(q_i), n))
    q[:, :a] = q_i
    q[:, a] = -q_i.sum(axis=1)
    if model.whip.per_node("k")[0] == 0 and not model.whip.per_node("rest_angle").any():
        return q
    controller = Controller()  # any: only the potential energy is used
    structure = Structure.of(model, controller)
    balance = closed_loop(structure).whip_balance
    p = structure.pack(model, controller, np.zeros((1, 2 * a + 1)))[0]
    for row in q:
        for _ in range(100):
            gradient, hessian = (x.full() for x in balance(row, p))
            # a negative curvature would lead uphill: damp until the Hessian is positive
            shift = max(0.0, 1e-9 - np.linalg.eigvalsh(hessian)[0])
            step = np.linalg.solve(hessian + shift * np.eye(n - a), gradient[:, 0])
            largest = np.abs(step).max()
            row[a:] -= step if largest < 0.5 else step * (0.5 / largest)
            if largest < 1e-12:
                break
    return q
