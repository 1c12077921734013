"""Pareto fronts by the epsilon-constraint method (Haimes, Lasdon and Wismer 1971) along exact derivatives."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence

import numpy as np
from scipy.stats import rankdata

from whiptool.objective import Objective, Trial
from whiptool.optimizers.constrained import Cap, descend
from whiptool.optimizers.front import ParetoFront, oriented
from whiptool.optimizers.linear_steps import step_down

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
    """Find the Pareto front of an objective's two criteria until the objective stops it.

    First the two ends of the front are found, i.e. for each criterion its best hits and among equals the best by the
    other (payoff table of Mavrotas 2009): for the first criterion by an iterated local search (Lourenço, Martin and
    Stützle 2003) from good random strikes near the target, for the second starting from that result. Then the widest
    gap of the front is filled repeatedly: one criterion is bounded at the gap's middle and the other minimised,
    starting in turn from either end of the gap and from a new random strike. The width of a gap that was tried is
    halved.

    Raises:
        SearchStopped: The objective ended the search.
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
