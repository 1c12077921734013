"""Landscapes and trials as they are drawn."""

from __future__ import annotations

import numpy as np
import pytest
from approaches import approaches
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure

from whiptool.errors import InputError
from whiptool.goals.target import Target
from whiptool.objective import Outcome, Trial
from whiptool.viz.plots import COLORS
from whiptool.viz.plots_search import axis_label, plot_landscape, plot_trials

NAMES = ("q_sf", "D")
GOAL = Target((1.0, 0.0), 0.5)
X, Y = np.linspace(0, 2, 81), np.linspace(-1, 1, 61)
CENTRE = np.array([1.2, 0.1])


def cone() -> np.ndarray:
    """A miss distance that is the distance from a point of the map."""
    return np.hypot(X - CENTRE[0], Y[:, None] - CENTRE[1])


def trial(number: int, strike: tuple[float, ...], *, hit: bool) -> Trial:
    pair = (0.0, 0.0)
    return Trial(number, strike, Outcome(0.01 if hit else 0.5, hit, 0.3, pair, pair, pair, pair, False))


def test_the_line_is_where_the_miss_is_the_hit_radius():
    ax = plot_landscape(Figure().subplots(), X, Y, approaches(cone()), GOAL, names=NAMES)
    (contour,) = [c for c in ax.collections if type(c).__name__ == "QuadContourSet"]
    line = np.concatenate([path.vertices for path in contour.get_paths()])
    np.testing.assert_allclose(np.hypot(*(line - CENTRE).T), 0.5, atol=2e-3)


def test_the_line_is_around_what_hits_as_the_target_asks():
    """The tip moves to the right in the right half of the map alone, and only there a near strike is a hit."""
    velocity = np.zeros((len(Y), len(X), 2))
    velocity[..., 0] = np.where(CENTRE[0] < X, 1.0, -1.0)
    for target, hits in ((Target((1.0, 0.0), 0.5, direction=(1, 0)), True), (Target((1.0, 0.0), 0.5, speed=2), False)):
        ax = plot_landscape(Figure().subplots(), X, Y, approaches(cone(), velocity), target, names=NAMES)
        contours = [c for c in ax.collections if type(c).__name__ == "QuadContourSet"]
        assert ax.get_legend_handles_labels()[1] == ["edge of the hits"][: len(contours)]
        assert len(contours) == hits
        for contour in contours:
            line = np.concatenate([path.vertices for path in contour.get_paths()])
            assert line[:, 0].min() > CENTRE[0] - 0.03
            np.testing.assert_array_less(np.hypot(*(line - CENTRE).T), 0.55)


def test_axes_have_units_and_near_is_dark():
    figure = Figure()
    ax = plot_landscape(figure.subplots(), X, Y, approaches(cone()), GOAL, names=NAMES)
    assert ax.get_xlabel() == "$q_{sf}$ [rad]" == axis_label("q_sf")
    assert ax.get_ylabel() == "$D$ [s]"
    assert figure.axes[1].get_ylabel() == "miss distance [m]"
    mesh = ax.collections[0]
    figure.canvas.draw()
    light = mesh.to_rgba(mesh.get_array())[..., :3].sum(axis=-1).reshape(len(Y), len(X))
    i, j = np.unravel_index(cone().argmin(), light.shape)
    assert light[i, j] == light.min()
    assert light.max() - light.min() > 1


def test_what_diverged_is_grey_and_no_number():
    miss = cone()
    miss[:, :40] = np.nan
    miss[0, 0] = np.inf
    ax = plot_landscape(Figure().subplots(), X, Y, approaches(miss), GOAL, names=NAMES)
    drawn = ax.collections[0].get_array().reshape(miss.shape)
    assert np.ma.getmaskarray(drawn)[:, :40].all()
    assert not np.ma.getmaskarray(drawn)[:, 40:].any()
    assert ax.get_facecolor() == to_rgba("0.75")


def test_without_a_hit_there_is_no_line():
    ax = plot_landscape(Figure().subplots(), X, Y, approaches(cone() + 1), GOAL, names=NAMES)
    assert len(ax.collections) == 1
    assert not ax.get_legend_handles_labels()[1]


def test_a_landscape_that_does_not_fit_is_refused():
    with pytest.raises(InputError, match=r"^strikes: got 4880; allowed: 61 times 81, one for each"):
        plot_landscape(Figure().subplots(), X, Y, approaches(cone()[:, 1:]), GOAL, names=NAMES)
    with pytest.raises(InputError, match="did not diverge"):
        plot_landscape(Figure().subplots(), X, Y, approaches(np.full((61, 81), np.nan)), GOAL, names=NAMES)


def test_trials_stand_where_they_struck_and_hits_are_filled():
    trials = [
        trial(1, (0.1, 0.2, 0.3, 0.4, 0.5), hit=False),
        trial(2, (1.1, 1.2, 1.3, 1.4, 1.5), hit=True),
        trial(3, (2.1, 2.2, 2.3, 2.4, 2.5), hit=False),
    ]
    ax = plot_trials(Figure().subplots(), trials, (2, 4), names=NAMES)
    lines = {line.get_label(): line for line in ax.lines}
    np.testing.assert_allclose(lines["miss"].get_xydata(), [[0.3, 0.5], [2.3, 2.5]])
    np.testing.assert_allclose(lines["hit"].get_xydata(), [[1.3, 1.5]])
    assert lines["miss"].get_markerfacecolor() == "none"
    assert lines["hit"].get_markerfacecolor() == COLORS["vermilion"]
    assert ax.get_xlabel() == "$q_{sf}$ [rad]"
