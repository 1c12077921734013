"""Answers: strikes of which it is known where their tips pass, and how that changes with them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from whiptool.goals.goals import Goals


@dataclass(frozen=True, eq=False)
class Answers:
    """K entries of a strike map, each a strike and an instant of it, with position, velocity and derivatives of the
    tip.

    Derivatives are by the strike's m coordinates and, in the last column, by the instant, because the same strike also
    reaches goals farther along its path. Those of positions are exact; those of velocities and by the instant are
    finite differences along the path.

    Args:
        strikes: Strike vectors, (K, m).
        tips: Positions of the tip at the instants [m], (K, d).
        velocities: Velocities of the tip at the instants [m/s], (K, d).
        tip_slopes: Derivatives of the position [m per unit], (K, d, m + 1).
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
        """Return a selection of the entries."""
        return Answers(*(getattr(self, f.name)[which] for f in fields(self)))

    @classmethod
    def none(cls, m: int, d: int) -> Answers:
        """Return zero entries, for strikes with m coordinates in d dimensions."""
        return cls(*map(np.empty, ((0, m), (0, d), (0, d), (0, d, m + 1), (0, d, m + 1))))

    @classmethod
    def joined(cls, parts: Sequence[Answers]) -> Answers:
        """Return several sets of entries as one."""
        return cls(*(np.concatenate([getattr(part, f.name) for part in parts]) for f in fields(cls)))

    def shortlist(self, goal: Goals, count: int) -> np.ndarray:
        """Return the indices of the entries that come closest to one goal (B = 1), (count,).

        The closest is the first; closeness is the norm of the goal's residuals for the tip's position and velocity.
        There are fewer indices if the map has fewer entries.
        """
        left = np.linalg.norm(goal.residuals(self.tips, self.velocities), axis=1)
        count = min(count, len(left))
        some = np.argpartition(left, count - 1)[:count]
        return some[np.argsort(left[some], kind="stable")]
