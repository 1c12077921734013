"""A good hit near a strike in short steps: sequential linear programming along exact derivatives."""

from __future__ import annotations

import nlopt
import numpy as np

from whiptool.goals.criteria import Criterion
from whiptool.objective import Objective
from whiptool.optimizers.constrained import HitPoint, HitProblem

FIRST = 0.05  # size of the first step in each number, in parts of the bounds
LONGEST, SHORTEST = 0.5, 1e-3  # of steps; a descent whose steps become shorter ends
GROWS, SHRINKS = 2.0, 1 / 3  # steps, after one that was better and one that was not
INSIDE = 0.3  # part of the squared hit radius by which linear programs stay inside, for what they do not see


def step_down(objective: Objective, start: np.ndarray, criterion: Criterion, *, steps: int) -> None:
    """Follow exact derivatives from one strike to a good hit near it, with steps limited by a trust region.

    Each step minimises the sum of the linearised criterion and a penalty for the violated hit constraints within a box
    around the strike (Fletcher and Sainz de la Maza 1989); a step that does not reduce the sum is undone. For arms with
    many joints, whose outcomes are strongly nonlinear, it finds hits where `descend` jumps between local minima; near
    the best hit `descend` is more exact.

    Args:
        objective: Objective with the target; every strike is a trial.
        start: Strike vector, (m,); it need not be a hit.
        criterion: Criterion to minimise.
        steps: Largest number of steps.

    Raises:
        SearchStopped: The objective ended the search.
        InputError: The simulator has no derivatives.
    """
    problem = HitProblem(objective, criterion, ())
    begun = problem.begin(start)
    if begun is None:
        return
    try:
        _descend(problem, *begun, steps)
    except nlopt.ForcedStop:
        raise problem.ended[0] from None


def _descend(problem: HitProblem, u: np.ndarray, point: HitPoint, steps: int) -> None:
    size = FIRST
    for _ in range(steps):
        other = np.clip(u + _step(problem, u, point, size), 0, 1)
        found = problem(other)
        if _left(found) < _left(point):
            u, point, size = other, found, min(size * GROWS, LONGEST)
        else:
            size *= SHRINKS
        if size < SHORTEST:
            return


def _left(point: HitPoint) -> float:
    """Return what is minimised: the largest measure and by how much the constraints are broken."""
    return float(point.measures.max() + np.maximum(point.constraints, 0).sum())


def _step(problem: HitProblem, u: np.ndarray, point: HitPoint, size: float) -> np.ndarray:
    """Return the step of the linear program, (m,): other variables are the largest measure and the excesses."""
    from scipy.optimize import linprog

    m, k, c = len(u), len(point.measures), len(point.constraints)
    rows = [np.hstack([point.measure_slopes, -np.ones((k, 1)), np.zeros((k, c))])]
    rows.append(np.hstack([point.constraint_slopes, np.zeros((c, 1)), -np.eye(c)]))
    ends = [-point.measures, -point.constraints - INSIDE]
    for smooth in problem.objective.smooth:
        beyond, slopes = smooth.constraints(problem.lower + u * problem.scale)
        rows.append(np.hstack([slopes * problem.scale, np.zeros((len(beyond), 1 + c))]))
        ends.append(np.maximum(-beyond, 0))
    box = [*zip(np.maximum(-size, -u), np.minimum(size, 1 - u)), (None, None), *[(0, None)] * c]
    costs = np.r_[np.zeros(m), 1.0, np.ones(c)]
    found = linprog(costs, A_ub=np.vstack(rows), b_ub=np.concatenate(ends), bounds=box)
    return np.zeros(m) if found.x is None else found.x[:m]
