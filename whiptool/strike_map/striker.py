"""Simulation of strikes at goals within bounds and limits, and their refinement until they hit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Literal

import numpy as np

from whiptool.errors import InputError
from whiptool.goals.goals import Goals
from whiptool.limits.all_limits import AllLimits, limits_given
from whiptool.limits.limits import Limits
from whiptool.models.strike import T_STAY, Strike, StrikeBounds, default_bounds
from whiptool.models.trajectory import Approach, Trajectory
from whiptool.rollout.compiled import CompiledRollout


@dataclass(frozen=True, eq=False)
class Landings:
    """Results of B strikes, each at its own goal."""

    residuals: np.ndarray  # between strike and goal, see `Goals.residuals` [m], (B, r); NaN if the strike diverged
    distance: np.ndarray  # miss distance of the tip [m], (B,)
    angle: np.ndarray  # between the tip's velocity and the goal's direction [rad], (B,); NaN without direction
    beyond: np.ndarray  # excess of the strike over the limits, (B,); at most 0 within them
    hit: np.ndarray  # whether the strike hits and keeps the limits, (B,)

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
        """Return the results with the rows `rows` replaced by `others`."""
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
        """Widths of the box of strikes along its m coordinates [rad or m, s], (m,)."""
        return self.upper - self.lower

    def admissible(self, strikes: np.ndarray) -> np.ndarray:
        """Return strikes (B, m) clipped to the box, and shortened so that commanded paths keep their limits."""
        return self.limits.admissible(strikes, self.bounds)

    def inside(self, strikes: np.ndarray) -> np.ndarray:
        """Return whether strikes (B, m) lie in the box, (B,)."""
        return np.all((strikes >= self.lower) & (strikes <= self.upper), axis=1)

    def paths(self, strikes: np.ndarray, *, rate: float) -> tuple[np.ndarray, np.ndarray]:
        """Return whether strikes (B, m) are worth asking `keep` about, by their peak values and tip paths, (B,), and
        the tip paths, sampled at a rate [1/s], (B, S, d) [m]. False rules a strike out, True does not yet allow it.
        """
        near, paths = self.rollout.peaks_and_path(strikes, t_stay=self.t_stay, rate=rate)
        lowest = np.min(paths[:, :, -1], axis=1, initial=np.inf, where=np.isfinite(paths[:, :, -1]))
        return (self._beyond(strikes, near) <= 0) & (lowest >= self.limits.floor), paths

    def keep(self, strikes: np.ndarray) -> np.ndarray:
        """Return whether strikes (B, m) may be made: whether their whole trajectories keep all limits, (B,)."""
        if not self.limits or not len(strikes):
            return np.ones(len(strikes), bool)
        played = zip(strikes, self.rollout.trajectories(strikes, t_stay=self.t_stay), strict=True)
        return np.array([self.limits.violation(path, Strike.from_vector(strike)) <= 0 for strike, path in played])

    def strike(self, strikes: np.ndarray, goals: Goals) -> Landings:
        """Simulate strikes (B, m), and return the result of each at its goal.

        Limits that need whole trajectories, such as distances, are only checked for strikes that would be hits.
        """
        return self.judged(strikes, self.land(strikes, goals))

    def land(self, strikes: np.ndarray, goals: Goals) -> Landings:
        """Return the results of strikes as `strike` does, but check only the limits that follow from peak values."""
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

    def _beyond(self, strikes: np.ndarray, near: Approach) -> np.ndarray:
        """Return how far strikes are beyond the limits that peak values show, (B,); infinite where they diverged."""
        beyond, _ = self.limits.judged(strikes, near, self._trajectory, candidates=())
        return np.where(near.diverged, np.inf, beyond)

    def _trajectory(self, strike: np.ndarray) -> Trajectory:
        return self.rollout.trajectory(Strike.from_vector(strike), t_stay=self.t_stay)


TOLERANCE = 1e-4  # [m]: a smaller cost is not refined any more
STEPS = 30  # rollouts of each strike at most, those for derivatives apart
_DAMPING = 1e-3  # [m], of the first step
_LEAST = 1e-5  # [m]
_BETTER = 0.7  # of the cost is left after a step, or less: else the step stalled
_STALLED = 3  # steps in a row that stalled, after which derivatives are taken again
_DERIVATIVES = 3  # times that a strike's derivatives are taken at most
_ROUNDS = 20  # in which numbers that leave the box are put on its side, or let off it


def correct(
    residuals: np.ndarray,
    slopes: np.ndarray,
    room: tuple[np.ndarray, np.ndarray],
    widths: np.ndarray,
    *,
    damping: float | np.ndarray = 1e-4,
) -> tuple[np.ndarray, np.ndarray]:
    """Return the damped least-squares change of B strikes within bounds (Levenberg 1944, Marquardt 1963), (B, m), and
    the norm of the remaining residuals to first order [m], (B,).

    The change x of the residuals r (B, r) [m] with the slopes J (B, r, m) minimises |r + J x|^2 + damping^2 |x /
    widths|^2, with a damping [m] for all strikes or for each; coordinates that would leave the bounds, least and
    largest change (B, m), stay on them (an active-set method: Stark and Parker 1995).
    """
    B, r, m = slopes.shape
    low, high = (np.broadcast_to(side, (B, m)) / widths for side in room)
    J = slopes * widths
    held = np.zeros((B, m), bool)
    x = np.zeros((B, m))
    ridge = np.broadcast_to(np.square(damping), (B,))[:, None, None]
    for _ in range(_ROUNDS):
        free = np.where(held[:, None, :], 0.0, J)
        rest = residuals + np.einsum("brm,bm->br", J, np.where(held, x, 0.0))
        dual = _solved(free @ free.swapaxes(1, 2) + ridge * np.eye(r), rest)
        x = np.where(held, x, -np.einsum("brm,br->bm", free, dual))
        out = (x < low) | (x > high)
        x = np.clip(x, low, high)
        downhill = -np.einsum("brm,br->bm", J, residuals + np.einsum("brm,bm->br", J, x)) - ridge[:, 0] * x
        inward = held & (((x == low) & (downhill > 0)) | ((x == high) & (downhill < 0)))
        settled = ~out.any(axis=1, keepdims=True)  # only then is it known which sides hold nothing back
        if settled.all() and not inward.any():
            break
        strongest = np.argmax(np.where(inward, np.abs(downhill), 0.0), axis=1)
        released = inward & settled & (np.arange(m) == strongest[:, None])  # singly: else they alternate
        held = (held | out) & ~released
    left = np.linalg.norm(residuals + np.einsum("brm,bm->br", J, x), axis=1)
    return x * widths, left


def _solved(A: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the solutions (B, r) of A x = b, A (B, r, r) symmetric; where a slope is beyond all bounds, those of least
    norm: the damping is then lost in rounding errors."""
    try:
        return np.linalg.solve(A, b[..., None])[..., 0]
    except np.linalg.LinAlgError:
        return np.einsum("brs,bs->br", np.linalg.pinv(A, hermitian=True), b)


