"""The best hit near a strike: sequential quadratic programming along exact derivatives, a hit being a constraint."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import nlopt
import numpy as np

from whiptool.goals.criteria import Criterion, StrikesAtGoal, hit_excess, hit_excess_slopes
from whiptool.objective import Objective
from whiptool.optimizers.smooth_limits import keep_limits

STEPS = 60  # gradient evaluations at most, by default
_LEAST_SIZE = 1e-6  # of measures that are divided by their first size: a tip at rest has no speed
_INSIDE = 1e-6  # of a constraint's size, by which it is kept, so that rounding leaves a hit a hit


class Cap(NamedTuple):
    """A criterion that has to be at least as good as a value."""

    criterion: Criterion
    value: float


@dataclass(frozen=True, eq=False)
class HitPoint:
    """Measures (k,) and constraints (c,) at a strike, at most 0 where kept, and their slopes in the unit box."""

    measures: np.ndarray
    measure_slopes: np.ndarray
    constraints: np.ndarray
    constraint_slopes: np.ndarray


class HitProblem:
    """Measures and constraints of strikes in the unit box; one trial for each new strike.

    Args:
        objective: Counts the trials.
        criterion: Criterion whose largest measure is minimised.
        caps: Further constraints besides the hit.
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

    def begin(self, u: np.ndarray) -> HitPoint:
        """Return the first point, whose measure becomes the unit of measures."""
        found = self(u)
        self.size = max(float(np.abs(found.measures).max()), _LEAST_SIZE)
        self._at = None if self.size == 1.0 else u.copy()
        self._point = HitPoint(
            found.measures / self.size, found.measure_slopes / self.size, found.constraints, found.constraint_slopes
        )
        return self._point

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
            raise NoStart
        return HitPoint(
            np.full_like(last.measures, np.abs(last.measures).max() + 1),
            np.zeros_like(last.measure_slopes),
            np.maximum(last.constraints, 0) + 1,
            np.zeros_like(last.constraint_slopes),
        )


class NoStart(Exception):
    """The first strike is lost."""


def descend(
    objective: Objective,
    start: np.ndarray,
    criterion: Criterion,
    caps: Sequence[Cap] = (),
    *,
    steps: int = STEPS,
) -> None:
    """Follow exact derivatives from one strike to the best hit near it.

    Every strike is a trial, so that the objective holds what was found. Where a criterion has several measures, an
    additional variable bounds them all and is minimised (the epigraph form): their maximum has a kink where two meet.

    Args:
        objective: Objective with the target.
        start: Strike vector, (m,); it need not be a hit.
        criterion: Criterion to minimise.
        caps: Further constraints besides the hit.
        steps: Gradient evaluations at most.

    Raises:
        SearchStopped: The objective ended the search.
        InputError: The simulator has no derivatives.
    """
    problem = HitProblem(objective, criterion, caps)
    u = np.clip((start - problem.lower) / problem.scale, 0, 1)
    try:
        first = problem.begin(u)
    except nlopt.ForcedStop:
        if isinstance(problem.ended[0], NoStart):
            return
        raise problem.ended[0] from None
    several, n = len(first.measures) > 1, len(u)
    optimizer = nlopt.opt(nlopt.LD_SLSQP, n + several)
    optimizer.set_lower_bounds(np.r_[np.zeros(n), [-np.inf] * several])
    optimizer.set_upper_bounds(np.r_[np.ones(n), [np.inf] * several])
    optimizer.set_maxeval(steps)
    optimizer.set_xtol_rel(1e-6)
    optimizer.set_ftol_rel(1e-7)
    keep_limits(optimizer, objective)

    def largest(x: np.ndarray, gradient: np.ndarray) -> float:
        if several:
            gradient[:] = np.r_[np.zeros(n), 1.0] if gradient.size else gradient
            return float(x[n])
        point = problem(x)
        if gradient.size:
            gradient[:] = point.measure_slopes[0]
        return float(point.measures[0])

    def kept(result: np.ndarray, x: np.ndarray, gradient: np.ndarray) -> None:
        point = problem(x[:n])
        above = point.measures - x[n] if several else np.empty(0)
        result[:] = np.r_[point.constraints, above]
        if gradient.size:
            gradient[:] = 0.0
            gradient[: len(point.constraints), :n] = point.constraint_slopes
            if several:
                gradient[len(point.constraints) :, :n] = point.measure_slopes
                gradient[len(point.constraints) :, n] = -1.0

    optimizer.set_min_objective(largest)
    count = len(first.constraints) + several * len(first.measures)
    optimizer.add_inequality_mconstraint(kept, np.full(count, 1e-9))
    try:
        optimizer.optimize(np.r_[u, [first.measures.max()] * several])
    except nlopt.ForcedStop:
        raise problem.ended[0] from None
    except (nlopt.RoundoffLimited, nlopt.runtime_error, RuntimeError):
        pass  # a kink: what was found until there is kept
    if problem.ended:
        raise problem.ended[0]
