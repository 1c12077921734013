"""Search for aimed strikes in space, within limits that leave a small part of the bounds.

Candidates are random strikes that keep the limits and whose tips pass the goal best with the mean of the belief, and
strikes of the arm's map; they are refined along exact derivatives like those of a strike map
(`whiptool.strike_map.striker`). If none hits, strikes of the map are followed from the map's whip to the belief's mean.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property, lru_cache

import numpy as np

from whiptool.adaptation.continuation import continued
from whiptool.adaptation.plan_search import PlanningEffort, Search
from whiptool.goals.goals import Goals
from whiptool.goals.target import Target
from whiptool.models.whip import WhipParameters
from whiptool.rollout.compiled import CompiledRollout
from whiptool.strike_map.answers import Front
from whiptool.strike_map.map_files import map_of_arm
from whiptool.strike_map.strike_map import StrikeMap
from whiptool.strike_map.striker import Striker, refine

RATE = 100.0  # [1/s] of the paths that are compared
_FOLLOWED = 8  # strikes of a map at most, where no other hits
STEEPEST = 1e3  # [m] by a number of a strike: no derivative of a closest approach that can be trusted


class AimedSearch(Search):
    """Search in space: the best of random strikes and past strikes are refined along derivatives."""

    spread = 0.02

    @cached_property
    def front(self) -> Front:
        """Rotations about the arm's first joint, which turn a strike to the direction of the goal."""
        return Front(self.rollout.model)

    @cached_property
    def map(self) -> StrikeMap | None:
        """The map that comes with the package for the arm, of another whip; None for other arms."""
        return map_of_arm(self.rollout.model.arm)

    def candidates(
        self, rng: np.random.Generator, past: Sequence[Sequence[float]], effort: PlanningEffort
    ) -> tuple[np.ndarray, int]:
        """Return refined known, random and past strikes, those that keep all limits if there are any, and the number of
        candidates; see `Search.candidates`."""
        starts = self.starts(rng, effort)
        if len(past):
            starts = np.vstack([np.array(past, float), starts])
        tried = self.refined(starts, effort.steps)
        kept = self.judge.keep(tried)
        if not (kept & self.striker.land(tried, self.goals(len(tried))).hit).any():
            tried = np.vstack([tried, self.followed])
            kept = np.r_[kept, self.judge.keep(self.followed)]
        return tried[kept] if kept.any() else tried, effort.pool + len(past)

    def beyond(self, strikes: np.ndarray) -> np.ndarray:
        """Return the excess of strikes (B, m) over the limits, (B,), at most 10; see `Search.beyond`."""
        return np.minimum(self.striker.land(strikes, self.goals(len(strikes))).beyond, 10)

    def spare(self, rng: np.random.Generator, effort: PlanningEffort) -> np.ndarray:
        """Return the random strikes that pass the goal best, those within the limits first; see `Search.spare`."""
        strikes, cost, inside = self._drawn(rng, effort)
        return strikes[np.lexsort((cost, ~inside))[: effort.polished]]

    def starts(self, rng: np.random.Generator, effort: PlanningEffort) -> np.ndarray:
        """Return the drawn strikes whose tips pass the goal best with the belief's mean, (B, m); those beyond the
        limits are ranked by their cost plus the goal's `largest_cost`."""
        strikes, cost, inside = self._drawn(rng, effort)
        worst = cost + np.where(inside, 0.0, self.goal.largest_cost)
        return strikes[np.argsort(worst)[: effort.polished]]

    def _drawn(self, rng: np.random.Generator, effort: PlanningEffort) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Random strikes, of which half are the map's if one comes with the package for this arm, (B, m); how far their
        tips pass the goal with the belief's mean [m], (B,); and whether they are within the limits, (B,).

        The map's strikes keep the limits with another whip, and are fast. If the first joint rotates the whole arm
        about the vertical, every sample of a tip path is rotated to the goal's direction.
        """
        striker, goal = self.striker, self.goal
        known = self._known(effort.pool // 2)
        drawn = rng.uniform(striker.lower, striker.upper, (effort.pool - len(known), len(striker.lower)))
        pool = striker.admissible(np.vstack([known, drawn]))
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
        return ready, cost[rows, when], inside

    def _known(self, count: int) -> np.ndarray:
        """The strikes of the arm's map that come closest to the goal with the whip that the map is of, (B, m), at most
        so many."""
        if self.map is None:
            return np.empty((0, len(self.striker.lower)))
        answers = self.map.answers
        angle = self.front.angles(self.goal.positions)
        near = answers.shortlist(self.front.goals(self.goal, -angle), count)
        strikes = np.unique(answers.strikes[near], axis=0)  # many are there at several instants
        return self._wrapped(self.front.strikes(strikes, np.repeat(angle, len(strikes))))

    @cached_property
    def followed(self) -> np.ndarray:
        """The map's strikes that hit the goal, followed from the map's whip to the belief's mean, (B, m)."""
        if self.map is None:
            return np.empty((0, len(self.striker.lower)))
        hits = self._wrapped(_hits_of_map(self.map, self.target))[:_FOLLOWED]
        return continued(
            hits, self.map.striker.rollout.model.whip, self.rollout.model.whip, self.goal, self._striker_of
        )

    def _striker_of(self, whip: WhipParameters) -> Striker:
        """Simulator of the search's strikes with another whip."""
        rollout, striker = self.striker.rollout, self.striker
        changed = CompiledRollout(
            replace(rollout.model, whip=whip), rollout.controller, free=rollout.free, tolerance=rollout.tolerance
        )
        return Striker(changed, bounds=striker.bounds, limits=striker.limits.members, t_stay=striker.t_stay)

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

    def refined(self, starts: np.ndarray, steps: int) -> np.ndarray:
        """Return strikes (B, m) refined along derivatives until they hit with the belief's mean or improve no further.

        Strikes without finite and moderate derivatives are dropped, unless no strike has such derivatives: if the tip
        is at rest at its closest approach, its direction and the time of that approach are not differentiable.
        """
        slopes = self.striker.derivatives(starts, self.goals(len(starts)))
        size = np.abs(slopes).max(axis=(1, 2))
        sound = np.isfinite(size) & (size < STEEPEST)
        if not sound.any():
            return starts
        return refine(self.striker, self.goals(int(sound.sum())), starts[sound], slopes[sound], steps=steps).strikes

    def goals(self, count: int) -> Goals:
        """Return the goal, repeated for `count` strikes."""
        return self.goal.rows(np.zeros(count, int))


@lru_cache(maxsize=8)
def _hits_of_map(strike_map: StrikeMap, target: Target) -> np.ndarray:
    """Strikes that hit a target with the map's whip, (B, m), refined from the map's; kept for the next plan at the same
    target."""
    known = strike_map.candidates(target.goals)
    goals = target.goals.rows(np.zeros(len(known.strikes), int))
    found = refine(strike_map.striker, goals, known.strikes, known.slopes)
    return found.strikes[found.struck.hit]
