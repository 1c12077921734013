"""Pareto fronts by the epsilon-constraint method (Haimes, Lasdon and Wismer 1971) along exact derivatives.

A front contains the hits that are not dominated: no other hit is better in one criterion and not worse in the other.
"""

from __future__ import annotations

import csv
import io
import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import nlopt
import numpy as np
from scipy.stats import rankdata

from whiptool.goals.criteria import Criterion
from whiptool.objective import Objective, Trial
from whiptool.optimizers.gradient_search import Cap, HitPoint, HitProblem, descend

RESOLUTION = 1e-3  # part of a criterion's range over the front that counts as nothing


@dataclass(frozen=True, eq=False)
class ParetoFront:
    """Pareto front of hits, from the best by the first criterion to the best by the second.

    Args:
        criteria: The two criteria.
        trials: The P trials on the front.
    """

    criteria: tuple[Criterion, Criterion]
    trials: tuple[Trial, ...]

    @classmethod
    def of(cls, criteria: tuple[Criterion, Criterion], trials: Sequence[Trial]) -> ParetoFront:
        """Return the front of a search's trials; of equal hits it contains the first.

        A hit that improves one criterion by less than `RESOLUTION` times its range is left out.
        """
        hits = [trial for trial in trials if trial.outcome.hit and np.isfinite(trial.outcome.values).all()]
        costs = oriented(criteria, [trial.outcome.values for trial in hits])
        order = np.lexsort((costs[:, 1], costs[:, 0]))
        order = _gaining(order, costs[:, 1], 0.0)
        for column in (1, 0):
            step = RESOLUTION * np.ptp(costs[order, column]) if len(order) else 0.0
            order = _gaining(order, costs[:, column], step)[::-1]
        return cls(criteria, tuple(hits[i] for i in order))

    @property
    def values(self) -> np.ndarray:
        """The criteria of each hit in their units, (P, 2)."""
        return np.array([trial.outcome.values for trial in self.trials]).reshape(-1, 2)

    @property
    def strikes(self) -> np.ndarray:
        """Strike vectors of the P hits, with m coordinates each, (P, m)."""
        return np.array([trial.strike for trial in self.trials])

    @property
    def costs(self) -> np.ndarray:
        """The criteria, with signs such that less is better, divided by their range over the front, (P, 2)."""
        costs = oriented(self.criteria, self.values)
        span = np.ptp(costs, axis=0) if len(costs) else np.ones(2)
        return costs / np.where(span > 0, span, 1.0)

    def table(self, names: Sequence[str]) -> dict[str, Any]:
        """Return the front as plain data for JSON, with the names of a strike's m coordinates."""
        criteria = [{"name": x.name, "unit": x.unit, "maximised": x.largest} for x in self.criteria]
        hits = [
            {
                "trial": trial.number,
                **dict(zip((x.name for x in self.criteria), trial.outcome.values, strict=True)),
                "miss_distance": trial.outcome.miss_distance,
                "tip_speed": trial.outcome.tip_speed,
                "strike": dict(zip(names, trial.strike, strict=True)),
            }
            for trial in self.trials
        ]
        return {"criteria": criteria, "front": hits}

    def csv(self, names: Sequence[str]) -> str:
        """Return the front as CSV: number of the trial, both criteria, and the strike under the names of its m
        coordinates.
        """
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(["trial", *(x.name for x in self.criteria), *names])
        for trial in self.trials:
            writer.writerow([trial.number, *map(repr, trial.outcome.values), *map(repr, trial.strike)])
        return text.getvalue()


