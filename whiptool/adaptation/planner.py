"""Plan the strike with the largest probability of a hit, over whips sampled from the belief."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from whiptool.adaptation.cross_entropy import search_around
from whiptool.adaptation.prior import Belief, fresh_terms
from whiptool.goals.target import Target
from whiptool.identification.plant import Plant
from whiptool.limits.motor_limits import MotorLimits
from whiptool.models.parameters import whole
from whiptool.models.strike import T_STAY, Strike, StrikeBounds, default_bounds
from whiptool.rollout.compiled import CompiledRollout
from whiptool.rollout.trajectory import Approach

MARGINS = (0.1, 0.2, 0.3, 0.4)  # part of the motors' line that is kept free; more, where all strikes were refused
SURE = 0.25  # of the hit radius: where a strike that misses all whips by no more is worth no better one
CHECKED = 3  # strikes that are asked about before more is kept free
JUDGED = 64  # whips over which the probability is stated
_SPREAD = 0.04  # of the box's widths, of the first steps from the best strike
UNSURE = 0.5  # probability of a hit of an allowed strike, below which one is looked for again


@dataclass(frozen=True)
class Squeeze:
    """How strikes are brought within limits: by random steps that shrink, for derivatives do not see the limits.

    Args:
        rounds: Rounds of steps.
        children: Strikes that are tried in each.
        kept: Number of the best of them and the former ones that are kept.
        shrink: Factor of the steps from round to round.
        near: Miss on the mean [m] that steps along derivatives mend: no more random ones.
        last_steps: Such steps.
    """

    rounds: int = 12
    children: int = 64
    kept: int = 8
    shrink: float = 0.8
    near: float = 0.015
    last_steps: int = 3


_SQUEEZE = Squeeze()


@dataclass(frozen=True)
class Worth:
    """Score of a strike in the search, in addition to its hit probability.

    Args:
        blur: The search smoothes where strikes pass by this, at least [m].
        pull: Probability that a metre of expected miss is worth, where nothing hits.
        far: A miss beyond is as good as any other [m].
    """

    blur: float = 0.005
    pull: float = 0.2
    far: float = 0.5


WORTH = Worth()


@dataclass(frozen=True)
class Effort:
    """How much computation the planner spends.

    Args:
        pool: Number of random candidate strikes, rolled out with the mean of the belief.
        polished: Number of the best of them that are improved along exact derivatives with the mean.
        steps: Number of such improvement steps.
        whips: Number of whips sampled from the belief.
        population, rounds: Size and number of rounds of the cross-entropy search over all sampled whips.
    """

    pool: int = 160
    polished: int = 8
    steps: int = 5
    whips: int = 16
    population: int = 8
    rounds: int = 4

    def __post_init__(self) -> None:
        for name in ("pool", "polished", "whips"):
            whole(name, getattr(self, name))
        for name in ("steps", "population", "rounds"):
            whole(name, getattr(self, name), low=0)


FIRST = Effort(pool=256, polished=16, whips=32, population=12, rounds=6)  # there is time before the first strike
NEXT = Effort()


@dataclass(frozen=True)
class Demands:
    """Constraints on a strike besides the hit.

    Args:
        bounds: Box of strikes; default: `default_bounds`.
        limits: Limits of the motors; a strike beyond them on the mean is only taken if there is no other.
        speed: The tip is at least this fast at the closest approach, on the mean [m/s]; a slower strike is only taken
            if there is no other.
        check: Says why a strike must not be made, or None; called for the best strikes, one after the other. Where it
            forbids the best `CHECKED`, more of the motors is kept free (`MARGINS`), and the search begins again; the
            first search's best is taken where all are forbidden.
        t_stay: A strike is watched so long after the movement ended [s].
        admissible: Brings strikes (B, 2 a + 1) within what the joints may be commanded; default: anything.
    """

    bounds: StrikeBounds | None = None
    limits: MotorLimits | None = None
    speed: float = 0.0
    check: Callable[[Strike], str | None] | None = None
    t_stay: float = T_STAY
    admissible: Callable[[np.ndarray], np.ndarray] = lambda strikes: strikes


@dataclass(frozen=True)
class Plan:
    """The strike that was chosen.

    Args:
        strike: Strike vector.
        probability: Predicted probability of a hit; None, as below, for a movement that is not meant to hit.
        expected_miss: Mean miss distance over the sampled whips that do not diverge [m]; None also if all diverge.
        mean_miss: Miss distance with the mean of the belief [m].
        usage: Largest share of the motors' speed-torque line that the strike uses with the mean of the belief; None: no
            limits were given.
        reason: Why this strike was chosen, in words.
        wall_time: Time that planning took [s].
        allowed: Whether motor limits, least speed and `check` all allow the strike; if not, no allowed one was found.
        misses: Predictive sample of the miss distance [m]: one per sampled whip, an error of the model drawn for each,
            in rising order; None where it diverges. Empty: of a movement that is not meant to hit.
        contact: When the tip is nearest to the target, on the mean [s].
    """

    strike: tuple[float, ...]
    probability: float | None
    expected_miss: float | None
    mean_miss: float | None
    usage: float | None
    reason: str
    wall_time: float
    allowed: bool = True
    misses: tuple[float | None, ...] = ()
    contact: float | None = None


def surest(look: Callable[[Effort], Plan], efforts: Iterable[Effort]) -> Plan:
    """Return the best plan of one search after another; an allowed plan that hits with `UNSURE` or more ends them.

    Otherwise the stated probability is the largest of several estimates, each over `JUDGED` sampled whips,
    and is therefore a few percent too high.

    Args:
        look: Search for a strike with an effort.
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
    demands: Demands = Demands(),
    effort: Effort = NEXT,
    sag: Callable[[np.ndarray], np.ndarray] | None = None,
) -> Plan:
    """Return the strike with the largest probability of a hit over whips sampled from a belief.

    Random candidates and past strikes with their neighbours are tried on the belief's mean; the best are improved
    there by Gauss-Newton steps along exact derivatives; all that are left are tried on every sample, and a search with
    a shrinking normal distribution refines the best (`search_around`). Each sample's miss distance is
    smoothed by the belief's model error (`ModelError.hit_probability`), in the search by at least 5 mm. Probability and
    expected miss are stated on samples that the search has not seen.

    Args:
        belief: Distribution of the whip's numbers.
        target: Point and hit radius.
        rng: Generator for candidates and samples.
        past: Strikes that were tried before; they and their neighbours are candidates, too.
        demands: What else is asked of the strike.
        effort: How hard to look.
        sag: How far the arm will stand from the commanded start, see `whiptool.adaptation.sag`; None: not at all.

    Raises:
        InputError: A past strike does not fit this arm, or the arm has no default bounds.
    """
    began = time.perf_counter()
    search = _Search(belief, target, demands, sag)
    whips = belief.sample(rng, effort.whips)
    first, tried, allowed = None, 0, True
    check = demands.check
    for search.margin in MARGINS if demands.limits is not None else MARGINS[:1]:
        strikes, scores, number = search.look(rng, past, effort, whips)
        order, tried = np.argsort(-scores), tried + number
        first = strikes[order[0]] if first is None else first
        chosen = next(
            (x for x in strikes[order[:CHECKED]] if check is None or check(Strike.from_vector(x)) is None), None
        )
        if chosen is not None:
            break
    else:
        chosen = first
        allowed = False
    assert chosen is not None
    fresh = belief.sample(rng, JUDGED)  # the strike was chosen for the others, and does better there
    return search.report(chosen, fresh, rng, time.perf_counter() - began, tried, allowed=allowed)


