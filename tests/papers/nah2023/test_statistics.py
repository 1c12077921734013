"""Intervals of shares and medians."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import norm

from papers.nah2023.statistics import Share, median_interval, median_of, share_nearer


@pytest.mark.parametrize(("count", "of"), [(0, 20), (7, 24), (20, 20)])
def test_interval_of_a_share_is_wilsons(count, of):
    """Between the probabilities p at which the count is 1.96 standard deviations from its expectation."""
    low, high = Share(count, of).interval
    z = norm.ppf(0.975)
    for p in (low, high):
        if 1e-9 < p < 1 - 1e-9:
            assert abs(count - of * p) == pytest.approx(z * np.sqrt(of * p * (1 - p)))


def test_most_asks_for_more_than_half_beyond_the_interval():
    assert Share(18, 24).most
    assert not Share(14, 24).most  # 58 %, 39 to 76 %
    assert not Share(0, 0).most


def test_interval_of_a_median_covers_it():
    """Of exponential variables, 24 at a time: in at least 95 % of 4,000 draws, and no more than 98 %."""
    rng = np.random.default_rng(0)
    drawn = rng.exponential(size=(4000, 24))
    inside = [low <= np.log(2) <= high for low, high in map(median_interval, drawn)]
    assert 0.945 < np.mean(inside) < 0.98
    assert median_interval(np.array([1.0, 2.0, 3.0])) == (1.0, 3.0)


def test_share_of_nearer_trials_is_covered_in_95_percent():
    """Of uniform numbers that share is the least of them."""
    least = np.random.default_rng(0).uniform(size=(20_000, 64)).min(axis=1)
    assert np.mean(least <= share_nearer(64)) == pytest.approx(0.95, abs=0.006)


def test_median_in_words():
    assert median_of(np.array([1.0, 2.0, 3.0]), " %") == "2 % (1 to 3)"
    assert median_of(np.array([])) == "-"