@dataclass(frozen=True, eq=False)
class Refined:
    """Result of the refinement of B strikes."""

    strikes: np.ndarray  # best strike for each goal, (B, m)
    struck: Landings  # outcomes of the strikes
    rollouts: int  # simulated strikes in all, without those for derivatives
    derivatives: int  # derivatives of strikes that were computed

    def improved(self, rows: np.ndarray, others: Refined) -> Refined:
        """Return the result with the rows `rows` replaced by those of `others` that are better."""
        better = others.struck.beats(self.struck.take(rows))
        strikes = self.strikes.copy()
        strikes[rows[better]] = others.strikes[better]
        return Refined(
            strikes,
            self.struck.with_rows(rows[better], others.struck.take(better)),
            self.rollouts + others.rollouts,
            self.derivatives + others.derivatives,
        )


def refine(
    striker: Striker, goals: Goals, strikes: np.ndarray, slopes: np.ndarray | None = None, *, steps: int = STEPS
) -> Refined:
    """Correct strikes (B, m), each for its own goal, in at most `steps` steps until they hit with costs below
    `TOLERANCE`, or improve no further.

    Steps are damped (Levenberg 1944, Marquardt 1963), with derivatives updated by Broyden's method (1965): one
    simulation per step. They start from `slopes` (B, r, m), if given. If steps stall, exact derivatives are computed,
    at the cost of dozens of simulations. Limits that need whole trajectories are only checked at the end.
    """
    state = _Refinement(striker, goals, strikes, slopes)
    for _ in range(steps):
        rows = np.flatnonzero(state.unfinished())
        if not len(rows):
            break
        state.step(rows)
        stalled = state.unfinished() & (state.stalled >= _STALLED)
        state.take_derivatives(np.flatnonzero(stalled))
    struck = striker.judged(state.strikes, state.struck)
    return Refined(state.strikes, struck, state.rollouts, int(state.taken.sum()))


