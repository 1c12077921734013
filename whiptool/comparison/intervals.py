"""Intervals of mean trials over few seeds and many targets, each seed striking at the same targets.

A mean over S seeds and T targets errs because other seeds would have given other means, and because other targets
would have been easier or harder:

    variance of the mean = (variance between seeds' means) / S + (variance between targets beyond that of chance) / T

Each part is estimated by its mean square, so that it has Student's t with its own degrees of freedom, S - 1 and T - 1,
and the half-widths of the parts add as squares. Whatever the parts' ratio, such an interval covers at least as often as
it says, and exactly where one part is all (Banerjee 1960, Sankhya 22, 357): with three seeds between 95.0 and 97.7 %
of the time. Two methods have independent seeds (Welch's degrees of freedom) and the same targets (paired).

Means are taken on a logarithmic scale, on which seeds scatter more evenly; `benchmarks/interval_coverage.py` measures
what the intervals cover.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.special import stdtrit

LEVEL = 0.95


def mean_interval(trials: np.ndarray, *, cap: float = np.inf) -> tuple[float, float]:
    """Return the 95 % confidence interval of the mean number of trials to the first hit.

    It is symmetric in the logarithm of the mean number of misses before the hit (mean - 1). With one seed it is the
    interval of the mean over targets for that seed. If every target was hit at the first trial, it has zero width.

    Args:
        trials: Trials to the first hit, S seeds by T targets, (S, T).
        cap: Largest number of trials at a target, an upper bound of the mean.

    Returns:
        Lower and upper end; 1 and `cap` if there is only one target.
    """
    if trials.shape[1] == 1:
        return 1.0, float(cap)
    misses = float(trials.mean()) - 1
    if misses <= 0:
        return 1.0, 1.0
    with np.errstate(over="ignore"):
        factor = float(np.exp(_half_width([trials / misses])))
    return 1 + misses / factor, min(1 + misses * factor, float(cap))


def ratio_interval(one: np.ndarray, other: np.ndarray) -> tuple[float, float]:
    """Return the 95 % interval of the ratio by which two methods are compared at the same targets.

    It is the ratio of their mean numbers of misses before the hit, which separates means near 1 trial; if a mean is at
    most 1, the ratio of their mean trials.

    Args:
        one, other: Trials to the first hit of the two methods, seeds by targets, (S, T) and (S', T).

    Returns:
        Lower and upper end; 0 and infinity if there is only one target.
    """
    if one.shape[1] == 1:
        return 0.0, np.inf
    missed = 1 if min(one.mean(), other.mean()) > 1 else 0
    means = float(one.mean()) - missed, float(other.mean()) - missed
    with np.errstate(over="ignore"):
        factor = float(np.exp(_half_width([one / means[0], other / means[1]])))
    return means[0] / means[1] / factor, means[0] / means[1] * factor


def needs_fewer(one: np.ndarray, other: np.ndarray, *, share: float = 1.0) -> bool:
    """Whether `one` needs significantly (95 %) fewer trials than `share` times those of `other`.

    Args:
        one, other: As in `ratio_interval`.
        share: Fraction of the other's mean number of trials.
    """
    return ratio_interval(one, share * other)[1] < 1


def _half_width(groups: Sequence[np.ndarray]) -> float:
    """Of the 95 % interval of a group's mean, or of the difference of two groups' means; groups (S, T), (S', T)."""
    seeds, chance = zip(*(_seed_part(group) for group in groups), strict=True)
    between = groups[0].mean(axis=0) - (groups[1].mean(axis=0) if len(groups) > 1 else 0.0)  # (T,)
    T = len(between)
    targets = max(float(between.var(ddof=1)) - sum(chance), 0.0) / T
    known = [(part, len(group) - 1) for part, group in zip(seeds, groups, strict=True) if part > 0]
    total = sum(part for part, _ in known)
    freedom = total**2 / sum(part**2 / df for part, df in known) if known else 1.0  # Welch (1947)
    return float(np.sqrt(_quantile(freedom) ** 2 * total + _quantile(T - 1) ** 2 * targets))


def _seed_part(group: np.ndarray) -> tuple[float, float]:
    """Variance of a group's mean (S, T) that is due to its seeds, and of each target's mean that is due to chance.

    Chance is what neither the seed nor the target explains; one seed shows neither part.
    """
    S, T = group.shape
    if S == 1:
        return 0.0, 0.0
    of_seeds, of_targets, mean = group.mean(axis=1), group.mean(axis=0), group.mean()
    rest = group - of_seeds[:, None] - of_targets + mean
    return float(of_seeds.var(ddof=1)) / S, float((rest**2).sum()) / ((S - 1) * (T - 1)) / S


def _quantile(freedom: float) -> float:
    """Of Student's t, two-sided."""
    return float(stdtrit(freedom, (1 + LEVEL) / 2))
