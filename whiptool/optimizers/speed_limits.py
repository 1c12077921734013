"""The limits of commanded speeds as constraints of an optimizer."""

from __future__ import annotations

import nlopt
import numpy as np

from whiptool.models.strike import FASTEST
from whiptool.objective import Objective


def keep_speeds(optimizer: nlopt.opt, objective: Objective) -> None:
    """Add the limits of the commanded speeds, linear in a strike, of an optimizer over the unit box.

    Variables behind the strike's own do not count.
    """
    speeds = objective.speeds
    if speeds is None or not np.isfinite(speeds).any():
        return
    lower, upper = objective.bounds.box
    a, moving = len(speeds), np.flatnonzero(np.isfinite(speeds))
    rows = np.zeros((2, len(moving), len(lower)))  # sign (q_f - q_i) 15/8 - speed D <= 0
    for rows_of_sign, sign in zip(rows, (1, -1), strict=True):
        for row, j in zip(rows_of_sign, moving, strict=True):
            row[[j, a + j, -1]] = -sign * FASTEST, sign * FASTEST, -speeds[j]
    A, b = rows.reshape(-1, len(lower)) * (upper - lower), rows.reshape(-1, len(lower)) @ lower

    def beyond(result: np.ndarray, u: np.ndarray, gradient: np.ndarray) -> None:
        result[:] = A @ u[: len(lower)] + b
        if gradient.size:
            gradient[:] = 0.0
            gradient[:, : len(lower)] = A

    optimizer.add_inequality_mconstraint(beyond, np.full(len(A), 1e-9))
