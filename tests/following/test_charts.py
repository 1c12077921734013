"""Curves as the page's charts take them: common x, readable units, nothing that a logarithmic axis cannot draw."""

from __future__ import annotations

import numpy as np

from whiptool.following.charts import _known, columns
from whiptool.following.run_view import Chart, Curve

A = Curve("a", np.arange(1, 6), np.array([1.0, np.nan, 3.0, 4.0, 5.0]))
B = Curve("b", np.array([2, 4]), np.array([10.0, 30.0]))


def drawn(chart: Chart) -> tuple[np.ndarray, ...]:
    """What the page is sent of a chart."""
    known = _known(chart)
    assert known is not None
    return columns(known)


def test_curves_share_x_and_have_no_gaps() -> None:
    x, a, b = drawn(Chart("c", "trial", "", (A, B)))
    np.testing.assert_array_equal(x, [1, 2, 3, 4, 5])
    np.testing.assert_array_equal(a, [1, 2, 3, 4, 5])
    np.testing.assert_array_equal(b, [10, 10, 20, 30, 30])


def test_a_logarithmic_chart_is_in_millimetres() -> None:
    tiny = Curve("tiny", np.array([1, 5]), np.array([1e-12, 0.5]))
    _, _, b, c = drawn(Chart("c", "trial", "m", (A, B, tiny), logarithmic=True))
    np.testing.assert_array_equal(b, [1e4, 1e4, 2e4, 3e4, 3e4])
    assert c[0] == 0.01
    assert c[-1] == 500


def test_a_long_curve_is_thinned_and_one_without_values_is_left_out() -> None:
    y = np.random.default_rng(0).random(50_000)
    empty = Curve("b", np.ones(1), np.full(1, np.nan))
    x, a = drawn(Chart("c", "trial", "", (Curve("a", np.arange(50_000), y), empty)))
    assert len(x) == len(a) <= 802
    assert a.max() == y.max()
    assert _known(Chart("c", "trial", "", (empty,))) is None
