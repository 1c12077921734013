"""Published numbers: that they fit the model, each other, and DIRECT-L's own rule."""

from __future__ import annotations

import numpy as np
import pytest

from papers.nah2023 import published
from papers.nah2023.units import BOUNDS, first_strikes
from whiptool.models.presets import NAH2023


def test_targets_lie_at_two_distances_in_three_directions():
    """Straight ahead, halfway to the side, and halfway up, too; the far ones at exactly the model's reach."""
    targets = np.array(published.TARGETS)
    distance = np.linalg.norm(targets, axis=1)
    near, far = np.split(distance, [published.WITHIN_REACH])
    assert near == pytest.approx([1.995] * 3, abs=1e-3)
    assert far == pytest.approx([2.385] * 3, abs=1e-4)
    assert NAH2023.reach == pytest.approx(2.385, abs=2e-3)
    directions = targets / distance[:, None]
    np.testing.assert_allclose(directions[:3], directions[3:], atol=1e-3)
    np.testing.assert_allclose(directions[:3], [[1, 0, 0], [0.5**0.5, 0.5**0.5, 0], [0.5, 0.5, 0.5**0.5]], atol=1e-3)


def test_only_the_sixth_target_was_not_hit():
    assert [n == published.CAP for n in published.EVALUATIONS] == [False] * 5 + [True]
    assert [best is None for best in published.BEST] == [True] * 5 + [False]
    assert published.BEST[5] > published.HIT_RADIUS
    assert published.LAST_NODES < NAH2023.whip.N


def test_strikes_are_within_the_bounds():
    lower, upper = BOUNDS.box
    assert published.STRIKES.shape == (len(published.TARGETS), len(lower))
    rounding = 1e-4  # they print four digits
    assert (lower - rounding <= published.STRIKES).all()
    assert (upper + rounding >= published.STRIKES).all()


def test_strikes_stand_on_directls_grid():
    """The published strikes are centres of boxes that were trisected: odd sixths, eighteenths, ... of each bound."""
    lower, upper = BOUNDS.box
    share = (published.STRIKES[:5] - lower) / (upper - lower)
    for strike in share:
        for x, width in zip(strike, upper - lower, strict=True):
            gaps = [abs(x - (np.floor(x * 3**k) + 0.5) / 3**k) for k in range(5)]
            assert min(gaps) < 2e-4 / width


def test_logs_hold_one_distance_for_each_of_the_first_strikes():
    assert published.LOGGED.shape == (len(published.LOGGED_TARGETS), len(first_strikes()))
    assert len(published.LOGGED_NODES) == len(published.LOGGED_OFFSET) == len(published.LOGGED_TARGETS)
    farthest = NAH2023.reach + np.linalg.norm(published.LOGGED_TARGETS, axis=1) + published.LOGGED_OFFSET
    assert (published.LOGGED > 0).all()
    assert (farthest[:, None] > published.LOGGED).all()
    beyond = np.linalg.norm(published.LOGGED_TARGETS[3])
    assert beyond == pytest.approx(np.linalg.norm(published.TARGETS[3]) + 0.01, abs=1e-4)
