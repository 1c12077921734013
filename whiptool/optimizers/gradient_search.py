"""Searches along exact derivatives by SLSQP over the unit box of an objective, with smooth limits as constraints.

The cost is minimised from the best of random strikes, or from those that the model's strike map has for the target. A
criterion is minimised with the hit as a constraint.
"""

from __future__ import annotations

import contextlib
import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import islice
from typing import TYPE_CHECKING, NamedTuple

import nlopt
import numpy as np

from whiptool.errors import InputError
from whiptool.goals.criteria import Criterion, StrikesAtGoal, hit_excess, hit_excess_slopes
from whiptool.limits.clearance import Clearance
from whiptool.limits.limits import Smooth
from whiptool.objective import Objective

if TYPE_CHECKING:
    from whiptool.strike_map.strike_map import StrikeMap

KEPT = 1e-9  # by which smooth functions may be beyond, for rounding


def slsqp(objective: Objective, *, steps: int, further: int = 0) -> nlopt.opt:
    """Return an SLSQP optimizer over the unit box, which stands for the objective's bounds; it keeps the objective's
    smooth limits and evaluates at most `steps` gradients; `further` variables after those of the strike have no bounds.
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
    """Run an optimizer from `start` until it ends or fails, as at a kink, and raise the first error in `ended`, if any:
    the errors of the objective that ended it.
    """
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


STEPS = 60  # gradient evaluations of a descent at most, by default
_LEAST_SIZE = 1e-6  # of measures that are divided by their first size: a tip at rest has no speed
_INSIDE = 1e-6  # of a constraint's size, by which it is kept, so that rounding leaves a hit a hit


class Cap(NamedTuple):
    """A bound on a criterion, in addition to the hit."""

    criterion: Criterion
    value: float  # the worst value that is allowed, in its unit: the least speed, the largest of others


@dataclass(frozen=True, eq=False)
class HitPoint:
    """Measures (k,) of a criterion and constraints (c,) at a strike, and their derivatives by the m coordinates in the
    unit box, (k, m) and (c, m). Constraints are met if they are at most 0.
    """

    measures: np.ndarray
    measure_slopes: np.ndarray
    constraints: np.ndarray
    constraint_slopes: np.ndarray


class HitProblem:
    """Problem for NLopt: minimise the largest measure of a criterion, with a hit and the caps as constraints, over
    strikes whose coordinates are scaled to the unit box. Each new strike is a trial of the objective.
    """

    def __init__(self, objective: Objective, criterion: Criterion, caps: Sequence[Cap]) -> None:
        self.objective, self.criterion, self.caps = objective, criterion, caps
        self.lower, upper = objective.bounds.box
        self.scale = upper - self.lower
        self.size = 1.0
        self.ended: list[BaseException] = []
        self._at: np.ndarray | None = None
        self._point: HitPoint | None = None

    def __call__(self, u: np.ndarray) -> HitPoint:
        """Return the point at a strike; what ends a search is kept for later, as NLopt has to end first."""
        if self._at is None or not np.array_equal(u, self._at):
            try:
                outcome, struck = self.objective.struck(self.lower + u * self.scale)
                found = self._look(struck) if outcome.miss_distance < self.objective.penalty else self._lost()
            except BaseException as error:
                self.ended.append(error)
                raise nlopt.ForcedStop from None
            self._at, self._point = u.copy(), found
        assert self._point is not None
        return self._point

    def begin(self, start: np.ndarray) -> tuple[np.ndarray, HitPoint] | None:
        """Return the strike `start` (m,) in the unit box and its `HitPoint`, whose largest measure becomes the unit of
        all measures; None if it diverged or was refused.
        """
        u = np.clip((start - self.lower) / self.scale, 0, 1)
        try:
            found = self(u)
        except nlopt.ForcedStop:
            if isinstance(self.ended[0], _NoStart):
                return None
            raise self.ended[0] from None
        self.size = max(float(np.abs(found.measures).max()), _LEAST_SIZE)
        self._at = None if self.size == 1.0 else u.copy()
        self._point = HitPoint(
            found.measures / self.size, found.measure_slopes / self.size, found.constraints, found.constraint_slopes
        )
        return u, self._point

    def measure(self, u: np.ndarray, gradient: np.ndarray) -> float:
        """Return the criterion's only measure at `u`, (m,), and write its derivatives into `gradient`, for NLopt."""
        point = self(u)
        if gradient.size:
            gradient[:] = point.measure_slopes[0]
        return float(point.measures[0])

    def beyond(self, result: np.ndarray, x: np.ndarray, gradient: np.ndarray) -> None:
        """Write the constraints at `x` into `result`, and their derivatives into `gradient`, for NLopt.

        If `x` has a further variable, which has to bound all measures, their excesses over it are constraints as well.
        """
        n = len(self.lower)
        point, above = self(x[:n]), len(x) > n
        result[:] = np.r_[point.constraints, point.measures - x[n] if above else []]
        if gradient.size:
            gradient[:] = 0.0
            gradient[: len(point.constraints), :n] = point.constraint_slopes
            if above:
                gradient[len(point.constraints) :, :n] = point.measure_slopes
                gradient[len(point.constraints) :, n] = -1.0

    def _look(self, struck: StrikesAtGoal) -> HitPoint:
        constraints, slopes = [hit_excess(struck)[0] + _INSIDE], [hit_excess_slopes(struck)[0]]
        for criterion, value in self.caps:
            bound = criterion.measure_of(value)
            size = max(abs(bound), np.finfo(float).tiny)
            constraints.append((criterion.measures(struck)[0] - bound) / size + _INSIDE)
            slopes.append(criterion.measure_slopes(struck)[0] / size)
        measures, measure_slopes = self.criterion.measures(struck)[0], self.criterion.measure_slopes(struck)[0]
        if not all(np.isfinite(x).all() for x in (measures, measure_slopes, *constraints, *slopes)):
            return self._lost()  # a neighbouring strike diverged
        return HitPoint(
            measures / self.size,
            measure_slopes / self.size * self.scale,
            np.concatenate(constraints),
            np.concatenate(slopes) * self.scale,
        )

    def _lost(self) -> HitPoint:
        """Return a bad point: a line search turns back from it."""
        last = self._point
        if last is None:
            raise _NoStart
        return HitPoint(
            np.full_like(last.measures, np.abs(last.measures).max() + 1),
            np.zeros_like(last.measure_slopes),
            np.maximum(last.constraints, 0) + 1,
            np.zeros_like(last.constraint_slopes),
        )


