"""Random strikes, the best few of them refined with the exact gradient of what they cost."""

from __future__ import annotations

import itertools

import nlopt
import numpy as np

from whiptool.limits import Smooth
from whiptool.models.strike import StrikeBounds
from whiptool.objective import Objective

BATCH = 64  # random strikes a round
REFINED = 8  # of them are refined
KEPT = 1e-9  # by which smooth functions may be beyond, for rounding
STEPS = 60  # gradient evaluations a refinement at most


def gradient_search(objective: Objective, *, seed: int) -> None:
    """Rounds of random strikes and refinement until the objective stops it.

    Half the squared cost is minimised by SLSQP inside the bounds: it is smooth where the miss distance itself has a
    kink, at zero. Every rollout is a trial, those of the refinement included; a trial with its gradient is one.

    Raises:
        SearchStopped: The objective ended the search.
    """
    rng = np.random.default_rng(seed)
    while True:
        strikes = objective.admissible(objective.bounds.sample(rng, BATCH))
        costs = [outcome.cost for outcome in objective.batch(strikes)]
        starts = (x for x in strikes[np.argsort(costs, kind="stable")] if _may_start(objective, x))
        for start in itertools.islice(starts, REFINED):
            if refine(objective, start):
                return


def _may_start(objective: Objective, strike: np.ndarray) -> bool:
    """Whether a strike keeps what can be kept beforehand."""
    return all((smooth.constraints(strike)[0] <= KEPT).all() for smooth in objective.smooth)


def _keep(optimizer: nlopt.opt, smooth: Smooth, bounds: StrikeBounds) -> None:
    """Add what can be kept beforehand to an optimizer over the unit box."""
    lower, upper = bounds.box
    count = len(smooth.constraints(lower)[0])
    if not count:
        return

    def beyond(result: np.ndarray, u: np.ndarray, gradient: np.ndarray) -> None:
        result[:], slopes = smooth.constraints(lower + u * (upper - lower))
        if gradient.size:
            gradient[:] = slopes * (upper - lower)

    optimizer.add_inequality_mconstraint(beyond, np.full(count, KEPT))


def refine(objective: Objective, start: np.ndarray, *, tolerance: float = 1e-6) -> bool:
    """Follow the gradient from one strike; whether the cost came below `tolerance` [m]."""
    lower, upper = objective.bounds.box
    scale = upper - lower
    optimizer = nlopt.opt(nlopt.LD_SLSQP, len(lower))
    optimizer.set_lower_bounds(np.zeros(len(lower)))
    optimizer.set_upper_bounds(np.ones(len(lower)))
    optimizer.set_maxeval(STEPS)
    optimizer.set_xtol_rel(1e-10)
    optimizer.set_stopval(tolerance**2 / 2)
    for smooth in objective.smooth:
        _keep(optimizer, smooth, objective.bounds)
    ended: list[BaseException] = []

    def half_square(u: np.ndarray, gradient: np.ndarray) -> float:
        try:
            outcome, slope = objective.gradient(lower + u * scale)
        except BaseException as error:
            ended.append(error)
            raise nlopt.ForcedStop from None
        if gradient.size:
            gradient[:] = outcome.cost * slope * scale
        return outcome.cost**2 / 2

    optimizer.set_min_objective(half_square)
    try:
        optimizer.optimize(np.clip((start - lower) / scale, 0, 1))
    except nlopt.ForcedStop:
        raise ended[0] from None
    except (nlopt.RoundoffLimited, RuntimeError):
        pass  # a kink: the next start will do
    if ended:
        raise ended[0]
    return optimizer.last_optimum_value() <= tolerance**2 / 2
