"""Figures: drawn for good strikes and for broken ones."""

from __future__ import annotations

import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.figure import Figure

from whiptool.goals.target import Target, as_target
from whiptool.impedance import ConstantImpedance, Controller
from whiptool.models import preset
from whiptool.models.strike import Strike
from whiptool.rollout import CompiledRollout
from whiptool.viz import plots
from whiptool.viz.plots_strike import plot_strike

LEMON, TARGET = preset("lemon2024"), np.array([1.3, 0.0])
STRIKE = Strike.from_vector([-1.2, 0.9, 1.2, 0.3, 0.7])
WILD = Controller(ConstantImpedance(K=((1e7, 0), (0, 1e7)), B=((0, 0), (0, 0))))


@pytest.fixture(scope="module")
def trajectory():
    return CompiledRollout(LEMON, Controller()).trajectory(STRIKE, t_stay=0.3)


def test_every_axis_names_its_unit(trajectory):
    ax = plot_strike(trajectory, LEMON, Target(tuple(TARGET)), ax=Figure().subplots())
    assert "[m]" in ax.get_xlabel()
    assert "[m]" in ax.get_ylabel()
    ax = plots.plot_distance(trajectory, tuple(TARGET), ax=Figure().subplots())
    assert "[s]" in ax.get_xlabel()
    assert "[m]" in ax.get_ylabel()
    marked = [line for line in ax.lines if len(line.get_xdata()) == 1]
    assert marked[0].get_xdata()[0] == pytest.approx(trajectory.approach(TARGET).time[0])
    axes = plots.plot_tracking(trajectory, LEMON, axes=Figure().subplots(2))
    assert ["deg" in ax.get_ylabel() for ax in axes] == [True, True]
    axes = plots.plot_gains(trajectory, LEMON, axes=Figure().subplots(2))
    assert ["N m" in ax.get_ylabel() for ax in axes] == [True, True]


def test_a_diverged_strike_is_drawn_too(tmp_path):
    path = CompiledRollout(LEMON, WILD, timestep=2.5e-4).trajectory(STRIKE, t_stay=0.3)
    assert path.diverged
    written = plots.save_strike_figures(tmp_path, path, LEMON, as_target(TARGET), "wild")
    assert len(written) == 5
    assert all(file.stat().st_size > 5000 for file in written)


def compared(ax, bar) -> bool:
    """Whether a colour bar stands at once beside its axes."""
    gap = bar.get_position().x0 - ax.get_position().x1
    return 0 < gap < 0.1 * ax.get_position().width


def test_a_strike_fills_its_figure(trajectory):
    """Colour bar beside the axes, title above them, no blank third; also after a change of the figure's shape."""
    ax = plot_strike(trajectory, LEMON, tuple(TARGET))
    figure = ax.figure
    for size in (figure.get_size_inches(), (9.0, 5.0), (5.0, 9.0)):
        figure.set_size_inches(*size)
        figure.draw_without_rendering()
        drawn = figure.get_tightbbox()
        assert drawn.width > 0.93 * size[0]
        assert drawn.height > 0.93 * size[1]
        assert compared(ax, *ax.child_axes)
        assert ax._left_title.get_window_extent().x0 == pytest.approx(ax.get_window_extent().x0, abs=2)
    plt.close(figure)


@pytest.mark.parametrize("layout", ["constrained", "compressed", None])
def test_strikes_beside_each_other_keep_their_colour_bars(layout, trajectory):
    figure = Figure((12, 5), layout=layout)
    left, right = figure.subplots(1, 2)
    plot_strike(trajectory, LEMON, tuple(TARGET), ax=left)
    plots.plot_distance(trajectory, tuple(TARGET), ax=right)
    figure.draw_without_rendering()
    (bar,) = left.child_axes
    assert compared(left, bar)
    assert bar.get_tightbbox().x1 <= right.get_tightbbox().x0 or layout is None
