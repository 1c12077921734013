"""Tolerance where the miss distance has a closed form: the tip is at the first two numbers of a strike."""

from __future__ import annotations

import numpy as np
import pytest
from linear_rollout import LEAST, LinearRollout

from papers.human.tolerance_costs import SIZES, costs, tolerance
from whiptool.goals.target import Target

RADIUS = 0.04
TARGET = Target(tuple(LEAST[:2]), hit_radius=RADIUS)
ASIDE = LEAST + np.array([0.3, 0, 0, 0, 0])


@pytest.fixture(scope="module")
def exact():
    return tolerance(LinearRollout(), TARGET, LEAST[None], draws=4000)


def test_sensitivity_is_the_slope(exact):
    np.testing.assert_allclose(exact.sensitivity, [[1, 1, 0, 0, 0]], atol=1e-9)


def test_hits_are_those_of_rayleigh(exact):
    """Two normal errors: the miss distance has Rayleigh's distribution."""
    np.testing.assert_allclose(exact.shares, 1 - np.exp(-((RADIUS / SIZES) ** 2) / 2), atol=0.03)
    np.testing.assert_allclose(exact.miss[0], SIZES * np.sqrt(np.pi / 2), rtol=0.03)


@pytest.mark.parametrize("share", [0.95, 0.278, 0.196])
def test_equivalent_noise(exact, share):
    expected = RADIUS / np.sqrt(-2 * np.log(1 - share))
    assert exact.equivalent_noise(share) == pytest.approx(expected, rel=0.05)
    low, high = exact.interval(share)
    assert low < exact.equivalent_noise(share) < high
    assert high / low < 1.3


def test_a_strike_aside_bears_no_noise():
    found = tolerance(LinearRollout(), TARGET, ASIDE[None], draws=100)
    assert found.equivalent_noise(0.5) == SIZES[0]


def test_strikes_that_diverge_miss():
    found = tolerance(LinearRollout(wild=-10.0), TARGET, LEAST[None], draws=50)
    assert not found.hits.any()
    assert np.isfinite(found.miss).all()


def test_costs():
    """Aside, all that the place costs is won at the target; there, no scatter at all is best."""
    size = 0.05
    aside = costs(LinearRollout(), TARGET, ASIDE, [LEAST], size=size)
    there = costs(LinearRollout(), TARGET, LEAST, [ASIDE], size=size)
    assert aside.miss - aside.tolerance == pytest.approx(there.miss)
    assert there.tolerance == pytest.approx(0)
    assert there.noise == pytest.approx(there.miss)
    assert aside.noise < 0.1 * aside.miss
    assert 0 < there.covariation < 0.5 * there.miss
