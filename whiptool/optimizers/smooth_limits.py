"""What limits let a search keep beforehand, as constraints of an optimizer."""

from __future__ import annotations

import nlopt
import numpy as np

from whiptool.limits.all_limits import Smooth
from whiptool.objective import Objective

KEPT = 1e-9  # by which smooth functions may be beyond, for rounding


def keep_limits(optimizer: nlopt.opt, objective: Objective) -> None:
    """Add what can be kept beforehand to an optimizer over the unit box.

    Variables behind the strike's own do not count.
    """
    for smooth in objective.smooth:
        _keep(optimizer, smooth, *objective.bounds.box)


def _keep(optimizer: nlopt.opt, smooth: Smooth, lower: np.ndarray, upper: np.ndarray) -> None:
    count, m = len(smooth.constraints(lower)[0]), len(lower)
    if not count:
        return

    def beyond(result: np.ndarray, u: np.ndarray, gradient: np.ndarray) -> None:
        result[:], slopes = smooth.constraints(lower + u[:m] * (upper - lower))
        if gradient.size:
            gradient[:] = 0.0
            gradient[:, :m] = slopes * (upper - lower)

    optimizer.add_inequality_mconstraint(beyond, np.full(count, KEPT))