def finished(struck: Landings) -> np.ndarray:
    """Return whether strikes hit with a cost below `TOLERANCE`, so that they are not corrected further, (B,)."""
    return struck.hit & (struck.cost <= TOLERANCE)


class _Refinement:
    """The state of a refinement: strikes, what they come to, derivatives, damping."""

    def __init__(self, striker: Striker, goals: Goals, strikes: np.ndarray, slopes: np.ndarray | None) -> None:
        B, m = strikes.shape
        self.striker, self.goals = striker, goals
        self.strikes = striker.admissible(strikes)
        self.struck = striker.land(self.strikes, goals)
        self.rollouts, self.taken = B, np.zeros(B, int)
        self.damping, self.stalled = np.full(B, _DAMPING), np.zeros(B, int)
        self.slopes = np.zeros((B, self.struck.residuals.shape[1], m)) if slopes is None else slopes.copy()
        if slopes is None:
            self.take_derivatives(np.arange(B))

    def unfinished(self) -> np.ndarray:
        """Whether each strike is still to be corrected, (B,)."""
        given_up = (self.stalled >= _STALLED) & (self.taken >= _DERIVATIVES)
        return ~finished(self.struck) & np.isfinite(self.struck.cost) & ~given_up

    def step(self, rows: np.ndarray) -> None:
        """Correct some strikes once, and keep those that come out better."""
        striker, old, before = self.striker, self.strikes[rows], self.struck.take(rows)
        room = striker.lower - old, striker.upper - old
        damping = self.damping[rows]
        change, _ = correct(before.residuals, self.slopes[rows], room, striker.widths, damping=damping)
        new = striker.admissible(old + change)
        after = striker.land(new, self.goals.rows(rows))
        self.rollouts += len(rows)
        self._mend(rows, new - old, after.residuals - before.residuals)
        better = after.beats(before)
        self.strikes[rows[better]] = new[better]
        self.struck = self.struck.with_rows(rows[better], after.take(better))
        self.damping[rows] = np.where(better, np.maximum(damping / 4, _LEAST), damping * 8)
        self.stalled[rows] = np.where(after.cost < _BETTER * before.cost, 0, self.stalled[rows] + 1)

    def take_derivatives(self, rows: np.ndarray) -> None:
        """Take the exact derivatives of some strikes."""
        if not len(rows):
            return
        self.slopes[rows] = self.striker.derivatives(self.strikes[rows], self.goals.rows(rows))
        self.taken[rows] += 1
        self.stalled[rows], self.damping[rows] = 0, _DAMPING

    def _mend(self, rows: np.ndarray, change: np.ndarray, difference: np.ndarray) -> None:
        """Change derivatives least, so that they explain a step's difference of residuals (Broyden 1965)."""
        scaled = change / self.striker.widths**2
        length = np.einsum("bm,bm->b", change, scaled)
        known = np.isfinite(difference).all(axis=1) & (length > 0)
        some = rows[known]
        missing = difference[known] - np.einsum("brm,bm->br", self.slopes[some], change[known])
        self.slopes[some] += missing[:, :, None] * (scaled[known] / length[known, None])[:, None, :]
