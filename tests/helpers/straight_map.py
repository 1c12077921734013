"""A striker whose tip flies straight, at a speed that the strike chooses: a map's rules in closed form."""

from __future__ import annotations

import numpy as np

from whiptool.goals.goals import Goals
from whiptool.models.strike import StrikeBounds
from whiptool.strike_map.striker import Landings

BOUNDS = StrikeBounds((-1.0, -1.0, -1.0, -1.0, 0.4), (1.0, 1.0, 1.0, 1.0, 1.0))


class CurvedStriker:
    """Strikes whose residuals are smooth functions of them, in closed form; the goals do not matter.

    Args:
        curvature: How far they are from linear; 0: they are linear.
    """

    def __init__(self, curvature: float) -> None:
        rng = np.random.default_rng(3)
        self.linear, self.curvature = rng.normal(size=(3, 5)), curvature
        self.centre = np.array([0.1, -0.2, 0.3, 0.1, 0.7])
        self.lower, self.upper = BOUNDS.box
        self.rolled, self.taken = 0, 0

    @property
    def widths(self) -> np.ndarray:
        """Of the box."""
        return self.upper - self.lower

    def admissible(self, strikes: np.ndarray) -> np.ndarray:
        """Strikes in the box."""
        return np.clip(strikes, self.lower, self.upper)

    def residuals(self, strikes: np.ndarray) -> np.ndarray:
        """Zero at the centre, (B, 3)."""
        away = (strikes - self.centre) @ self.linear.T
        return away + self.curvature * away**2

    def judged(self, strikes: np.ndarray, landings: Landings) -> Landings:
        """The landings: nothing is judged of whole strikes."""
        return landings

    def land(self, strikes: np.ndarray, goals: Goals) -> Landings:
        """What the strikes come to."""
        self.rolled += len(strikes)
        left = self.residuals(strikes)
        distance = np.linalg.norm(left, axis=1)
        nothing = np.zeros(len(strikes))
        return Landings(left, distance, nothing, nothing, distance <= goals.hit_radius)

    def derivatives(self, strikes: np.ndarray, goals: Goals) -> np.ndarray:
        """Exact derivatives of the residuals."""
        self.taken += len(strikes)
        away = (strikes - self.centre) @ self.linear.T
        return (1 + 2 * self.curvature * away)[:, :, None] * self.linear
