"""Striking at goals: many strikes, each at a goal of its own, and what is left between them."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from functools import cached_property

import numpy as np

from whiptool.goals import Goals
from whiptool.models.strike import T_STAY, StrikeBounds, default_bounds, shortened
from whiptool.objective import Limits
from whiptool.rollout.compiled import CompiledRollout
from whiptool.rollout.trajectory import Approach


@dataclass(frozen=True, eq=False)
class Struck:
    """How B strikes came to B goals.

    Args:
        residuals: What is left between strike and goal [m], (B, r), see `Goals.residuals`; NaN if it diverged.
        distance: Closest approach of the tip [m], (B,).
        angle: Between its velocity and the direction [rad], (B,); NaN where none is asked for.
        beyond: How far the strike is beyond the limits, (B,); <= 0: within.
        hit: Whether it hits, within the limits, (B,).
    """

    residuals: np.ndarray
    distance: np.ndarray
    angle: np.ndarray
    beyond: np.ndarray
    hit: np.ndarray

    @cached_property
    def cost(self) -> np.ndarray:
        """Norm of the residuals [m], (B,), larger by what is beyond the limits; infinite for one that diverged."""
        cost = np.linalg.norm(self.residuals, axis=1) + np.maximum(self.beyond, 0.0)
        return np.where(np.isfinite(cost), cost, np.inf)

    def take(self, which: np.ndarray) -> Struck:
        """Return some of them."""
        return Struck(*(getattr(self, f.name)[which] for f in fields(self)))

    def with_rows(self, rows: np.ndarray, others: Struck) -> Struck:
        """Return the same with others in some rows."""
        changed = {}
        for f in fields(self):
            column = getattr(self, f.name).copy()
            column[rows] = getattr(others, f.name)
            changed[f.name] = column
        return replace(self, **changed)


class Striker:
    """Rolls strikes out at goals, within a box and the arm's limits.

    Args:
        rollout: Simulator with derivatives.
        bounds: Box of the strikes; default: `default_bounds`.
        limits: Of the arm; None: it can do anything.
        t_stay: A strike is watched this long after the movement ended [s].
    """

    def __init__(
        self,
        rollout: CompiledRollout,
        *,
        bounds: StrikeBounds | None = None,
        limits: Limits | None = None,
        t_stay: float = T_STAY,
    ) -> None:
        self.rollout, self.limits, self.t_stay = rollout, limits, t_stay
        self.bounds = bounds or default_bounds(rollout.model.arm)
        self.lower, self.upper = self.bounds.box

    @property
    def widths(self) -> np.ndarray:
        """Of the box, (m,)."""
        return self.upper - self.lower

    def admissible(self, strikes: np.ndarray) -> np.ndarray:
        """Return strikes (B, m) put into the box, shortened where joints would be commanded beyond their speeds."""
        inside = np.clip(strikes, self.lower, self.upper)
        if self.limits is None or self.limits.speeds is None:
            return inside
        return np.clip(shortened(inside, self.limits.speeds), self.lower, self.upper)

    def inside(self, strikes: np.ndarray) -> np.ndarray:
        """Return whether strikes (B, m) lie in the box, (B,)."""
        return ((strikes >= self.lower) & (strikes <= self.upper)).all(axis=1)

    def within(self, strikes: np.ndarray) -> np.ndarray:
        """Return whether strikes (B, m) keep the limits and do not diverge, (B,)."""
        anywhere = np.zeros(self.rollout.model.dimension)
        near = self.rollout.approach(strikes, anywhere, t_stay=self.t_stay)
        return ~near.diverged if self.limits is None else self.limits.violation_of_peaks(near) <= 0

    def strike(self, strikes: np.ndarray, goals: Goals) -> Struck:
        """Return what strikes (B, m) come to, each at its goal."""
        near = self.rollout.approach(strikes, goals.positions, t_stay=self.t_stay)
        return self._struck(near, goals)

    def derivatives(self, strikes: np.ndarray, goals: Goals) -> np.ndarray:
        """Return the exact derivatives of the residuals by the strikes' numbers, (B, r, m)."""
        near, dtip, dvelocity = self.rollout.arrival_gradient(strikes, goals.positions, t_stay=self.t_stay)
        return goals.residual_slopes(near.velocity, dtip, dvelocity)

    def _struck(self, near: Approach, goals: Goals) -> Struck:
        limits = self.limits
        beyond = np.where(near.diverged, np.inf, 0.0) if limits is None else limits.violation_of_peaks(near)
        hit = (near.distance <= goals.hit_radius) & goals.arrives(near.velocity) & (beyond <= 0)
        return Struck(goals.residuals(near.tip, near.velocity), near.distance, goals.angle(near.velocity), beyond, hit)
