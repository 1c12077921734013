"""SLSQP over the unit box of an objective, with what limits let a search keep beforehand as constraints."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence

import nlopt
import numpy as np

from whiptool.limits.all_limits import Smooth
from whiptool.objective import Objective

KEPT = 1e-9  # by which smooth functions may be beyond, for rounding


def slsqp(objective: Objective, *, steps: int, further: int = 0) -> nlopt.opt:
    """Return an optimizer over the unit box.

    Args:
        objective: Objective whose bounds are the box, and whose smooth limits are kept.
        steps: Gradient evaluations at most.
        further: Number of further variables after those of the strike; they have no bounds.
    """
    lower, upper = objective.bounds.box
    optimizer = nlopt.opt(nlopt.LD_SLSQP, len(lower) + further)
    optimizer.set_lower_bounds(np.r_[np.zeros(len(lower)), [-np.inf] * further])
    optimizer.set_upper_bounds(np.r_[np.ones(len(lower)), [np.inf] * further])
    optimizer.set_maxeval(steps)
    for smooth in objective.smooth:
        _keep(optimizer, smooth, lower, upper)
    return optimizer


def run_down(optimizer: nlopt.opt, start: np.ndarray, ended: Sequence[BaseException]) -> None:
    """Run an optimizer to its end, be it a kink, and raise the first of the errors that an objective ended it with."""
    # it was given up, the search ended, or there is a kink: what was found until there is kept
    with contextlib.suppress(nlopt.ForcedStop, nlopt.RoundoffLimited, nlopt.runtime_error, RuntimeError):
        optimizer.optimize(start)
    if ended:
        raise ended[0]


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
