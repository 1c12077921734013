"""Figures of a comparison show what its series hold."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from matplotlib.figure import Figure
from series_by_hand import series

from whiptool.comparison.trial_plots import plot_ecdf
from whiptool.viz.style import COLORS


def test_the_share_of_targets_that_are_hit_rises_at_each_hit() -> None:
    ax = plot_ecdf(Figure().subplots(), [series()], cap=600)
    (line,) = ax.get_lines()
    steps = dict(zip(*line.get_data(), strict=True))  # of the trials at each, the last
    assert {trials: pytest.approx(share) for trials, share in steps.items()} == {
        1: 12.5, 2: 25, 3: 37.5, 4: 50, 5: 62.5, 7: 75, 600: 75,
    }  # fmt: skip
    assert ax.get_xlim() == (1, 600)


def test_searches_differ_by_their_dashes_too() -> None:
    methods = ("directl", "ga", "cmaes", "gradient", "random")
    ax = plot_ecdf(Figure().subplots(), [series(method=method, observation="") for method in methods], cap=600)
    dashes = [line._unscaled_dash_pattern for line in ax.get_lines()]
    assert len(set(map(str, dashes))) == len(methods)
    assert COLORS["yellow"] not in {line.get_color() for line in ax.get_lines()}  # hard to see on white


def test_targets_that_are_all_hit_at_once_have_an_axis_too() -> None:
    with warnings.catch_warnings(action="error"):
        ax = plot_ecdf(Figure().subplots(), [series(trials=np.ones((2, 3), int))])
    (line,) = ax.get_lines()
    assert dict(zip(*line.get_data(), strict=True)) == {1: pytest.approx(100)}
    assert ax.get_xlim() == (1, 2)