def dominated_by(criteria: Sequence[Criterion], front: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return by how much each of Q other hits, with values (Q, 2), dominates a front (P, 2), relative to the front's
    range, (Q,).

    This is the additive epsilon indicator (Zitzler et al. 2003): the shift of the front in both criteria that would
    make it at least as good as that hit. If it is at most 0, the hit dominates no point of the front.
    """
    costs = oriented(criteria, front)
    span = np.where(np.ptp(costs, axis=0) > 0, np.ptp(costs, axis=0), 1.0)
    behind = (costs[None] - oriented(criteria, values)[:, None]) / span  # (Q, P, 2)
    return behind.max(axis=2).min(axis=1)


def _gaining(order: Sequence[int] | np.ndarray, costs: np.ndarray, step: float) -> list[int]:
    """Return those of some hits, in their order, that cost less than all before them, by more than a step."""
    kept: list[int] = []
    for i in order:
        if not kept or costs[i] < costs[kept[-1]] - step:
            kept.append(int(i))
    return kept


def oriented(criteria: Sequence[Criterion], values: np.ndarray | Sequence[Sequence[float]]) -> np.ndarray:
    """Return the values (B, k) of k criteria with signs such that less is better."""
    signs = [-1.0 if criterion.largest else 1.0 for criterion in criteria]
    return np.asarray(values, float).reshape(-1, len(signs)) * signs


FIRST = 0.05  # size of the first step in each number, in parts of the bounds
LONGEST, SHORTEST = 0.5, 1e-3  # of steps; a descent whose steps become shorter ends
GROWS, SHRINKS = 2.0, 1 / 3  # steps, after one that was better and one that was not
INSIDE = 0.3  # part of the squared hit radius by which linear programs stay inside, for what they do not see


def step_down(objective: Objective, start: np.ndarray, criterion: Criterion, *, steps: int) -> None:
    """Follow exact derivatives from one strike (m,), which need not hit, to a good hit near it, with steps limited by a
    trust region.

    Each step minimises the sum of the linearised criterion and a penalty for the violated hit constraints within a box
    around the strike (Fletcher and Sainz de la Maza 1989); a step that does not reduce the sum is undone. For arms with
    many joints, whose outcomes are strongly nonlinear, it finds hits where `descend` jumps between local minima; near
    the best hit `descend` is more exact. Every strike is a trial of the objective.
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


BATCH = 64  # random strikes from which a front begins
FAR = 100  # steps of the descents in long steps from random strikes, at most
STEPS = 40  # of all other descents at most
SHARE = 0.6  # of all trials after which the first end is sought no further
KEPT = 3  # best hits near which descents begin again
SAME = 1e-3  # part of a criterion by which hits differ that are as good as each other
NEARBY = 0.03  # standard deviation of that in each number, in parts of the bounds
END = 0.01  # part of a criterion's range within which hits are as good as the best by it
FRESH = 16  # random strikes of which one is a new start


def pareto_search(objective: Objective, *, seed: int) -> None:
    """Find the Pareto front of an objective's two criteria until the objective stops the search.

    First the two ends of the front are found, i.e. for each criterion its best hits and among equals the best by the
    other (payoff table of Mavrotas 2009): for the first criterion by an iterated local search (Lourenço, Martin and
    Stützle 2003) from good random strikes near the target, for the second starting from that result. Then the widest
    gap of the front is filled repeatedly: one criterion is bounded at the gap's middle and the other minimised,
    starting in turn from either end of the gap and from a new random strike. The width of a gap that was tried is
    halved.
    """
    first, second = objective.criteria
    rng = np.random.default_rng(seed)
    strikes = objective.admissible(objective.bounds.sample(rng, BATCH))
    outcomes = objective.batch(strikes)
    worth = [-np.inf if not x.values else x.values[0] * (1 if first.largest else -1) for x in outcomes]
    placed = rankdata([x.cost for x in outcomes]) + rankdata(-np.array(worth))
    _search_locally(objective, strikes[np.argsort(placed, kind="stable")], rng)
    while not (hits := [trial for trial in objective.trials if trial.outcome.hit]):
        descend(objective, _fresh(objective, rng), first)
    costs = oriented(objective.criteria, [trial.outcome.values for trial in hits])
    best = np.array(hits[int(costs[:, 0].argmin())].strike)
    descend(objective, best, first)
    descend(objective, best, second)
    front = _front_with_gaps(objective, rng)
    _improve_ends(objective, front)
    tried: Counter[tuple[int, int]] = Counter()
    while True:
        _fill(objective, _front_with_gaps(objective, rng), tried, rng)


def _search_locally(objective: Objective, strikes: np.ndarray, rng: np.random.Generator) -> None:
    """Look for the best hit by the first criterion, beginning from the first of some strikes (B, m).

    In many numbers there are many valleys: descents in short steps stay in theirs, those in long steps may leave it.
    Both begin at random strikes, and then near the best ends of those before.
    """
    m = strikes.shape[1]
    most = math.inf if objective.max_trials is None else SHARE * objective.max_trials
    begun = [(strike, FAR) for strike in strikes[:KEPT]] + [(strike, None) for strike in strikes[: (m + 1) // 2]]
    ends = list[Trial]()
    for strike, long in begun:
        if not ends or len(objective.trials) <= most:
            ends.append(_end(objective, strike, long=long))
    for turn in range(2 * m):
        ends.sort(key=lambda trial: trial.outcome.cost)
        if len(objective.trials) > most or _agree(ends[:KEPT]):
            return
        k = turn % KEPT
        nearby = _nearby(objective, np.array(ends[k].strike), rng)
        end = _end(objective, nearby, long=STEPS if turn // KEPT % 2 else None)
        ends[k] = min(ends[k], end, key=lambda trial: trial.outcome.cost)


def _agree(ends: Sequence[Trial]) -> bool:
    """Return whether all ends are hits that are as good as each other: no better one is to be expected."""
    if not all(trial.outcome.hit for trial in ends):
        return False
    values = np.array([trial.outcome.values[0] for trial in ends])
    return bool(np.ptp(values) <= SAME * np.abs(values).max())


def _end(objective: Objective, strike: np.ndarray, *, long: int | None = None) -> Trial:
    """Return the best trial of a descent by the first criterion: in so many long steps, or in short ones."""
    before = len(objective.trials)
    if long:
        descend(objective, strike, objective.criteria[0], steps=long)
    else:
        step_down(objective, strike, objective.criteria[0], steps=STEPS)
    return min(objective.trials[before:], key=lambda trial: trial.outcome.cost)


def _nearby(objective: Objective, strike: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return a random strike near one."""
    lower, upper = objective.bounds.box
    nearby = strike + NEARBY * (upper - lower) * rng.normal(size=len(strike))
    return objective.admissible(np.clip(nearby, lower, upper)[None])[0]


def _front_with_gaps(objective: Objective, rng: np.random.Generator) -> ParetoFront:
    """Return the front; while it is one hit, which is the best by both criteria, descend near it."""
    first, second = objective.criteria
    while len((front := ParetoFront.of((first, second), objective.trials)).trials) < 2:
        descend(objective, _nearby(objective, front.strikes[0], rng), second)
        descend(objective, _fresh(objective, rng), first)
    return front


def _improve_ends(objective: Objective, front: ParetoFront) -> None:
    """Improve the best hits by each criterion by the other one."""
    spans = np.ptp(front.values, axis=0)
    for end, held in ((0, 0), (-1, 1)):
        criterion = front.criteria[held]
        slack = END * spans[held] * (-1 if criterion.largest else 1)
        cap = Cap(criterion, float(front.values[end, held] + slack))
        descend(objective, front.strikes[end], front.criteria[1 - held], [cap])


def _fresh(objective: Objective, rng: np.random.Generator) -> np.ndarray:
    """Return the best of some random strikes."""
    strikes = objective.admissible(objective.bounds.sample(rng, FRESH))
    return strikes[int(np.argmin([outcome.cost for outcome in objective.batch(strikes)]))]


def _fill(objective: Objective, front: ParetoFront, tried: Counter[tuple[int, int]], rng: np.random.Generator) -> None:
    """Descend into the widest gap of a front."""
    steps = np.abs(np.diff(front.costs, axis=0))
    gaps = [(a.number, b.number) for a, b in zip(front.trials, front.trials[1:])]
    widths = steps.max(axis=1) * 0.5 ** np.array([tried[gap] for gap in gaps])
    k = int(widths.argmax())
    held = int(steps[k].argmax())
    ends = front.values[k : k + 2]
    starts = front.strikes[k : k + 2]
    turn = tried[gaps[k]] % 3
    tried[gaps[k]] += 1
    start = _fresh(objective, rng) if turn == 2 else starts[(held + turn) % 2]
    cap = Cap(front.criteria[held], float(ends[:, held].mean()))
    descend(objective, start, front.criteria[1 - held], [cap])
