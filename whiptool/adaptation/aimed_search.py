"""Candidates of an arm in space: strikes that pass as asked, within a robot's limits, by derivatives.

A robot's limits and directions leave a thin part of the box of strikes, and derivatives find it: random strikes that
keep the limits, those whose tips pass the goal best on the mean of the belief, refined there along exact derivatives as
a strike map's are (`whiptool.strike_map.corrections`).
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np

from whiptool.adaptation.plan_search import PlanningEffort, Search
from whiptool.goals.goals import Goals
from whiptool.strike_map.corrections import refine
from whiptool.strike_map.turning import Front

RATE = 100.0  # [1/s] of the paths that are compared
STEEPEST = 1e3  # [m] by a number of a strike: no derivative of a closest approach that can be trusted


class AimedSearch(Search):
    """Search in space: the best of random strikes and past strikes are refined along derivatives."""

    spread = 0.02

    @cached_property
    def front(self) -> Front:
        """Rotation about the arm's first joint that brings a strike to the direction of the goal."""
        return Front(self.rollout.model)

    def candidates(
        self, rng: np.random.Generator, past: Sequence[Sequence[float]], effort: PlanningEffort
    ) -> tuple[np.ndarray, int]:
        """See `Search.candidates`."""
        starts = self.starts(rng, effort)
        if len(past):
            starts = np.vstack([np.array(past, float), starts])
        return self.refined(starts, effort.steps), effort.pool + len(past)

    def beyond(self, strikes: np.ndarray) -> np.ndarray:
        """Return the excess of strikes (B, m) over the limits, (B,), at most 10; see `Search.beyond`."""
        return np.minimum(self.striker.land(strikes, self.goals(len(strikes))).beyond, 10)

    def allows(self, strike: np.ndarray) -> bool:
        """See `Search.allows`; limits are judged over the whole strike."""
        return bool(self.striker.keep(strike[None])[0]) and super().allows(strike)

    def starts(self, rng: np.random.Generator, effort: PlanningEffort) -> np.ndarray:
        """Return the random strikes whose tips pass the goal best with the belief's mean, those within the limits
        first, (B, m).

        If the first joint rotates the whole arm about the vertical, every sample of a tip path is rotated to the goal's
        direction.
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
