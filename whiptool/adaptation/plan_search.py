"""Planning a strike: its requirements, its score over whips sampled from the belief, and the cross-entropy search."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from whiptool.adaptation.model_error import ModelError
from whiptool.adaptation.prior import Belief, fresh_terms
from whiptool.goals.goals import Goals
from whiptool.goals.target import Target
from whiptool.identification.plant import Plant
from whiptool.limits.all_limits import Given
from whiptool.models.numbers import whole
from whiptool.models.strike import T_STAY, Strike, StrikeBounds
from whiptool.models.trajectory import Approach
from whiptool.rollout.compiled import CompiledRollout
from whiptool.strike_map.striker import Striker

SURE = 0.25  # of the hit radius and the cone: a strike that misses all whips by no more is worth no better one
_FAST = 10.0  # [m/s] of the tip of such a strike; where a speed is asked for, at least twice that
BLUR = 0.005  # [m] by which the search smoothes where strikes pass, at least
_PULL = 0.2  # probability that a metre of expected miss is worth, where nothing hits; and half a turn off the direction
_SAFE = 3  # rounds of random strikes, where no aimed one may be made
_FAR = 0.5  # [m], beyond which a miss is as good as any other
_SEARCHED = 1e-3  # [m], tolerance of the distances that a search compares: a fifth of `BLUR`, a third of the time
_TOGETHER = 8  # strikes whose whole trajectories are judged together


@dataclass(frozen=True)
class PlanningEffort:
    """Amount of computation of the planner."""

    pool: int = 160  # random candidate strikes, simulated with the mean of the belief
    polished: int = 8  # the best of them, which are improved along exact derivatives with the mean
    steps: int = 5  # largest number of such improvement steps
    whips: int = 16  # whips sampled from the belief
    population: int = 8  # strikes in a round of the cross-entropy search over all sampled whips
    rounds: int = 4  # rounds of that search

    def __post_init__(self) -> None:
        for name in ("pool", "polished", "whips"):
            whole(name, getattr(self, name))
        for name in ("steps", "population", "rounds"):
            whole(name, getattr(self, name), low=0)


@dataclass(frozen=True)
class Demands:
    """Constraints on a strike in addition to the hit."""

    bounds: StrikeBounds | None = None  # of strikes; default: `default_bounds`
    limits: Given = ()  # one or several that the strike has to keep with the belief's mean
    check: Callable[[Strike], str | None] | None = None  # returns why a strike must not be made, or None
    t_stay: float = T_STAY  # time after the movement's end in which the tip is observed [s]


@dataclass(frozen=True)
class Plan:
    """The chosen strike and predictions of its outcome; of a movement that is not a strike at the target, `probability`
    is None and `misses` is empty.
    """

    strike: tuple[float, ...]  # strike vector, (m,)
    probability: float | None  # of a hit
    expected_miss: float | None  # mean over the sampled whips that do not diverge [m]; None also if all diverge
    mean_miss: float | None  # miss distance with the mean of the belief [m]
    usage: float | None  # largest of the motors' speed-torque line, limit 1; None: no limits, or an arm in space
    reason: str  # why this strike was chosen, in words
    wall_time: float  # of planning [s]
    allowed: bool = True  # by limits and `check`; if not, no allowed strike was found, and it must not be made
    misses: tuple[float | None, ...] = ()  # [m], ascending, one per sampled whip, with a model error; None: diverged
    contact: float | None = None  # time of the closest approach with the mean of the belief [s]


@dataclass(frozen=True, eq=False)
class Passes:
    """Closest approaches of the tip to a goal, for B strikes with each of S whips."""

    distance: np.ndarray  # miss distance [m], (B, S); infinite if not known
    velocity: np.ndarray  # of the tip at the closest approach [m/s], (B, S, d)

    def probability(self, goal: Goals, error: ModelError, *, blur: float = 0.0) -> np.ndarray:
        """Return the mean hit probability of each strike over the whips, (B,), see `ModelError.hit_probability`."""
        return error.hit_probability(goal, self.distance, self.velocity, blur=blur).mean(axis=1)

    def angle(self, goal: Goals) -> np.ndarray:
        """Return the angles between the tip's velocities and the goal's direction [rad], (B, S)."""
        return goal.angle(self.velocity.reshape(-1, self.velocity.shape[2])).reshape(self.distance.shape)


class Search(ABC):
    """Searches for a strike that hits with the mean whip of a belief and with whips sampled from it; subclasses
    generate the candidates.

    `sag` predicts the deviation of the arm from the commanded start posture, see `expected_sag`; None: none. `margin`
    is the fraction of the limits that the current search leaves unused.
    """

    margins: tuple[float, ...] = (0.0,)  # `margin` of each successive search; without limits only the first is made
    checked: int | None = None  # best strikes of a search of which one may be chosen, see `first_allowed`; None: all
    spread: float  # standard deviation of the first steps around the best strike, as a fraction of the bounds' width

    def __init__(
        self,
        belief: Belief,
        target: Target,
        demands: Demands,
        sag: Callable[[np.ndarray], np.ndarray] | None = None,
    ) -> None:
        plant = belief.at()
        assert plant.controller is not None
        self.rollout, rough = (
            CompiledRollout(plant.model, plant.controller, free=fresh_terms(belief), sag=sag, tolerance=tolerance)
            for tolerance in (None, _SEARCHED)
        )
        self.striker = Striker(rough, bounds=demands.bounds, limits=demands.limits, t_stay=demands.t_stay)
        self.judge = Striker(self.rollout, bounds=demands.bounds, limits=demands.limits, t_stay=demands.t_stay)
        self.target, self.goal, self.error = target, target.goals, belief.model_error
        self.check = None if demands.check is None else cache(demands.check)  # a rehearsal takes seconds
        self.margins = self.margins if demands.limits else self.margins[:1]
        self.margin = self.margins[0]

    @abstractmethod
    def candidates(
        self, rng: np.random.Generator, past: Sequence[Sequence[float]], effort: PlanningEffort
    ) -> tuple[np.ndarray, int]:
        """Return strikes (B, m) that pass near the goal with the belief's mean, and the number of strikes from which
        they were chosen; these include the strikes `past`, which were tried before.
        """

    @abstractmethod
    def beyond(self, strikes: np.ndarray) -> np.ndarray:
        """Return by how much strikes (B, m) exceed the limits with the belief's mean, (B,), always finite; at most 0 if
        a strike keeps the limits.
        """

    @abstractmethod
    def spare(self, rng: np.random.Generator, effort: PlanningEffort) -> np.ndarray:
        """Return random strikes (B, m), first those within the limits with the belief's mean, as near to the goal as
        random strikes pass, from which a strike is chosen where no aimed one may be made.
        """

    def first_allowed(self, strikes: np.ndarray) -> np.ndarray | None:
        """Return the first of strikes (B, m) that keeps the limits at all times and that `check` allows; None if all
        are refused.
        """
        for first in range(0, len(strikes), _TOGETHER):
            some = strikes[first : first + _TOGETHER]
            for strike in some[self.judge.keep(some)]:
                if self._checked(strike) is None:
                    return strike
        return None

    def _checked(self, strike: np.ndarray) -> str | None:
        """What `check` says against a strike (m,); None: nothing."""
        return None if self.check is None else self.check(Strike.from_vector(strike))

    def refusal(self, strike: np.ndarray) -> str | None:
        """Return why a strike (m,) must not be made: what `check` says, or the limit that it exceeds; None: it may."""
        said = self._checked(strike)
        if said is None and not self.judge.keep(strike[None])[0]:
            made = Strike.from_vector(strike)
            path = self.rollout.trajectory(made, t_stay=self.judge.t_stay)
            said = self.striker.limits.explain(path, self.rollout.model.arm.joints, made) or "its simulation diverges"
        return said

    def safe(
        self, rng: np.random.Generator, effort: PlanningEffort, whips: Sequence[Plant]
    ) -> tuple[np.ndarray | None, int]:
        """Return the best of random strikes that may be made, from whose recording the whip is learned, and the number
        of strikes that were tried; None: none of them may be made.
        """
        for count in range(1, _SAFE + 1):
            strikes = self.spare(rng, effort)
            strikes = strikes[self.judge.keep(strikes)]
            scores = self.score(strikes, whips) if len(strikes) else np.empty(0)
            for strike in strikes[np.argsort(-scores)]:
                if self._checked(strike) is None:
                    return strike, count * effort.pool
        return None, _SAFE * effort.pool

    def usage(self, near: Approach) -> float | None:
        """Return the usage of the motors' speed-torque line by one strike, whose closest approach is `near`: 1 at the
        limit; None: not computed.
        """
        return None

    def look(
        self, rng: np.random.Generator, past: Sequence[Sequence[float]], effort: PlanningEffort, whips: Sequence[Plant]
    ) -> tuple[np.ndarray, np.ndarray, int]:
        """Run one search; return its strikes (B, m), the score of each over the sampled whips (B,), and the number of
        strikes from which the first were chosen.
        """
        tried, number = self.candidates(rng, past, effort)
        scores = self.score(tried, whips)
        first = int(scores.argmax())
        search = CrossEntropy(
            self.striker.widths, self.spread, effort.population, effort.rounds, self.striker.admissible, self.sure
        )
        draws, values = search.around(tried[first], float(scores[first]), lambda x: self.score(x, whips), rng)
        return np.vstack([tried, draws]), np.concatenate([scores, values]), number

    def mean(self, strikes: np.ndarray) -> Approach:
        """Return the closest approaches of strikes (B, m) to the goal with the belief's mean, as the search needs
        them."""
        return self.striker.rollout.approach(strikes, self.goal.positions[0], t_stay=self.striker.t_stay)

    def each(self, strikes: np.ndarray, whips: Sequence[Plant], rollout: CompiledRollout) -> Passes:
        """Return the closest approaches of all strikes (B, m) to the goal with all S whips."""
        order = [whip for _ in strikes for whip in whips]
        near = rollout.approach(
            np.repeat(strikes, len(whips), axis=0),
            self.goal.positions[0],
            t_stay=self.striker.t_stay,
            models=[whip.model for whip in order],
            controllers=[whip.controller for whip in order if whip.controller is not None],
        )
        shape, distance = (len(strikes), len(whips)), np.where(near.known, near.distance, np.inf)
        return Passes(distance.reshape(shape), np.nan_to_num(near.velocity).reshape(*shape, -1))

    def score(self, strikes: np.ndarray, whips: Sequence[Plant]) -> np.ndarray:
        """Return hit probabilities less a penalty for the miss, (B,); strikes that break the limits score below all
        others.
        """
        passes = self.each(strikes, whips, self.striker.rollout)
        score = passes.probability(self.goal, self.error, blur=BLUR)
        score = score - _PULL * np.minimum(passes.distance, _FAR).mean(axis=1)
        if self.goal.directions is not None:
            score = score - _PULL * passes.angle(self.goal).mean(axis=1) / math.pi
        beyond = self.beyond(strikes)
        return score - np.where(beyond > 0, 10 + beyond, 0)

    def sure(self, score: float) -> bool:
        """Whether a score is at least that of a strike that passes well within the goal with every sampled whip."""
        little, turned = SURE * self.goal.hit_radius, SURE * self.goal.cone
        passes = Passes(np.full((1, 1), little), _arriving(self.goal, turned)[None, None])
        best = float(passes.probability(self.goal, self.error, blur=BLUR)[0]) - _PULL * little
        return score >= best - (0 if self.goal.directions is None else _PULL * turned / math.pi)

    def report(
        self,
        strike: np.ndarray,
        whips: Sequence[Plant],
        rng: np.random.Generator,
        spent: float,
        tried: int,
        *,
        refused: str | None,
        forbidden: str | None,
    ) -> Plan:
        """Return the plan: the chosen strike (m,), predictions of its outcome, and the reason for the choice.

        The planner took `spent` seconds and tried `tried` strikes. The texts say why the strike must not be made
        (`refused`), and why the best aimed one must not (`forbidden`); None: it may, and is the chosen strike.
        """
        passes = self.each(strike[None], whips, self.rollout)
        near = self.rollout.approach(strike[None], self.goal.positions[0], t_stay=self.striker.t_stay)
        miss, known = passes.distance[0], np.isfinite(passes.distance[0])
        probability = float(passes.probability(self.goal, self.error)[0])
        expected = float(miss[known].mean()) if known.any() else None
        said = "all samples diverge" if expected is None else f"expected miss {100 * expected:.1f} cm"
        if known.any() and not known.all():
            said += f" without the {1 - known.mean():.0%} of the samples that diverge"
        if self.goal.directions is not None and known.any():
            off = float(passes.angle(self.goal)[0][known].mean())
            said += f", {math.degrees(off):.1f} degrees off the direction"
        usage, speed, asked = self.usage(near), float(self.goal.arrival_speed(near.velocity)[0]), self.goal.speed or 0.0
        reason = (
            f"best of {tried} candidates: hit probability {probability:.0%} over {len(whips)} posterior samples of the "
            f"whip, {said}, tip speed {float(near.speed[0]):.1f} m/s"
        )
        if speed < asked:
            reason += f"; no faster strike was found, although {asked:g} m/s is required"
        if usage is not None:
            reason += f", using {usage:.0%} of the motors' limits"
        if forbidden is not None and refused is None:
            reason += f"; a random strike, to learn from, because the best aimed one must not be made: {forbidden}"
        if refused is not None:
            reason += f"; it must not be made, and none was found that may: {refused}"
        drawn = np.sort(self.error.drawn(miss, rng))
        misses = tuple(x if np.isfinite(x) else None for x in drawn.tolist())
        vector = tuple(map(float, Strike.from_vector(strike).vector))
        nearest, contact = float(near.distance[0]), float(near.time[0])
        return Plan(vector, probability, expected, nearest, usage, reason, spent, refused is None, misses, contact)


def _arriving(goal: Goals, angle: float) -> np.ndarray:
    """Return a velocity (d,) [m/s] that is fast enough for a goal, and an angle [rad] off its direction."""
    d = goal.positions.shape[1]
    along = np.eye(d)[0] if goal.directions is None else goal.directions[0]
    aside = np.eye(d)[np.abs(along).argmin()]
    across = aside - (aside @ along) * along
    if goal.sights is not None:
        across = np.cross(along, goal.sights[0])
    fast = max(_FAST, 2 * (goal.speed or 0.0))
    return fast * (math.cos(angle) * along + math.sin(angle) * across / np.linalg.norm(across))


LEAST_ELITE = 2  # strikes that the spread is learned from, at least


@dataclass(frozen=True)
class CrossEntropy:
    """Settings of the cross-entropy search."""

    width: np.ndarray  # of the box of strikes in each coordinate, (m,)
    spread: float  # standard deviation of the first draws, as a fraction of the width
    population: int  # strikes in a round
    rounds: int  # largest number of rounds
    within: Callable[[np.ndarray], np.ndarray]  # moves strikes (B, m) into the feasible set
    sure: Callable[[float], bool]  # whether the search may stop at a strike of this value

    def around(
        self, best: np.ndarray, value: float, worth: Callable[[np.ndarray], np.ndarray], rng: np.random.Generator
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the strikes that were drawn around the best strike (D, m), and their values by `worth` (D,), which are
        maximised.

        If a round finds a better strike, that becomes the centre, and the new spread is the mean of the last spread and
        of the distance of the round's best quarter from the centre; else the spread shrinks to three fifths.
        """
        centre, top, spreads = best, value, np.full(len(best), self.spread)
        strikes, values = np.empty((0, len(best))), np.empty(0)
        for _ in range(self.rounds):
            if self.sure(top):
                break
            draws = self.within(centre + spreads * self.width * rng.standard_normal((self.population, len(best))))
            found = worth(draws)
            strikes, values = np.vstack([strikes, draws]), np.concatenate([values, found])
            elite = draws[np.argsort(-found)[: max(LEAST_ELITE, self.population // 4)]]
            if found.max() > top:
                centre, top = draws[int(found.argmax())], float(found.max())
                spreads = 0.5 * spreads + 0.5 * np.abs(elite - centre).mean(axis=0) / self.width
            else:
                spreads = 0.6 * spreads
        return strikes, values
