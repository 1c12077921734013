"""Striking at goals: many strikes, each at its own goal, and their residuals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Literal

import numpy as np

from whiptool.errors import InputError
from whiptool.goals.goals import Goals
from whiptool.limits.all_limits import AllLimits, Limits, limits_given
from whiptool.limits.clearance import Clearance
from whiptool.models.strike import T_STAY, Strike, StrikeBounds, default_bounds
from whiptool.models.trajectory import Approach, Trajectory
from whiptool.rollout.compiled import CompiledRollout


@dataclass(frozen=True, eq=False)
class Landings:
    """Results of B strikes, each at its own goal.

    Args:
        residuals: Residuals between strike and goal [m], (B, r), see `Goals.residuals`; NaN if the strike diverged.
        distance: Miss distance of the tip [m], (B,).
        angle: Angle between the tip's velocity and the goal's direction [rad], (B,); NaN without direction.
        beyond: Excess of the strike over the limits, (B,); at most 0 within them.
        hit: Whether the strike hits and keeps the limits, (B,).
    """

    residuals: np.ndarray
    distance: np.ndarray
    angle: np.ndarray
    beyond: np.ndarray
    hit: np.ndarray

    @cached_property
    def cost(self) -> np.ndarray:
        """Norm of the residuals plus the excess over the limits [m], (B,); infinite for strikes that diverged."""
        cost = np.linalg.norm(self.residuals, axis=1) + np.maximum(self.beyond, 0.0)
        return np.where(np.isfinite(cost), cost, np.inf)

    def beats(self, others: Landings) -> np.ndarray:
        """Return whether each result is better than another: a hit instead of a miss, else a smaller cost, (B,)."""
        return np.where(self.hit == others.hit, self.cost < others.cost, self.hit)

    def take(self, which: np.ndarray) -> Landings:
        """Return a selection of the results."""
        return Landings(*(getattr(self, f.name)[which] for f in fields(self)))

    def with_rows(self, rows: np.ndarray, others: Landings) -> Landings:
        """Return the results with some rows replaced by others."""
        changed = {}
        for f in fields(self):
            column = getattr(self, f.name).copy()
            column[rows] = getattr(others, f.name)
            changed[f.name] = column
        return replace(self, **changed)


class Striker:
    """Simulates strikes, each at its own goal, within a box and the arm's limits.

    Args:
        rollout: Simulator with derivatives.
        bounds: Box of the strikes, which is reduced to the position limits; default: `default_bounds`.
        limits: One or several limits that strikes have to keep; default: those of the model's arm, see `Objective`;
            None: none.
        t_stay: Time after the movement's end for which the tip is still observed [s].

    Raises:
        InputError: The simulator's strikes are not in joint space.
    """

    def __init__(
        self,
        rollout: CompiledRollout,
        *,
        bounds: StrikeBounds | None = None,
        limits: Limits | Sequence[Limits] | Literal["default"] | None = "default",
        t_stay: float = T_STAY,
    ) -> None:
        if rollout.space.kind != "joint":
            raise InputError("space of strikes", rollout.space.kind, "joint, for a strike map")
        self.rollout, self.t_stay = rollout, t_stay
        self.limits = AllLimits(limits_given(limits, rollout.model, prescribed=rollout.prescribed))
        self.bounds = self.limits.narrowed(bounds or default_bounds(rollout.model.arm))
        self.lower, self.upper = self.bounds.box

    @property
    def widths(self) -> np.ndarray:
        """Widths of the box, (m,)."""
        return self.upper - self.lower

    def admissible(self, strikes: np.ndarray) -> np.ndarray:
        """Return strikes (B, m) clipped to the box, and shortened so that commanded paths keep their limits."""
        return self.limits.admissible(strikes, self.bounds)

    def inside(self, strikes: np.ndarray) -> np.ndarray:
        """Return whether strikes (B, m) lie in the box, (B,)."""
        return np.all((strikes >= self.lower) & (strikes <= self.upper), axis=1)

    def paths(self, strikes: np.ndarray, *, rate: float) -> tuple[np.ndarray, np.ndarray]:
        """Return whether strikes keep the limits as far as peak values and tip paths show, (B,), and their tip paths.

        Args:
            strikes: Strike vectors, (B, m).
            rate: Sampling rate [1/s].

        Returns:
            The paths are (B, S, d) [m], as in `tip_path`.
        """
        near, paths = self.rollout.peaks_and_path(strikes, t_stay=self.t_stay, rate=rate)
        lowest = np.min(paths[:, :, -1], axis=1, initial=np.inf, where=np.isfinite(paths[:, :, -1]))
        return (self._beyond(strikes, near) <= 0) & (lowest >= self._floor), paths

    def keep(self, strikes: np.ndarray) -> np.ndarray:
        """Return whether the whole trajectories of strikes (B, m) keep all limits, (B,)."""
        if not self.limits or not len(strikes):
            return np.ones(len(strikes), bool)
        played = zip(strikes, self.rollout.trajectories(strikes, t_stay=self.t_stay), strict=True)
        return np.array([self.limits.violation(path, Strike.from_vector(strike)) <= 0 for strike, path in played])

    def strike(self, strikes: np.ndarray, goals: Goals) -> Landings:
        """Simulate strikes (B, m), and return their results, each at its goal.

        Limits that need whole trajectories, such as distances, are only checked for strikes that would be hits.
        """
        return self.judged(strikes, self.land(strikes, goals))

    def land(self, strikes: np.ndarray, goals: Goals) -> Landings:
        """Return the results of strikes like `strike`, but with only those limits that follow from peak values."""
        near = self.rollout.approach(strikes, goals.positions, t_stay=self.t_stay)
        beyond = self._beyond(strikes, near)
        hit = goals.hit_by(near) & (beyond <= 0)
        return Landings(
            goals.residuals(near.tip, near.velocity), near.distance, goals.angle(near.velocity), beyond, hit
        )

    def judged(self, strikes: np.ndarray, landings: Landings) -> Landings:
        """Return the results of strikes (B, m) after checking, for hits, the limits that need whole trajectories."""
        rows = np.flatnonzero(landings.hit)
        if not self.limits.of_candidates or not len(rows):
            return landings
        beyond, hit = landings.beyond.copy(), landings.hit.copy()
        paths = self.rollout.trajectories(strikes[rows], t_stay=self.t_stay)
        beyond[rows] = [self.limits.violation(path) for path in paths]
        hit[rows] = beyond[rows] <= 0
        return replace(landings, beyond=beyond, hit=hit)

    def derivatives(self, strikes: np.ndarray, goals: Goals) -> np.ndarray:
        """Return the exact derivatives of the residuals by the strikes' coordinates, (B, r, m)."""
        near, dtip, dvelocity = self.rollout.arrival_gradient(strikes, goals.positions, t_stay=self.t_stay)
        return goals.residual_slopes(near.velocity, dtip, dvelocity)

    @property
    def _floor(self) -> float:
        """Below which no tip may be [m]; minus infinity where there is no floor."""
        floors = [x.floor for x in self.limits.members if isinstance(x, Clearance) and x.floor is not None]
        return max(floors, default=-np.inf)

    def _beyond(self, strikes: np.ndarray, near: Approach) -> np.ndarray:
        """Return how far strikes are beyond the limits, (B,); infinite where they diverged."""
        return np.where(near.diverged, np.inf, self.limits.violations(strikes, near, self._trajectory))

    def _trajectory(self, strike: np.ndarray) -> Trajectory:
        return self.rollout.trajectory(Strike.from_vector(strike), t_stay=self.t_stay)
