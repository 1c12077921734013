"""Curves as the page's charts take them: common x, readable units, nothing that a logarithmic axis cannot draw."""

from __future__ import annotations

import numpy as np

from whiptool.following.charts import columns
from whiptool.following.run_view import Chart, Curve

A = Curve("a", np.arange(1, 6), np.array([1.0, np.nan, 3.0, 4.0, 5.0]))
B = Curve("b", np.array([2, 4]), np.array([10.0, 30.0]))


def test_curves_share_x_and_gaps_are_interpolated() -> None:
    x, a, b = columns(Chart("c", "trial", "", (A, B)))
    np.testing.assert_array_equal(x, [1, 2, 3, 4, 5])
    np.testing.assert_array_equal(a, [1, 2, 3, 4, 5])
    np.testing.assert_array_equal(b, [np.nan, 10, 20, 30, np.nan])


def test_a_logarithmic_chart_is_in_millimetres_and_has_no_gaps() -> None:
    tiny = Curve("tiny", np.array([1, 5]), np.array([1e-12, 0.5]))
    _, _, b, c = columns(Chart("c", "trial", "m", (A, B, tiny), logarithmic=True))
    np.testing.assert_array_equal(b, [1e4, 1e4, 2e4, 3e4, 3e4])
    assert c[0] == 0.01
    assert c[-1] == 500


def test_a_long_curve_is_thinned_and_one_without_values_is_left_empty() -> None:
    y = np.random.default_rng(0).random(50_000)
    x, a, b = columns(
        Chart("c", "trial", "", (Curve("a", np.arange(50_000), y), Curve("b", np.ones(1), np.full(1, np.nan))))
    )
    assert len(x) == len(a) <= 802
    assert a.max() == y.max()
    assert np.isnan(b).all()