class _NoStart(Exception):
    """The first strike diverged or was refused."""


def descend(
    objective: Objective,
    start: np.ndarray,
    criterion: Criterion,
    caps: Sequence[Cap] = (),
    *,
    steps: int = STEPS,
) -> None:
    """Follow exact derivatives from one strike (m,), which need not hit, to the best hit near it that keeps the caps.

    Every strike is a trial, so the objective keeps the result. If a criterion has several measures, an additional
    variable that bounds them all is minimised (epigraph form), because their maximum is not differentiable.
    """
    problem = HitProblem(objective, criterion, caps)
    begun = problem.begin(start)
    if begun is None:
        return
    u, first = begun
    several = len(first.measures) > 1
    optimizer = slsqp(objective, steps=steps, further=int(several))
    optimizer.set_xtol_rel(1e-6)
    optimizer.set_ftol_rel(1e-7)
    optimizer.set_min_objective(_bound if several else problem.measure)
    count = len(first.constraints) + several * len(first.measures)
    optimizer.add_inequality_mconstraint(problem.beyond, np.full(count, 1e-9))
    run_down(optimizer, np.r_[u, [first.measures.max()] * several], problem.ended)


def _bound(x: np.ndarray, gradient: np.ndarray) -> float:
    """The variable behind the strike's own, which bounds all measures."""
    if gradient.size:
        gradient[:] = np.r_[np.zeros(len(x) - 1), 1.0]
    return float(x[-1])


BATCH = 64  # random strikes a round
REFINED = 8  # of them, or of the candidates of a map, are refined
COLLISIONS = 5  # strikes that would collide after which a refinement is given up


def gradient_search(objective: Objective, *, seed: int) -> None:
    """Alternate random strikes and their refinement until the objective stops the search.

    Random strikes keep the limits that can be checked without simulation, and only collision-free strikes are refined.
    SLSQP minimises half the squared cost inside the bounds, because the miss distance itself is not differentiable at
    zero. Every simulation is a trial, also in the refinement; a simulation with its gradient counts once. If the
    objective has a criterion, it is minimised instead, with the hit as a constraint.
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
    """Minimise the cost from one strike (m,) along the gradient; return whether the cost is below `tolerance` [m]."""
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


def map_for(objective: Objective) -> StrikeMap:
    """Return the map that comes with the package for the model of an objective."""
    from whiptool.strike_map.map_files import map_of

    if objective.space.kind != "joint":
        raise InputError("space of strikes", objective.space.kind, "joint, for a strike map")
    return map_of(objective.rollout.model)


def map_search(objective: Objective, *, seed: int) -> None:
    """Try and refine the strikes that the package's map gives for the target; if none reaches it, or if the objective
    has criteria, continue with `gradient_search`.
    """
    strikes = map_for(objective).candidates(objective.goals).strikes
    lower, upper = objective.bounds.box
    inside = strikes[((lower <= strikes) & (strikes <= upper)).all(axis=1)]
    for strike in islice((x for x in objective.admissible(inside) if objective.clear(x)), REFINED):
        objective.trial(strike)
        if refine(objective, strike) and not objective.criteria:
            return
    gradient_search(objective, seed=seed)
