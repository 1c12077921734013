"""Intervals and reliability of trials."""

from __future__ import annotations

import numpy as np
import pytest

from papers.unknown.trials import Trials, reliability


def test_intervals_resample_whips_not_trials():
    """Ten whips, each the same in all its hundred trials, tell as much as ten numbers."""
    values = np.repeat(np.arange(10.0), 100)
    low, high = Trials(values[:, None], np.repeat(np.arange(10), 100)).interval(values)
    error = np.std(np.arange(10)) / np.sqrt(10)
    assert (high - low) / 2 == pytest.approx(1.96 * error, rel=0.1)


def test_reliability():
    bins, error = reliability(np.array([0.9, 0.95, 0.1]), np.array([True, True, False]))
    np.testing.assert_allclose(bins, [[0.1, 0.0, 1.0], [0.925, 1.0, 2.0]])
    assert error == pytest.approx((0.1 + 2 * 0.075) / 3)
