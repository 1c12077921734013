"""Answers: strikes of which it is known where their tips pass, and how that changes with them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from whiptool.goals.goals import Goals
from whiptool.models.strike import strike_names
from whiptool.progress import Progress
from whiptool.strike_map.striker import Striker

RATE = 500.0  # [1/s] at which paths are looked at: differences between samples are velocities to a part in a thousand
_AT_ONCE = 128  # strikes, whose derivatives along their whole paths are in memory together


@dataclass(frozen=True, eq=False)
class Answers:
    """Passages: K strikes, each with an instant at which its tip passes a place with a velocity, and derivatives.

    The derivatives are by the strike's m numbers and, in the last column, by the instant itself: a goal farther along
    the same path is answered by the same strike. Those of places are exact, those of velocities and by the instant are
    their differences along the path.

    Args:
        strikes: Vectors, (K, m).
        tips: Places of the tip at those instants [m], (K, d).
        velocities: Then [m/s], (K, d).
        tip_slopes: Derivatives of the place [m per unit], (K, d, m + 1).
        velocity_slopes: Derivatives of the velocity [m/s per unit], (K, d, m + 1).
    """

    strikes: np.ndarray
    tips: np.ndarray
    velocities: np.ndarray
    tip_slopes: np.ndarray
    velocity_slopes: np.ndarray

    def __len__(self) -> int:
        return len(self.strikes)

    def __repr__(self) -> str:
        return f"Answers({len(self)} passages)"

    def take(self, which: np.ndarray | slice) -> Answers:
        """Return some of them."""
        return Answers(*(getattr(self, f.name)[which] for f in fields(self)))

    @classmethod
    def none(cls, m: int, d: int) -> Answers:
        """Return no answers, of strikes of m numbers in d dimensions."""
        return cls(*map(np.empty, ((0, m), (0, d), (0, d), (0, d, m + 1), (0, d, m + 1))))

    @classmethod
    def joined(cls, parts: Sequence[Answers]) -> Answers:
        """Return all of several."""
        return cls(*(np.concatenate([getattr(part, f.name) for part in parts]) for f in fields(cls)))

    @classmethod
    def of_strikes(
        cls, striker: Striker, strikes: np.ndarray, which: np.ndarray, when: np.ndarray, *, progress: bool = False
    ) -> Answers:
        """Return the passages of strikes (S, m) at samples of their paths, `RATE` a second, as `paths_of` has them.

        Args:
            striker: Rolls out.
            strikes: Vectors, (S, m).
            which: Numbers of the strikes, (K,), in ascending order.
            when: Number of the sample, (K,), neither a path's first nor its last.
            progress: Show a bar.
        """
        names, d = strike_names(striker.rollout.model.arm), striker.rollout.model.dimension
        parts = [cls.none(strikes.shape[1], d)]
        for first in Progress(range(0, len(strikes), _AT_ONCE), desc="derivatives", disable=not progress, leave=False):
            here = (which >= first) & (which < first + _AT_ONCE)
            some, row, sample = strikes[first : first + _AT_ONCE], which[here] - first, when[here]
            _, paths, slopes = striker.rollout.tip_path(some, t_stay=striker.t_stay, rate=RATE, names=names)
            before, at, after = (paths[row, sample + step] for step in (-1, 0, 1))
            acceleration = (after - 2 * at + before) * RATE**2
            of_velocity = (slopes[row, sample + 1] - slopes[row, sample - 1]) * RATE / 2
            velocity = (after - before) * RATE / 2
            parts.append(
                cls(
                    some[row],
                    at,
                    velocity,
                    np.concatenate([slopes[row, sample], velocity[..., None]], axis=2),
                    np.concatenate([of_velocity, acceleration[..., None]], axis=2),
                )
            )
        return cls.joined(parts)

    def shortlist(self, goal: Goals, count: int) -> np.ndarray:
        """Return which passages leave least of one goal (B = 1), by the norm of its residuals, nearest first."""
        left = np.linalg.norm(goal.residuals(self.tips, self.velocities), axis=1)
        count = min(count, len(left))
        some = np.argpartition(left, count - 1)[:count]
        return some[np.argsort(left[some], kind="stable")]


def paths_of(striker: Striker, strikes: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return how the tips of strikes move, as far as they keep the limits that peaks tell of.

    Returns:
        Which strikes, their numbers (b,); along their paths tips [m] and velocities [m/s], (b, S, d) each, NaN before
        and after.
    """
    within, paths = striker.paths(strikes, rate=RATE)
    kept, paths = np.flatnonzero(within), paths[within]
    velocities = np.full_like(paths, np.nan)
    velocities[:, 1:-1] = (paths[:, 2:] - paths[:, :-2]) * RATE / 2
    return kept, paths, velocities