class _Search:
    """Roll strikes out with a belief's mean and samples, and score them."""

    def __init__(
        self,
        belief: Belief,
        target: Target,
        demands: Demands,
        sag: Callable[[np.ndarray], np.ndarray] | None = None,
    ) -> None:
        plant = belief.at()
        assert plant.controller is not None
        self.target, self.limits, self.speed, self.t_stay = target, demands.limits, demands.speed, demands.t_stay
        self.margin = MARGINS[0]
        self.box, self._admissible = (demands.bounds or default_bounds(plant.model.arm)).box, demands.admissible
        self.rollout = CompiledRollout(plant.model, plant.controller, free=fresh_terms(belief), sag=sag)
        self.error = belief.model_error
        self._at = np.array(target.position)

    def look(
        self, rng: np.random.Generator, past: Sequence[Sequence[float]], effort: Effort, whips: Sequence[Plant]
    ) -> tuple[np.ndarray, np.ndarray, int]:
        """Strikes, the score of each over the sampled whips, and how many candidates there were."""
        lower, upper = self.box
        candidates = self.within(rng.uniform(lower, upper, (effort.pool, len(lower))))
        if len(past):
            known = np.array(past, float)
            around = np.repeat(known, 8, axis=0)
            around = around + 0.05 * (upper - lower) * rng.standard_normal(around.shape)
            candidates = np.vstack([self.within(np.vstack([known, around])), candidates])
        best = candidates[np.argsort(self.rank(self.mean(candidates)))[: effort.polished]]
        tried = np.vstack([best, self.polish(best, effort.steps)])
        if self.limits is not None or self.speed:  # what is allowed is a thin part of the box
            squeezed = self.squeeze(tried, rng)
            tried = np.vstack([squeezed, self.polish(squeezed, _SQUEEZE.last_steps)])
        scores = self.score(tried, whips)
        first = int(scores.argmax())
        draws, values = search_around(
            tried[first],
            float(scores[first]),
            lambda strikes: self.score(strikes, whips),
            rng=rng,
            width=upper - lower,
            spread=_SPREAD,
            population=effort.population,
            rounds=effort.rounds,
            within=self.within,
            sure=self.sure,
        )
        return np.vstack([tried, draws]), np.concatenate([scores, values]), len(candidates)

    def within(self, strikes: np.ndarray) -> np.ndarray:
        """Strikes within the box, and within what the joints may be commanded."""
        return self._admissible(np.clip(strikes, *self.box))

    def mean(self, strikes: np.ndarray) -> Approach:
        """On the belief's mean."""
        return self.rollout.approach(strikes, self._at, t_stay=self.t_stay)

    def excess(self, near: Approach) -> np.ndarray:
        """How far beyond the motors' line and below the least speed, 0 where neither, (B,)."""
        excess = np.clip(np.nan_to_num(1 - near.speed / self.speed, nan=1.0), 0.0, 1.0) if self.speed else 0.0
        if self.limits is not None:
            excess = excess + np.clip(self.limits.violation_of_peaks(near, margin=self.margin), 0.0, 10.0)
        return excess + np.zeros(len(near.distance))

    def rank(self, near: Approach) -> np.ndarray:
        """Miss distance, with what the motors cannot do and what is too slow behind all others, (B,)."""
        excess = self.excess(near)
        distance = np.where(near.known, near.distance, 1e3)
        return distance + np.where(excess > 0, 10 + excess, 0)

    def polish(self, strikes: np.ndarray, steps: int) -> np.ndarray:
        """Gauss-Newton steps towards no miss on the mean, by the strike's scaled numbers; the best of each path."""
        lower, upper = self.box
        width, x, best, value = upper - lower, strikes.copy(), strikes.copy(), np.full(len(strikes), np.inf)
        for step in range(steps + 1):
            near, slope = self.rollout.gradient(x, self._at, t_stay=self.t_stay)
            rank = self.rank(near)
            better = rank < value
            best[better], value[better] = x[better], rank[better]
            if step == steps:
                break
            g = slope * width  # by the numbers in units of their range
            move = -near.distance[:, None] * g / np.maximum((g**2).sum(axis=1, keepdims=True), 1e-6)
            length = np.linalg.norm(move, axis=1, keepdims=True)
            move = np.nan_to_num(move * np.minimum(1.0, 0.1 / np.maximum(length, 1e-9)))
            x = self.within(x + move * width)
        return best

    def squeeze(self, strikes: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """Strikes that rank better on the mean, by random steps that shrink; derivatives do not see the limits."""
        lower, upper = self.box
        kept, rank, spread = strikes, self.rank(self.mean(strikes)), 0.1
        for _ in range(_SQUEEZE.rounds):
            if np.sort(rank)[: _SQUEEZE.kept // 2].max() <= _SQUEEZE.near:
                break
            parents = kept[rng.integers(len(kept), size=_SQUEEZE.children)]
            children = parents + spread * (upper - lower) * rng.standard_normal(parents.shape)
            children = self.within(children)
            kept, rank = np.vstack([kept, children]), np.r_[rank, self.rank(self.mean(children))]
            order = np.argsort(rank)[: _SQUEEZE.kept]
            kept, rank, spread = kept[order], rank[order], spread * _SQUEEZE.shrink
        return kept[np.argsort(rank)[: _SQUEEZE.kept]]

    def each(self, strikes: np.ndarray, whips: Sequence[Plant]) -> np.ndarray:
        """Miss distance of every strike with every whip, (strikes, whips) [m]; infinite where it is not known."""
        B, S = len(strikes), len(whips)
        order = [whip for _ in range(B) for whip in whips]
        controllers = [whip.controller for whip in order if whip.controller is not None]
        near = self.rollout.approach(
            np.repeat(strikes, S, axis=0),
            self._at,
            t_stay=self.t_stay,
            models=[whip.model for whip in order],
            controllers=controllers,
        )
        return np.where(near.known, near.distance, np.inf).reshape(B, S)

    def probability(self, miss: np.ndarray) -> np.ndarray:
        """Of a hit, per strike, from (strikes, whips) miss distances; smoothed for the search."""
        return self.error.hit_probability(self.target.goals, miss, None, blur=WORTH.blur).mean(axis=1)

    def score(self, strikes: np.ndarray, whips: Sequence[Plant]) -> np.ndarray:
        """Probability of a hit less a little of the expected miss; what the motors cannot do is behind all else."""
        miss = self.each(strikes, whips)
        score = self.probability(miss) - WORTH.pull * np.minimum(miss, WORTH.far).mean(axis=1)
        if self.limits is None and not self.speed:
            return score
        excess = self.excess(self.mean(strikes))
        return score - np.where(excess > 0, 10 + excess, 0)

    def sure(self, score: float) -> bool:
        """Whether a strike scores as much as one that misses with every sampled whip by little."""
        little = SURE * self.target.hit_radius
        return score >= float(self.probability(np.array([[little]]))[0]) - WORTH.pull * little

    def report(
        self,
        strike: np.ndarray,
        whips: Sequence[Plant],
        rng: np.random.Generator,
        spent: float,
        tried: int,
        *,
        allowed: bool,
    ) -> Plan:
        """The choice in words and numbers."""
        miss, near = self.each(strike[None], whips)[0], self.mean(strike[None])
        probability = float(self.error.hit_probability(self.target.goals, miss, None).mean())
        steady = miss[np.isfinite(miss)]
        expected = float(steady.mean()) if len(steady) else None
        said = "all samples diverge" if expected is None else f"expected miss {100 * expected:.1f} cm"
        if 0 < len(steady) < miss.size:
            said += f" without the {1 - len(steady) / miss.size:.0%} of the samples that diverge"
        usage = None if self.limits is None else float(self.limits.violation_of_peaks(near)[0]) + 1
        reason = (
            f"best of {tried} candidates: hit probability {probability:.0%} over {len(whips)} posterior samples of the "
            f"whip, {said}, tip speed {float(near.speed[0]):.1f} m/s"
        )
        if near.speed[0] < self.speed:
            reason += f"; no faster strike was found, although {self.speed:g} m/s is required"
        if usage is not None:
            reason += (
                f", using {usage:.0%} of the motors' limits"
                if usage <= 1
                else f"; no plan within the motors' limits was found, and this one uses {usage:.0%} of them"
            )
        vector = tuple(map(float, Strike.from_vector(strike).vector))
        allowed &= bool(self.excess(near)[0] <= 0)
        drawn = np.sort(self.error.drawn(miss, rng))
        misses = tuple(x if np.isfinite(x) else None for x in drawn.tolist())
        nearest, contact = float(near.distance[0]), float(near.time[0])
        return Plan(vector, probability, expected, nearest, usage, reason, spent, allowed, misses, contact)
