"""Curves with fewer points keep their ends, their extremes and their order."""

from __future__ import annotations

import numpy as np

from whiptool.following.run_view import Curve


def test_a_thinned_curve_keeps_its_ends_and_extremes() -> None:
    x, y = np.arange(10_000), np.random.default_rng(0).normal(size=10_000)
    y[::7] = np.nan
    thin = Curve("a", x, y).thinned(200)
    assert 190 <= len(thin.x) <= 202
    assert (thin.x[0], thin.x[-1]) == (0, 9999)
    assert (np.diff(thin.x) > 0).all()
    assert (np.nanmin(thin.y), np.nanmax(thin.y)) == (np.nanmin(y), np.nanmax(y))
    np.testing.assert_array_equal(thin.y, y[thin.x])


def test_a_short_curve_stays_as_it_is() -> None:
    curve = Curve("a", np.arange(3), np.arange(3.0))
    assert curve.thinned(10) is curve
