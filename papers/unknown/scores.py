"""Scores of stated probabilities and of predicted misses, against what came."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

BINS = 5  # of stated probabilities


@dataclass(frozen=True)
class Forecast:
    """What was stated about one strike beforehand, and what came.

    Args:
        probability: Stated hit probability.
        misses: Predictive sample of the miss distance [m]; None for a sample that diverges.
        miss: True miss distance [m]; None: there was none.
        hit: Whether it hit.
    """

    probability: float
    misses: Sequence[float | None]
    miss: float | None
    hit: bool


@dataclass(frozen=True)
class Scores:
    """Proper scores of probabilities (Gneiting and Raftery 2007), and how often predicted misses were kept.

    Args:
        count: Strikes.
        hits: Share that hit.
        brier, log: Mean square error of the stated probability, and mean negative logarithm of what was stated of that
            which came; smaller is better.
        brier_constant, log_constant: The same of the best constant forecast, which is the share of hits, known
            afterwards.
        within: Share of true misses up to the 50 % and the 90 % quantile of the predictive sample.
        beyond: Share of true misses beyond all of the sample; of a sample of n, 1 / (n + 1) is to be expected.
    """

    count: int
    hits: float
    brier: float
    brier_constant: float
    log: float
    log_constant: float
    within: tuple[float, float]
    beyond: float

    @classmethod
    def of(cls, forecasts: Sequence[Forecast]) -> Scores:
        """Of any number of strikes, at least one."""
        stated = np.array([f.probability for f in forecasts])
        hit = np.array([f.hit for f in forecasts])
        share = float(hit.mean())
        ranks = np.array([_rank(f) for f in forecasts])
        return cls(
            count=len(forecasts),
            hits=share,
            brier=brier_score(stated, hit),
            brier_constant=brier_score(np.full(len(hit), share), hit),
            log=log_score(stated, hit),
            log_constant=log_score(np.full(len(hit), share), hit),
            within=(float(np.mean(ranks <= 0.5)), float(np.mean(ranks <= 0.9))),
            beyond=float(np.mean(ranks >= 1)),
        )


def brier_score(stated: np.ndarray, came: np.ndarray) -> float:
    """Return the mean of `(stated - came)^2`; both (T,)."""
    return float(np.mean((stated - came) ** 2))


def log_score(stated: np.ndarray, came: np.ndarray) -> float:
    """Return the mean of `-log` of the probability that was stated of what came; infinite where that was 0."""
    of_what_came = np.where(came, stated, 1 - stated)
    with np.errstate(divide="ignore"):
        return float(-np.mean(np.log(of_what_came)))


def reliability(stated: np.ndarray, came: np.ndarray) -> float:
    """Return the expected calibration error of stated probabilities, (T,), against what came, (T,), in `BINS` bins."""
    which = np.minimum((stated * BINS).astype(int), BINS - 1)
    inside = [which == i for i in range(BINS) if (which == i).any()]
    return float(sum(abs(stated[x].mean() - came[x].mean()) * x.mean() for x in inside))


def _rank(forecast: Forecast) -> float:
    """Share of the predictive sample below the true miss."""
    sample = np.array([np.inf if x is None else x for x in forecast.misses])
    miss = np.inf if forecast.miss is None else forecast.miss
    return float(np.mean(sample < miss))
