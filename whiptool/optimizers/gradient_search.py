"""Random strikes, the best few of them refined with the exact gradient of what they cost."""

from __future__ import annotations

import itertools

import nlopt
import numpy as np

from whiptool.limits.clearance import Clearance
from whiptool.objective import Objective
from whiptool.optimizers.constrained import descend
from whiptool.optimizers.slsqp import run_down, slsqp

BATCH = 64  # random strikes a round
REFINED = 8  # of them are refined
STEPS = 60  # gradient evaluations a refinement at most
COLLISIONS = 5  # strikes that would collide after which a refinement is given up


def gradient_search(objective: Objective, *, seed: int) -> None:
    """Alternate random strikes and their refinement until the objective stops the search.

    Random strikes keep the limits that can be checked without simulation, and only collision-free strikes are refined.
    SLSQP minimises half the squared cost inside the bounds, because the miss distance itself is not differentiable at
    zero. Every simulation is a trial, also in the refinement; a simulation with its gradient counts once. If the
    objective has a criterion, it is minimised instead, with the hit as a constraint.

    Raises:
        SearchStopped: The objective ended the search.
    """
    rng = np.random.default_rng(seed)
    while True:
        strikes = objective.random_strikes(rng, BATCH)
        costs = [outcome.cost for outcome in objective.batch(strikes)]
        starts = (x for x in strikes[np.argsort(costs, kind="stable")] if objective.clear(x))
        for start in itertools.islice(starts, REFINED):
            if objective.criteria:
                descend(objective, start, objective.criteria[0])
            elif refine(objective, start):
                return


def refine(objective: Objective, start: np.ndarray, *, tolerance: float = 1e-6) -> bool:
    """Minimise the cost from one strike (m,) along the gradient; return whether it came below `tolerance` [m]."""
    lower, upper = objective.bounds.box
    scale = upper - lower
    optimizer = slsqp(objective, steps=STEPS)
    optimizer.set_xtol_rel(1e-10)
    optimizer.set_stopval(tolerance**2 / 2)
    ended: list[BaseException] = []
    collisions = itertools.count(1)

    def half_square(u: np.ndarray, gradient: np.ndarray) -> float:
        try:
            outcome, slope = objective.gradient(lower + u * scale)
        except BaseException as error:
            ended.append(error)
            raise nlopt.ForcedStop from None
        if outcome.refused == Clearance.judges and next(collisions) >= COLLISIONS:
            raise nlopt.ForcedStop
        if gradient.size:
            gradient[:] = outcome.cost * slope * scale
        return outcome.cost**2 / 2

    optimizer.set_min_objective(half_square)
    run_down(optimizer, np.clip((start - lower) / scale, 0, 1), ended)
    return optimizer.last_optimum_value() <= tolerance**2 / 2
