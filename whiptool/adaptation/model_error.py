"""Distance between the true and the predicted path of the tip: Student's t, with a scale estimated from residuals.

The model cannot represent every whip (a bead, a soft joint, an unusual taper), so that the tip of the true whip passes
a target at another distance than that of the best-fitting whip. This error differs between whips by more than a factor
of ten. Its variance is therefore unknown, too: with a scaled inverse chi-squared prior the posterior has the same form,
and the error itself follows Student's t (Gelman et al., Bayesian Data Analysis, 3rd edition, Sect. 2.6 and 3.2).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from whiptool.goals.goals import Goals
from whiptool.models.numbers import number


@dataclass(frozen=True)
class ModelError:
    """Student's t distribution of the signed distance from the predicted to the true path of the tip at the target."""

    scale: float = 0.0  # [m]
    freedom: float = np.inf  # degrees of freedom; infinite: a normal distribution with standard deviation `scale`

    def __post_init__(self) -> None:
        number("scale of the model error", self.scale, low=0)
        if self.freedom != np.inf:
            number("degrees of freedom of the model error", self.freedom, low=0, strict=True)

    def updated(self, variance: float, readings: float, strikes: float) -> ModelError:
        """Return the distribution after errors of mean square `variance` [m^2] were observed in a number of strikes.

        The scale is updated as by `readings` independent readings; 0 leaves the distribution unchanged. The residuals
        of one strike only show the model error of that strike, so each strike adds one degree of freedom.
        """
        if self.freedom == np.inf or readings == 0:
            return self
        prior, seen = self.freedom * self.scale**2, readings * variance
        return ModelError(float(np.sqrt((prior + seen) / (self.freedom + readings))), self.freedom + strikes)

    def hit_probability(
        self, goal: Goals, miss: np.ndarray, velocity: np.ndarray | None, *, blur: float = 0.0
    ) -> np.ndarray:
        """Return the probability that strikes of predicted miss distances [m], any shape, hit a single goal; the tip's
        velocity at its closest approach [m/s], (..., d), may be unknown, see `Goals.hit_probability`.

        The length `blur` [m] is added in quadrature to the scale of the model error. Searches need a positive length:
        with a scale near 0 the probability is 0 or 1, and strikes cannot be ranked.
        """
        scale = max(float(np.hypot(self.scale, blur)), 1e-12)
        return goal.hit_probability(miss, velocity, scale, self.freedom)

    def drawn(self, miss: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """Return miss distances [m] of the shape of `miss`, with a random model error added to each."""
        draws = rng.standard_normal(np.shape(miss))
        if self.freedom != np.inf:
            draws = rng.standard_t(self.freedom, np.shape(miss))
        return np.abs(miss + self.scale * draws)


NONE = ModelError()
