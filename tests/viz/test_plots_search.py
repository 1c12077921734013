"""Landscapes and trials as they are drawn."""

from __future__ import annotations

import numpy as np
import pytest
from approaches import approaches
from matplotlib.colors import to_hex, to_rgba
from matplotlib.figure import Figure

from whiptool.errors import InputError
from whiptool.goals.target import Target
from whiptool.objective import Outcome, Trial
from whiptool.viz.plots_search import (
    axis_label,
    plot_front,
    plot_landscape,
    plot_learning,
    plot_trials,
    running_mean,
    save_front,
    save_learning,
)
from whiptool.viz.style import COLORS

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


NAN = np.nan
COLUMNS = {
    "number": np.arange(1.0, 11.0),
    "mean_reward": np.linspace(-5, 40, 10),
    "share_hit": np.linspace(0, 0.9, 10),
    "held_out_hit": np.array([NAN, NAN, NAN, NAN, 0.5, NAN, NAN, NAN, NAN, 0.75]),
}


def test_the_curve_shows_rewards_shares_and_the_best_policy():
    reward, hits = Figure().subplots(2, 1)
    plot_learning(reward, hits, COLUMNS, trials=100, best=10)
    np.testing.assert_array_equal(reward.lines[0].get_ydata(), COLUMNS["mean_reward"])
    raw, _, held_out, best = hits.lines
    np.testing.assert_allclose(raw.get_ydata(), 100 * COLUMNS["share_hit"])
    assert held_out.get_xydata().tolist() == [[5, 50], [10, 75]]
    assert best.get_xydata().tolist() == [[10, 75]]
    assert {to_hex(line.get_color()).upper() for line in (raw, held_out)} <= set(COLORS.values())
    assert raw.get_color() != held_out.get_color()
    assert (reward.get_ylabel(), hits.get_ylabel()) == ("mean reward of a strike", "hits [%]")
    assert hits.get_xlabel() == "episode of 100 strikes"
    assert [text for _, text in zip(*hits.get_legend_handles_labels(), strict=True)] == [
        "exploring strikes, running mean",
        "first strikes at held-out goals",
        "best policy, episode 10",
    ]


def test_a_training_without_held_out_goals_has_a_curve_too(tmp_path):
    columns = {**COLUMNS, "held_out_hit": np.full(10, NAN)}
    path = save_learning(tmp_path / "c.png", columns, trials=2, random_episodes=3, best=None, title="PPO")
    assert path.read_bytes()[:4] == b"\x89PNG"


def test_a_running_mean_is_of_the_values_before():
    assert running_mean(np.array([1.0, 3.0, 5.0, 7.0]), 2) == pytest.approx([1, 2, 4, 6])
