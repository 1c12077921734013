"""Answers: strikes of which it is known where their tips pass, and how that changes with them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from whiptool.goals.goals import Goals


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

    def shortlist(self, goal: Goals, count: int) -> np.ndarray:
        """Return which passages leave least of one goal (B = 1), by the norm of its residuals, nearest first."""
        left = np.linalg.norm(goal.residuals(self.tips, self.velocities), axis=1)
        count = min(count, len(left))
        some = np.argpartition(left, count - 1)[:count]
        return some[np.argsort(left[some], kind="stable")]
