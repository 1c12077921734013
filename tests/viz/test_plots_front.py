"""Fronts as they are drawn."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from whiptool.viz.plots_front import plot_front, save_front

FRONT = np.array([[1.0, 0.06], [2.0, 0.03], [4.0, 0.0]])
TRIED = np.array([[1.5, 0.06], [90.0, 0.05]])
LABELS = ("effort [N² m² s]", "miss distance [m]")


def test_the_front_and_other_hits_are_drawn_with_units_and_the_front_fills_the_axes():
    ax = plot_front(Figure().subplots(), FRONT, TRIED, labels=LABELS)
    others, line = ax.lines
    np.testing.assert_array_equal(line.get_xydata(), FRONT)
    assert line.get_drawstyle() == "steps-post"
    np.testing.assert_array_equal(others.get_xydata(), TRIED)
    assert (ax.get_xlabel(), ax.get_ylabel()) == LABELS
    assert ax.get_xlim()[0] < 1 < 4 < ax.get_xlim()[1] < 90
    assert ax.get_ylim()[0] < 0 < 0.06 < ax.get_ylim()[1]
    assert [text.get_text() for text in ax.get_legend().get_texts()] == ["other hits", "Pareto front"]


def test_a_front_of_one_hit_has_axes(tmp_path):
    assert save_front(tmp_path, FRONT[:1], TRIED, labels=LABELS, title="one").stat().st_size > 1000
