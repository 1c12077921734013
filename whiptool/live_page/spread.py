"""How far the tip strays from where it hits if the arm executes a strike with errors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from whiptool.goals.goals import Goals
from whiptool.strike_map.striker import Striker

STRIKES = 64  # with errors, of which the share of hits is counted
INSIDE = (0.5, 0.95)  # shares of the errors that the two ellipses contain


@dataclass(frozen=True, eq=False)
class TipSpread:
    """Errors of the tip at its closest approach to the target under normal errors of a strike's numbers.

    Args:
        centre: Position of the tip without errors [m], (d,).
        covariance: Covariance of its position, to first order [m^2], (d, d).
        hits: Share of hits among `STRIKES` strikes with errors.
    """

    centre: np.ndarray
    covariance: np.ndarray
    hits: float

    @property
    def axes(self) -> np.ndarray:
        """Half axes of the ellipse, or ellipsoid, of one standard deviation, one in each column [m], (d, d)."""
        values, vectors = np.linalg.eigh(self.covariance)
        return vectors * np.sqrt(np.maximum(values, 0.0))

    def scale(self, inside: float) -> float:
        """Return by how much the ellipse of one standard deviation grows to contain a share of the errors."""
        from scipy.stats import chi2

        return float(np.sqrt(chi2.ppf(inside, len(self.centre))))


def spread(striker: Striker, strike: np.ndarray, goal: Goals, noise: float, *, seed: int = 0) -> TipSpread:
    """Return the errors of the tip under errors of a strike's numbers.

    Args:
        striker: Simulator of strikes.
        strike: Strike vector, (m,).
        goal: Goal of the strike.
        noise: Standard deviation of each number of the strike [rad, m, s].
        seed: Seed of the strikes with errors.
    """
    near, slopes, _ = striker.rollout.arrival_gradient(strike[None], goal.positions[0], t_stay=striker.t_stay)
    errors = noise * np.random.default_rng(seed).standard_normal((STRIKES, len(strike)))
    tried = strike + errors
    tried[:, -1] = np.maximum(tried[:, -1], strike[-1] / 2)  # a duration stays positive
    landed = striker.rollout.approach(tried, goal.positions[0], t_stay=striker.t_stay)
    return TipSpread(near.tip[0], noise**2 * slopes[0] @ slopes[0].T, float(goal.hit_by(landed).mean()))
