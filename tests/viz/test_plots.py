"""Figures: drawn for good strikes and for broken ones."""

from __future__ import annotations

from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.figure import Figure
from space_swing import swing
from spatial_arms import of_universal_nodes

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
    assert [file.stem for file in written] == ["distance", "speed", "torque", "tracking", "gains", "strike"]
    assert all(file.stat().st_size > 5000 for file in written)


def legend_fits(ax) -> bool:
    """Whether a legend that was drawn is as wide as its axes at most."""
    legend, axes = ax.get_legend().get_window_extent(), ax.get_window_extent()
    return axes.x0 - 1 <= legend.x0 and legend.x1 <= axes.x1 + 1


def test_tracking_shows_errors_and_their_size(trajectory):
    axes = plots.plot_tracking(trajectory, LEMON, axes=Figure().subplots(2))
    error = np.rad2deg(trajectory.q[:, :2] - trajectory.q_d)
    np.testing.assert_allclose(axes[0].lines[0].get_ydata(), error[:, 0], atol=1e-12)
    np.testing.assert_allclose(axes[1].lines[1].get_ydata(), np.rad2deg(trajectory.v[:, 1] - trajectory.v_d[:, 1]))
    rms, largest = np.sqrt((error[:, 1] ** 2).mean()), np.abs(error[:, 1]).max()
    assert axes[0].get_legend().get_texts()[1].get_text() == f"elbow: RMS {rms:.3g}, largest {largest:.3g} deg"
    assert axes[0].get_ylabel() == "position error [deg]"


def test_where_there_are_no_errors_the_motion_is_drawn(trajectory):
    q, v = (np.c_[x, y[:, 2:]] for x, y in ((trajectory.q_d, trajectory.q), (trajectory.v_d, trajectory.v)))
    exact = replace(trajectory, q=q, v=v)
    axes = plots.plot_tracking(exact, LEMON, axes=Figure().subplots(2))
    np.testing.assert_allclose(axes[0].lines[1].get_ydata(), np.rad2deg(trajectory.q_d[:, 1]))
    assert [ax.get_ylabel() for ax in axes] == ["position [deg]", "velocity [deg/s]"]
    assert axes[0].get_title(loc="left") == "the joints follow their references exactly"


def test_constant_gains_are_matrices_with_their_numbers(trajectory, tmp_path, monkeypatch):
    K, B = np.array([[29.5, 14.3], [14.3, 0.0]]), np.array([[2.95, 1.43], [1.43, 3.93]])
    ones = np.ones((len(trajectory.t), 1, 1))
    constant = replace(trajectory, K=ones * K, B=ones * B)
    axes = plots.plot_gains(constant, LEMON, axes=Figure().subplots(1, 2))
    assert [text.get_text() for text in axes[0].texts] == ["29.5", "14.3", "14.3", "0"]
    np.testing.assert_allclose(axes[1].images[0].get_array(), B)
    assert axes[0].get_title(loc="left") == "stiffness K [N m/rad], constant"
    assert [label.get_text() for label in axes[0].get_yticklabels()] == ["shoulder", "elbow"]
    assert not plots.plot_gains(trajectory, LEMON, axes=Figure().subplots(2))[0].images
    monkeypatch.setattr(plots, "save_figure", lambda figure, path: path)
    none = replace(trajectory, K=0 * ones * K, B=0 * ones * K)
    assert "gains.png" not in {x.name for x in plots.save_strike_figures(tmp_path, none, LEMON, as_target(TARGET), "x")}


def test_the_speed_of_the_tip_is_marked_where_it_is_largest_and_at_the_target(trajectory):
    ax = plots.plot_tip_speed(trajectory, tuple(TARGET), ax=Figure().subplots())
    near = trajectory.approach(TARGET)
    curve, largest, closest = ax.lines[:3]
    np.testing.assert_array_equal(curve.get_ydata(), trajectory.tip_speed)
    assert largest.get_ydata() == trajectory.tip_speed.max()
    np.testing.assert_allclose(closest.get_xydata(), [[near.time[0], near.speed[0]]])
    assert largest.get_marker() != closest.get_marker()
    assert len(plots.plot_tip_speed(trajectory, ax=Figure().subplots()).lines) == 3  # with the line at D


@pytest.mark.parametrize("name", ["nah2023", "panda"])
def test_numbers_of_constant_gains_are_within_their_cells(name):
    model = preset(name) if name == "nah2023" else of_universal_nodes(name)
    axes = plots.plot_gains(swing(model), model)
    axes[0].figure.draw_without_rendering()
    for ax in axes:
        cell = ax.get_window_extent().width / model.arm.n
        assert all(text.get_window_extent().width < cell for text in ax.texts)
    plt.close(axes[0].figure)


@pytest.mark.parametrize("name", ["panda", "ur5e"])
def test_legends_of_many_joints_are_within_their_axes(name):
    model = of_universal_nodes(name)
    path = swing(model)
    for draw in (plots.plot_torque, plots.plot_tracking):
        axes = np.ravel(draw(path, model))
        axes[0].figure.draw_without_rendering()
        assert all(legend_fits(ax) for ax in axes)
        assert all(ax.get_window_extent().height > 0.25 * ax.figure.bbox.height for ax in axes)
        plt.close(axes[0].figure)


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
