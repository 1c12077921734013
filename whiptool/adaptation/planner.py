"""Plan the strike with the largest probability of a hit, over whips sampled from the belief."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace

import numpy as np

from whiptool.adaptation.aimed_search import AimedSearch
from whiptool.adaptation.plan_search import Demands, Plan, PlanningEffort
from whiptool.adaptation.planar_search import PlanarSearch
from whiptool.adaptation.prior import Belief
from whiptool.goals.target import Target

JUDGED = 64  # whips over which the probability is stated
UNSURE = 0.5  # probability of a hit of an allowed strike, below which one is looked for again

# There is time before the first strike; in space limits and directions leave little of the box of strikes.
FIRST = PlanningEffort(pool=256, polished=16, whips=32, population=12, rounds=6)
NEXT = PlanningEffort()
FIRST_IN_SPACE = PlanningEffort(pool=2048, polished=32, steps=20, population=12)
NEXT_IN_SPACE = PlanningEffort(pool=512, steps=20)
RETRIES_IN_SPACE = 3  # with the first effort, while the hit probability is below 50 %


def surest(look: Callable[[PlanningEffort], Plan], efforts: Iterable[PlanningEffort]) -> Plan:
    """Return the best plan of one search after another; an allowed plan that hits with `UNSURE` or more ends them.

    After several searches the stated probability is the largest of several estimates, each over `JUDGED` sampled whips,
    and is therefore a few percent too high.

    Args:
        look: Searches for a strike with a given effort.
        efforts: Efforts of the searches, at least one.
    """
    began, found = time.perf_counter(), list[Plan]()
    for effort in efforts:
        found.append(look(effort))
        if found[-1].allowed and (found[-1].probability or 0.0) >= UNSURE:
            break
    best = max(found, key=lambda x: (x.allowed, x.probability or 0.0))
    return replace(best, wall_time=time.perf_counter() - began)


def plan(
    belief: Belief,
    target: Target,
    *,
    rng: np.random.Generator,
    past: Sequence[Sequence[float]] = (),
    demands: Demands | None = None,
    effort: PlanningEffort = NEXT,
    sag: Callable[[np.ndarray], np.ndarray] | None = None,
) -> Plan:
    """Return the strike with the largest probability of a hit over whips sampled from a belief.

    Candidates are found with the belief's mean, see `PlanarSearch` and, in space, `AimedSearch`. They are simulated
    with every sampled whip, and a search with a shrinking normal distribution refines the best (`CrossEntropy`). The
    miss with each sample is smoothed by the belief's model error (`ModelError.hit_probability`), in the search by at
    least 5 mm. Probability and expected miss are computed with samples that the search has not used.

    Args:
        belief: Distribution of the whip's parameters; an arm in space has to follow its command exactly.
        target: A point, and on request a direction and a least speed.
        rng: Generator for candidates and samples.
        past: Strikes that were tried before; they are candidates, too.
        demands: Further requirements of the strike.
        effort: Amount of computation.
        sag: Predicted deviation of the arm from the commanded start posture, see `whiptool.adaptation.sag`; None: none.

    Raises:
        InputError: A past strike does not fit this arm, or the arm has no default bounds.
    """
    began = time.perf_counter()
    kind = AimedSearch if belief.plant.model.dimension == 3 else PlanarSearch
    search = kind(belief, target, demands or Demands(), sag)
    whips = belief.sample(rng, effort.whips)
    first, chosen, tried = None, None, 0
    for margin in search.margins:
        search.margin = margin
        strikes, scores, number = search.look(rng, past, effort, whips)
        order, tried = np.argsort(-scores), tried + number
        first = strikes[order[0]] if first is None else first
        chosen = next((x for x in strikes[order[: search.checked]] if search.allows(x)), None)
        if chosen is not None:
            break
    strike = first if chosen is None else chosen
    assert strike is not None
    allowed = chosen is not None and bool(search.beyond(strike[None])[0] <= 0)
    fresh = belief.sample(rng, JUDGED)  # the strike was chosen for the others, and does better there
    return search.report(strike, fresh, rng, time.perf_counter() - began, tried, allowed=allowed)
