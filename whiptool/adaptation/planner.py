"""Plan the strike with the largest probability of a hit, over whips sampled from the belief.

Candidates for a planar arm are random strikes that are refined along derivatives and within the motors' limits;
`whiptool.adaptation.aimed_search` finds those in space.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from whiptool.adaptation.aimed_search import AimedSearch
from whiptool.adaptation.plan_search import Demands, Plan, PlanningEffort, Search
from whiptool.adaptation.prior import Belief
from whiptool.goals.target import Target
from whiptool.limits.arm_limits import ArmLimits, MotorLimits
from whiptool.models.trajectory import Approach

MARGINS = (0.1, 0.2, 0.3, 0.4)  # part of the limits that is kept free; more, where all strikes were refused
CHECKED = 3  # strikes that are asked about before more is kept free
# Strikes are brought within limits by random steps that shrink, for derivatives do not see the limits.
_ROUNDS, _CHILDREN, _KEPT = 12, 64, 8  # of steps; strikes that are tried in each; the best of all that are kept
_SHRINK = 0.8  # of the steps from round to round
_NEAR, _LAST_STEPS = 0.015, 3  # [m] of miss on the mean that so many steps along derivatives mend: no more random ones


class PlanarSearch(Search):
    """Search in the plane: the best of random strikes, past strikes and their neighbours are refined along derivatives.

    If limits or a least speed allow only a small part of the bounds, random steps find that part. If limits of whole
    trajectories or `check` forbid the best three strikes, the search is repeated with a larger margin to the limits,
    from 10 to 40 %.
    """

    margins, checked, spread = MARGINS, CHECKED, 0.04

    def candidates(
        self, rng: np.random.Generator, past: Sequence[Sequence[float]], effort: PlanningEffort
    ) -> tuple[np.ndarray, int]:
        """Return refined random and past strikes, and the number of candidates; see `Search.candidates`."""
        lower, upper = self.striker.bounds.box
        pool = self.striker.admissible(rng.uniform(lower, upper, (effort.pool, len(lower))))
        if len(past):
            known = np.array(past, float)
            around = np.repeat(known, 8, axis=0)
            around = around + 0.05 * (upper - lower) * rng.standard_normal(around.shape)
            pool = np.vstack([self.striker.admissible(np.vstack([known, around])), pool])
        best = pool[np.argsort(self.rank(self.mean(pool)))[: effort.polished]]
        tried = np.vstack([best, self.polish(best, effort.steps)])
        if self.striker.limits or self.goal.speed is not None:  # what is allowed is a thin part of the box
            squeezed = self.squeeze(tried, rng)
            tried = np.vstack([squeezed, self.polish(squeezed, _LAST_STEPS)])
        return tried, len(pool)

    def spare(self, rng: np.random.Generator, effort: PlanningEffort) -> np.ndarray:
        """Return the best of random strikes, those within the limits first; see `Search.spare`."""
        strikes = self.striker.admissible(rng.uniform(*self.striker.bounds.box, (effort.pool, len(self.striker.lower))))
        near = self.mean(strikes)
        beyond = self.striker.limits.violation_of_peaks(near) > 0
        return strikes[np.lexsort((np.where(near.known, near.distance, np.inf), beyond))[: effort.polished]]

    def beyond(self, strikes: np.ndarray) -> np.ndarray:
        """Return the `excess` of strikes (B, m) over the limits with the belief's mean, (B,); see `Search.beyond`."""
        if not self.striker.limits and self.goal.speed is None:
            return np.zeros(len(strikes))
        return self.excess(self.mean(strikes))

    def usage(self, near: Approach) -> float | None:
        """Return the usage of the motors' or joints' limits by one strike; None without any. See `Search.usage`."""
        of_motors = any(isinstance(limits, MotorLimits | ArmLimits) for limits in self.striker.limits.members)
        return float(self.striker.limits.violation_of_peaks(near)[0]) + 1 if of_motors else None

    def excess(self, near: Approach) -> np.ndarray:
        """Return by how much strikes, whose closest approaches are `near`, exceed the limits less the margin, plus
        their relative lack of speed at the goal, (B,); 0 if limits and least speed are kept."""
        excess = np.zeros(len(near.distance))
        if self.goal.speed is not None:
            arrival = self.goal.arrival_speed(near.velocity)
            excess = np.clip(np.nan_to_num(1 - arrival / self.goal.speed, nan=1.0), 0.0, 1.0)
        return excess + np.clip(self.striker.limits.violation_of_peaks(near) + self.margin, 0.0, 10.0)

    def rank(self, near: Approach) -> np.ndarray:
        """Return the miss distances (B,) [m] of strikes, whose closest approaches are `near`; 10 or more is added for a
        strike that breaks the motors' limits or is too slow."""
        excess = self.excess(near)
        distance = np.where(near.known, near.distance, 1e3)
        return distance + np.where(excess > 0, 10 + excess, 0)

    def polish(self, strikes: np.ndarray, steps: int) -> np.ndarray:
        """Return strikes (B, m) after Gauss-Newton steps that reduce the miss with the belief's mean, each at its best
        step.
        """
        width, x, best, value = self.striker.widths, strikes.copy(), strikes.copy(), np.full(len(strikes), np.inf)
        for step in range(steps + 1):
            near, slope = self.striker.rollout.gradient(x, self.goal.positions[0], t_stay=self.striker.t_stay)
            rank = self.rank(near)
            better = rank < value
            best[better], value[better] = x[better], rank[better]
            if step == steps:
                break
            g = slope * width  # by the numbers in units of their range
            move = -near.distance[:, None] * g / np.maximum((g**2).sum(axis=1, keepdims=True), 1e-6)
            length = np.linalg.norm(move, axis=1, keepdims=True)
            move = np.nan_to_num(move * np.minimum(1.0, 0.1 / np.maximum(length, 1e-9)))
            x = self.striker.admissible(x + move * width)
        return best

    def squeeze(self, strikes: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """Return the best ranked strikes after random, ever smaller steps from strikes (B, m), because limits have no
        derivatives.
        """
        kept, rank, spread = strikes, self.rank(self.mean(strikes)), 0.1
        for _ in range(_ROUNDS):
            if np.sort(rank)[: _KEPT // 2].max() <= _NEAR:
                break
            parents = kept[rng.integers(len(kept), size=_CHILDREN)]
            children = parents + spread * self.striker.widths * rng.standard_normal(parents.shape)
            children = self.striker.admissible(children)
            kept, rank = np.vstack([kept, children]), np.r_[rank, self.rank(self.mean(children))]
            order = np.argsort(rank)[:_KEPT]
            kept, rank, spread = kept[order], rank[order], spread * _SHRINK
        return kept[np.argsort(rank)[:_KEPT]]


JUDGED = 64  # whips over which the probability is stated
UNSURE = 0.5  # probability of a hit of an allowed strike, below which one is looked for again

# There is time before the first strike; in space limits and directions leave little of the box of strikes.
FIRST = PlanningEffort(pool=256, polished=16, whips=32, population=12, rounds=6)
NEXT = PlanningEffort()
FIRST_IN_SPACE = PlanningEffort(pool=2048, polished=32, steps=20, population=12)
NEXT_IN_SPACE = PlanningEffort(pool=512, steps=20)
RETRIES_IN_SPACE = 1  # with the first effort, while the hit probability is below 50 %


def plan(
    belief: Belief,
    target: Target,
    *,
    rng: np.random.Generator,
    past: Sequence[Sequence[float]] = (),
    demands: Demands | None = None,
    effort: PlanningEffort = NEXT,
    retries: Sequence[PlanningEffort] = (),
    enough: float = UNSURE,
    sag: Callable[[np.ndarray], np.ndarray] | None = None,
) -> Plan:
    """Return the strike with the largest probability of a hit over whips sampled from a belief.

    Candidates are found with the belief's mean, see `PlanarSearch` and, in space, `AimedSearch`; `past` strikes are
    candidates, too. They are simulated with every sampled whip, and a search with a shrinking normal distribution
    refines the best (`CrossEntropy`). The miss with each sample is smoothed by the belief's model error
    (`ModelError.hit_probability`), in the search by at least 5 mm. If limits or `check` forbid all of them, the best of
    random strikes that may be made is returned, which hardly hits, but from which the whip is learned; the plan is not
    `allowed` if none may be made.

    Further searches, one for each of `retries`, are made until a strike is allowed and its hit probability is at least
    `enough`. Probability and expected miss are computed with samples that the search has not used. After several
    searches the probability is the largest of several estimates, each over 64 sampled whips, and is a few percent too
    high. `sag` is the arm's predicted deviation from the commanded start posture, see `expected_sag`. An arm in space
    has to follow its command exactly.
    """
    began = time.perf_counter()
    kind = AimedSearch if belief.plant.model.dimension == 3 else PlanarSearch
    search = kind(belief, target, demands or Demands(), sag)
    found = list[Plan]()
    for one in (effort, *retries):
        found.append(_searched(search, belief, rng, past, one))
        if found[-1].allowed and (found[-1].probability or 0.0) >= enough:
            break
    best = max(found, key=lambda x: (x.allowed, x.probability or 0.0))
    return replace(best, wall_time=time.perf_counter() - began)


def _searched(
    search: Search, belief: Belief, rng: np.random.Generator, past: Sequence[Sequence[float]], effort: PlanningEffort
) -> Plan:
    """The best strike of one search."""
    began = time.perf_counter()
    whips = belief.sample(rng, effort.whips)
    first, chosen, tried = None, None, 0
    for margin in search.margins:
        search.margin = margin
        strikes, scores, number = search.look(rng, past, effort, whips)
        order, tried = np.argsort(-scores), tried + number
        first = strikes[order[0]] if first is None else first
        chosen = search.first_allowed(strikes[order[: search.checked]])
        if chosen is not None:
            break
    strike = first if chosen is None else chosen
    assert strike is not None
    forbidden, safe = search.refusal(strike), None
    if forbidden is not None:
        safe, number = search.safe(rng, effort, whips)
        tried += number
        strike = strike if safe is None else safe
    refused = forbidden if safe is None else None
    fresh = belief.sample(rng, JUDGED)  # the strike was chosen for the others, and does better there
    return search.report(strike, fresh, rng, time.perf_counter() - began, tried, refused=refused, forbidden=forbidden)
