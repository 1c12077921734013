"""Plan an aimed strike in space: point, direction and speed, within a robot's limits, over whips of the belief.

A robot's limits and directions leave a thin part of the box of strikes, and derivatives find it: random strikes that
keep the limits, those whose tips pass the goal best on the mean of the belief, refined there along exact derivatives as
a strike map's are (`whiptool.strike_map.refinement`), and of these, and steps from the best, the one that hits most of
the whips that are still possible.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from whiptool.adaptation.cross_entropy import search_around
from whiptool.adaptation.model_error import ModelError
from whiptool.adaptation.planner import JUDGED, SURE, WORTH, Effort, Plan
from whiptool.adaptation.prior import Belief, fresh_terms
from whiptool.goals import Goals
from whiptool.identification.plant import Plant
from whiptool.limits import Limits
from whiptool.models.strike import T_STAY, Strike, StrikeBounds
from whiptool.rollout.compiled import CompiledRollout
from whiptool.strike_map.refinement import refine
from whiptool.strike_map.striker import Striker
from whiptool.strike_map.turning import Front
from whiptool.target import Target

FIRST = Effort(pool=2048, polished=32, whips=16, population=12, rounds=4)  # limits and directions leave little
NEXT = Effort(pool=512, polished=8, whips=16, population=8, rounds=4)
RETRIES = 3  # with the first effort, while the hit probability is below 50 %
RATE = 100.0  # [1/s] of the paths that are compared
STEPS = 20  # of a refinement
STEEPEST = 1e3  # [m] by a number of a strike: no derivative of a closest approach that can be trusted
_FAST = 10.0  # [m/s] of a tip that arrives well; where a speed is asked for, at least twice that
_SPREAD = 0.02  # of the box's widths, of the first steps from the best strike


@dataclass(frozen=True, eq=False)
class Passes:
    """How B strikes with each of S whips pass a goal.

    Args:
        distance: Closest approach [m], (B, S); infinite where it is not known.
        velocity: Velocity of the tip there [m/s], (B, S, d).
    """

    distance: np.ndarray
    velocity: np.ndarray

    def probability(self, goal: Goals, error: ModelError, *, blur: float = 0.0) -> np.ndarray:
        """Return the hit probability of each strike, (B,), see `ModelError.hit_probability`."""
        return error.hit_probability(goal, self.distance, self.velocity, blur=blur).mean(axis=1)

    def angle(self, goal: Goals) -> np.ndarray:
        """Return the angles between velocities and direction [rad], (B, S)."""
        return goal.angle(self.velocity.reshape(-1, self.velocity.shape[2])).reshape(self.distance.shape)


def aim(
    belief: Belief,
    target: Target,
    *,
    rng: np.random.Generator,
    limits: Sequence[Limits] = (),
    past: Sequence[Sequence[float]] = (),
    effort: Effort,
    bounds: StrikeBounds | None = None,
    t_stay: float = T_STAY,
) -> Plan:
    """Return the strike with the largest probability of a hit over whips sampled from a belief.

    Args:
        belief: Distribution of the whip's numbers, of an arm that follows its command exactly.
        target: Point and hit radius, and on request direction and least speed.
        rng: Generator for candidates and samples.
        limits: Limits that a strike has to keep, with the posterior mean.
        past: Strikes that were tried before; they are candidates, too.
        effort: How hard to look: `pool` random strikes, `polished` of which are refined.
        bounds: Box of strikes; default: `default_bounds`.
        t_stay: A strike is watched so long after the movement ended [s].
    """
    began = time.perf_counter()
    search = _Aimed(belief, target, limits, bounds, t_stay)
    whips = belief.sample(rng, effort.whips)
    strikes, worth, tried = search.look(rng, past, effort, whips)
    order = np.argsort(-worth)
    chosen, allowed = strikes[order[0]], False
    for x in strikes[order]:
        if search.striker.keep(x[None])[0]:
            chosen, allowed = x, True
            break
    return search.report(chosen, belief.sample(rng, JUDGED), rng, time.perf_counter() - began, tried, allowed=allowed)


class _Aimed:
    """Rolls strikes out with a belief's mean and samples, and returns their hit probabilities."""

    def __init__(
        self,
        belief: Belief,
        target: Target,
        limits: Sequence[Limits],
        bounds: StrikeBounds | None,
        t_stay: float,
    ) -> None:
        plant = belief.at()
        assert plant.controller is not None
        self.rollout = CompiledRollout(plant.model, plant.controller, free=fresh_terms(belief))
        self.striker = Striker(self.rollout, bounds=bounds, limits=tuple(limits), t_stay=t_stay)
        self.front = Front(plant.model)
        self.target, self.goal, self.error, self.t_stay = target, target.goals, belief.model_error, t_stay

    def look(
        self, rng: np.random.Generator, past: Sequence[Sequence[float]], effort: Effort, whips: Sequence[Plant]
    ) -> tuple[np.ndarray, np.ndarray, int]:
        """Strikes within the limits, the score of each over the sampled whips, and how many candidates there were."""
        starts = self.starts(rng, effort)
        if len(past):
            starts = np.vstack([np.array(past, float), starts])
        tried = self.refined(starts)
        worth = self.worth(tried, whips)
        first = int(worth.argmax())
        draws, values = search_around(
            tried[first],
            float(worth[first]),
            lambda strikes: self.worth(strikes, whips),
            rng=rng,
            width=self.striker.widths,
            spread=_SPREAD,
            population=effort.population,
            rounds=effort.rounds,
            within=self.striker.admissible,
            sure=self.sure,
        )
        return np.vstack([tried, draws]), np.concatenate([worth, values]), effort.pool + len(past)

    def starts(self, rng: np.random.Generator, effort: Effort) -> np.ndarray:
        """Random strikes whose tips pass the goal best with the mean: those within limits of peaks, (B, m).

        An arm whose first joint turns all of it strikes in all directions alike: at every instant of a path it is
        turned to where the goal lies.
        """
        striker, goal = self.striker, self.goal
        pool = striker.admissible(rng.uniform(striker.lower, striker.upper, (effort.pool, len(striker.lower))))
        keep, paths = striker.paths(pool, rate=RATE)
        tips = paths.reshape(-1, paths.shape[2])
        velocities = np.gradient(paths, 1 / RATE, axis=1).reshape(tips.shape)
        turned = self.front.angles(goal.positions)[0] - self.front.angles(tips)
        left = goal.residuals(self.front.vectors(tips, turned), self.front.vectors(velocities, turned))
        cost = np.linalg.norm(left, axis=1).reshape(paths.shape[:2])
        cost = np.where(np.isfinite(cost), cost, np.inf)
        when, rows = cost.argmin(axis=1), np.arange(len(pool))
        angles = np.nan_to_num(np.remainder(turned.reshape(cost.shape)[rows, when] + np.pi, 2 * np.pi) - np.pi)
        ready = self._wrapped(self.front.strikes(pool, angles))
        inside = keep & striker.inside(ready)
        worst = cost[rows, when] + np.where(inside, 0.0, goal.largest_cost)
        return ready[np.argsort(worst)[: effort.polished]]

    def _wrapped(self, strikes: np.ndarray) -> np.ndarray:
        """Strikes of an arm that turns, a whole turn back where that puts their first joint into the box."""
        if not self.front.turns:
            return strikes
        first = [0, self.rollout.model.arm.n]
        wrapped = strikes.copy()
        middle = (self.striker.lower[first] + self.striker.upper[first]) / 2
        mean = strikes[:, first].mean(axis=1) - middle.mean()
        wrapped[:, first] -= (2 * np.pi * np.round(mean / (2 * np.pi)))[:, None]
        return wrapped

    def refined(self, starts: np.ndarray) -> np.ndarray:
        """Strikes corrected until the mean hits, or they get no better; those without sound derivatives are left out.

        Where the tip is nearest at rest, its direction and the instant of its closest approach have none.
        """
        slopes = self.striker.derivatives(starts, self.goals(len(starts)))
        size = np.abs(slopes).max(axis=(1, 2))
        sound = np.isfinite(size) & (size < STEEPEST)
        if not sound.any():
            return starts
        return refine(self.striker, self.goals(int(sound.sum())), starts[sound], slopes[sound], steps=STEPS).strikes

    def goals(self, count: int) -> Goals:
        """The goal of so many strikes."""
        return self.goal.rows(np.zeros(count, int))

    def each(self, strikes: np.ndarray, whips: Sequence[Plant]) -> Passes:
        """How every strike passes with every whip."""
        order = [whip for _ in strikes for whip in whips]
        near = self.rollout.approach(
            np.repeat(strikes, len(whips), axis=0),
            np.array(self.target.position),
            t_stay=self.t_stay,
            models=[whip.model for whip in order],
            controllers=[whip.controller for whip in order if whip.controller is not None],
        )
        shape, distance = (len(strikes), len(whips)), np.where(near.known, near.distance, np.inf)
        return Passes(distance.reshape(shape), np.nan_to_num(near.velocity).reshape(*shape, -1))

    def worth(self, strikes: np.ndarray, whips: Sequence[Plant]) -> np.ndarray:
        """Probability of a hit less a little of the expected miss; what is beyond the limits is behind all else."""
        passes = self.each(strikes, whips)
        worth = passes.probability(self.goal, self.error, blur=WORTH.blur)
        worth = worth - WORTH.pull * np.minimum(passes.distance, WORTH.far).mean(axis=1)
        if self.goal.directions is not None:
            worth = worth - WORTH.pull * passes.angle(self.goal).mean(axis=1) / math.pi
        beyond = self.striker.land(strikes, self.goals(len(strikes))).beyond
        return worth - np.where(beyond > 0, 10 + np.minimum(beyond, 10), 0)

    def sure(self, worth: float) -> bool:
        """Whether a strike scores as much as one that passes the goal of every sampled whip by little."""
        little, turned = SURE * self.goal.hit_radius, SURE * self.goal.cone
        passes = Passes(np.full((1, 1), little), _arriving(self.goal, turned)[None, None])
        best = float(passes.probability(self.goal, self.error, blur=WORTH.blur)[0]) - WORTH.pull * little
        return worth >= best - (0 if self.goal.directions is None else WORTH.pull * turned / math.pi)

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
        passes, landed = self.each(strike[None], whips), self.striker.land(strike[None], self.goal)
        near = self.rollout.approach(strike[None], np.array(self.target.position), t_stay=self.t_stay)
        miss = passes.distance[0]
        probability = float(passes.probability(self.goal, self.error)[0])
        steady = miss[np.isfinite(miss)]
        expected = float(steady.mean()) if len(steady) else None
        said = "all samples diverge" if expected is None else f"expected miss {100 * expected:.1f} cm"
        if self.goal.directions is not None and len(steady):
            off = float(passes.angle(self.goal)[0][np.isfinite(miss)].mean())
            said += f", {math.degrees(off):.1f} degrees off the direction"
        reason = (
            f"best of {tried} candidates: hit probability {probability:.0%} over {len(whips)} posterior samples of the "
            f"whip, {said}, tip speed {float(near.speed[0]):.1f} m/s"
        )
        if not allowed:
            reason += "; no plan within the limits was found"
        drawn = np.sort(self.error.drawn(miss, rng))
        misses = tuple(x if np.isfinite(x) else None for x in drawn.tolist())
        vector = tuple(map(float, Strike.from_vector(strike).vector))
        nearest, contact = float(landed.distance[0]), float(near.time[0])
        return Plan(vector, probability, expected, nearest, None, reason, spent, allowed, misses, contact)


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
