"""Weighted samples of the posterior of a whip's parameters, for uses in which the normal distribution is not accurate.

A belief is a normal distribution linearised at the most probable whip. The intervals of single parameters are then
about right, but their joint region is too small, because correlated parameters lie along curves and some parameters
cannot be negative. `benchmarks/posterior.py` measures both.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import cast

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import brentq
from scipy.special import logsumexp
from scipy.stats import multivariate_t

from whiptool.adaptation.posterior import driven_by, usable
from whiptool.adaptation.prior import Belief, Learned
from whiptool.errors import InputError
from whiptool.identification.predict import Predictor
from whiptool.recording.strike_recording import StrikeRecording

ROUNDS, SIZE = 5, 240  # proposals, and draws of each
_TAILS = 6.0  # degrees of freedom of a proposal
_ENOUGH = 3.0  # effective draws per number, of which the next proposal's moments are taken


@dataclass(frozen=True, eq=False)  # arrays have no single truth value to compare by
class PosteriorSample:
    """S weighted draws of m parameters from a posterior."""

    names: tuple[str, ...]  # of the parameters, as in the belief
    z: np.ndarray  # draws in the solver's variables (see `Belief`), (S, m)
    values: np.ndarray  # the same draws in the parameters' own units, (S, m)
    weights: np.ndarray  # of the draws, which sum to 1, (S,)
    log_density: np.ndarray  # of the posterior at the draws, up to a constant, (S,)

    @property
    def effective(self) -> float:
        """Effective number of independent draws (Kong 1992)."""
        return effective_size(np.log(np.maximum(self.weights, 1e-300)))

    def interval(self, name: str, level: float = 0.95) -> tuple[float, float]:
        """Return the equal-tailed credible interval of the parameter `name`, in its own unit."""
        if name not in self.names:
            raise InputError("parameter", name, "one of " + ", ".join(self.names))
        column = self.values[:, self.names.index(name)]
        order = np.argsort(column)
        below = np.cumsum(self.weights[order]) - self.weights[order] / 2
        low, high = np.interp([(1 - level) / 2, (1 + level) / 2], below, column[order])
        return float(low), float(high)

    def level_of(self, log_density: float) -> float:
        """Return the probability of the smallest highest-density region that contains a point with this log density."""
        return float(self.weights[self.log_density > log_density].sum())


def sample_posterior(
    prior: Belief,
    recordings: Sequence[StrikeRecording],
    learned: Learned,
    *,
    rng: np.random.Generator,
    contacts: Mapping[str, float] | None = None,
    rounds: int = ROUNDS,
    size: int = SIZE,
) -> PosteriorSample:
    """Sample the posterior of the whip's parameters by `importance_sample` with the compiled simulator, from recordings
    that `update` used; `learned` is its result.
    """
    used = [r for r in recordings if r.source in learned.rmse]
    density = log_posterior(prior, used, learned.redundancy, contacts=contacts)
    belief = learned.belief
    z, weights, log_density = importance_sample(density, belief.z, belief.covariance, rng=rng, rounds=rounds, size=size)
    values = np.array([list(belief.values(x).values()) for x in z])
    return PosteriorSample(belief.names, z, values, weights, log_density)


def log_posterior(
    prior: Belief,
    recordings: Sequence[StrikeRecording],
    redundancy: float,
    *,
    contacts: Mapping[str, float] | None = None,
) -> Callable[[np.ndarray], np.ndarray]:
    """Return the logarithm of the posterior density of the parameters, up to a constant, as a function of draws (S, m);
    it is minus infinity where a parameter is out of its bounds. `redundancy` readings carry as much information as one
    independent reading.
    """
    planned = contacts or {}
    cuts = [usable(recording, planned.get(recording.source))[0] for recording in recordings]
    used = [cut for cut in cuts if cut is not None]
    if not used:
        raise InputError("recordings", "none that is used", "one or more")
    of_plant = tuple(name for name in prior.names if name != "delay")
    predictor = Predictor(used, prior.plant, drive=driven_by(prior.plant, used), shared=of_plant)
    lower, upper = (np.array([getattr(v, end) for v in prior.variables]) for end in ("lower", "upper"))
    whitening = np.linalg.inv(np.linalg.cholesky(prior.covariance))

    def density(z: np.ndarray) -> np.ndarray:
        log, inside = np.full(len(z), -np.inf), ((z >= lower) & (z <= upper)).all(axis=1)
        log[inside] = -0.5 * (((z[inside] - prior.z) @ whitening.T) ** 2).sum(axis=1)
        plants = [prior.at(x) for x in z[inside]]
        delays = [prior.values(x).get("delay", 0.0) for x in z[inside]]
        for i in range(len(used)):
            off = (predictor.many(i, plants, delays) - predictor.measured[i]) / predictor.sigma[i]
            misfit = (off**2).sum(axis=1)
            log[inside] -= 0.5 / redundancy * np.where(np.isfinite(misfit), misfit, np.inf)
        return log

    return density


def importance_sample(
    log_density: Callable[[np.ndarray], np.ndarray],
    centre: np.ndarray,
    covariance: np.ndarray,
    *,
    rng: np.random.Generator,
    rounds: int = ROUNDS,
    size: int = SIZE,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Sample a density by adaptive multiple importance sampling (Cornuet, Marin, Mira and Robert 2012, Scand. J. Stat.
    39), and return draws (S, m), their weights (S,), which sum to 1, and their log densities (S,).

    Each of `rounds` proposals draws `size` times from a Student's t with the moments of all draws so far, the first
    with a given centre (m,) and covariance (m, m), and weights all draws by the mixture of all proposals. While few
    draws carry most of the weight, the log weights are tempered before the moments are computed, and the covariance is
    mixed with the first one.
    """
    m, first = len(centre), covariance
    proposals, draws, log = [], np.zeros((0, m)), np.zeros(0)
    log_weights = np.zeros(0)
    for _ in range(rounds):
        proposals.append(multivariate_t(centre, covariance * (_TAILS - 2) / _TAILS, df=_TAILS, seed=rng))
        new = proposals[-1].rvs(size).reshape(size, m)
        draws, log = np.vstack([draws, new]), np.concatenate([log, log_density(new)])
        mixture = _log_sum([p.logpdf(draws) for p in proposals], axis=0) - np.log(len(proposals))
        log_weights = log - mixture
        if not np.isfinite(log_weights).any():
            raise InputError("posterior", "a density of zero at all draws", "draws with a density above zero")
        weights = _tempered(log_weights, _ENOUGH * m)
        centre = weights @ draws
        off = draws - centre
        share = min(1.0, 1 / float(weights @ weights) / (2 * _ENOUGH * m))
        covariance = share * (off.T * weights) @ off + (1 - share) * first
    return draws, np.exp(log_weights - _log_sum(log_weights)), log


def effective_size(log_weights: np.ndarray) -> float:
    """Return the effective sample size of log weights (S,) (Kong 1992)."""
    return float(np.exp(2 * _log_sum(log_weights) - _log_sum(2 * log_weights)))


def _tempered(log_weights: np.ndarray, enough: float) -> np.ndarray:
    """Weights to the highest power up to 1 at which enough of them count."""

    def lacking(power: float) -> float:
        return effective_size(power * log_weights) - enough

    power = 1.0
    if lacking(1.0) < 0 and np.isfinite(log_weights).sum() > enough:
        power = cast(float, brentq(lacking, 1e-9, 1.0))
    return np.exp(power * log_weights - _log_sum(power * log_weights))


def _log_sum(values: ArrayLike, axis: int | None = None) -> np.ndarray:
    return np.asarray(logsumexp(values, axis=axis))
