"""Landscapes and trials as they are drawn, and comparisons that are shipped in one file."""

from __future__ import annotations

import json

import numpy as np
import pytest
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure

from whiptool.commands import cli
from whiptool.commands.compare import CompareOptions
from whiptool.commands.finished_comparison import read_run
from whiptool.errors import InputError
from whiptool.objective import Outcome, Trial
from whiptool.runs import RunFolder
from whiptool.studies.comparison.shipped import Results
from whiptool.viz.plots import COLORS
from whiptool.viz.plots_search import axis_label, plot_landscape, plot_trials

NAMES = ("q_sf", "D")
X, Y = np.linspace(0, 2, 81), np.linspace(-1, 1, 61)
CENTRE = np.array([1.2, 0.1])


def cone() -> np.ndarray:
    """A miss distance that is the distance from a point of the map."""
    return np.hypot(X - CENTRE[0], Y[:, None] - CENTRE[1])


def trial(number: int, strike: tuple[float, ...], *, hit: bool) -> Trial:
    pair = (0.0, 0.0)
    return Trial(number, strike, Outcome(0.01 if hit else 0.5, hit, 0.3, pair, pair, pair, pair, False))


def test_the_line_is_where_the_miss_is_the_hit_radius():
    ax = plot_landscape(Figure().subplots(), X, Y, cone(), 0.5, names=NAMES)
    (contour,) = [c for c in ax.collections if type(c).__name__ == "QuadContourSet"]
    line = np.concatenate([path.vertices for path in contour.get_paths()])
    np.testing.assert_allclose(np.hypot(*(line - CENTRE).T), 0.5, atol=2e-3)


def test_axes_have_units_and_near_is_dark():
    figure = Figure()
    ax = plot_landscape(figure.subplots(), X, Y, cone(), 0.5, names=NAMES)
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
    ax = plot_landscape(Figure().subplots(), X, Y, miss, 0.5, names=NAMES)
    drawn = ax.collections[0].get_array().reshape(miss.shape)
    assert np.ma.getmaskarray(drawn)[:, :40].all()
    assert not np.ma.getmaskarray(drawn)[:, 40:].any()
    assert ax.get_facecolor() == to_rgba("0.75")


def test_without_a_hit_there_is_no_line():
    ax = plot_landscape(Figure().subplots(), X, Y, cone() + 1, 0.5, names=NAMES)
    assert len(ax.collections) == 1
    assert not ax.get_legend_handles_labels()[1]


def test_a_landscape_that_does_not_fit_is_refused():
    with pytest.raises(InputError, match=r"shape \(81, 61\).*shape \(61, 81\)"):
        plot_landscape(Figure().subplots(), X, Y, cone().T, 0.5, names=NAMES)
    with pytest.raises(InputError, match="did not diverge"):
        plot_landscape(Figure().subplots(), X, Y, np.full((61, 81), np.nan), 0.5, names=NAMES)


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


@pytest.fixture
def run(tmp_path):
    """A run folder as `whiptool.compare` leaves it, its results made up."""
    pytest.importorskip("torch", reason="learners are part of the comparison")
    options = CompareOptions(
        methods=("ga", "sac"), observation=("goal",), targets=3, seeds=2, cap=9, tighter=(), episodes=4, trials=8
    )
    units = options.comparison(options.methods, options.observation).units()
    folder = RunFolder.create(
        tmp_path / "run", {"version": "1", "command": "compare", "options": cli.as_plain(options)}
    )
    (folder.path / "units").mkdir()
    for unit in units:
        learner = unit.name.startswith("sac")
        outcome = {"hit_radius": 0.06, "trials": [unit.seed + 1, 9, 9], "hit": [True, True, False]}
        conventions = ("mean-first", "samples", "mean") if learner else ("",)
        result = {
            "outcomes": [{"convention": c, **outcome} for c in conventions],
            "training_trials": 32 * learner,
            "n_diverged": unit.seed,
            "wall_time": 2.0,
            "note": "ended early" if learner and unit.seed else "",
        }
        if learner:
            result["rewards"] = [1.0, 2.0, 3.0, 4.126][: 4 - unit.seed]
        (folder.path / "units" / f"{unit.name}.json").write_text(json.dumps(result))
    return folder.path


def test_a_shipped_comparison_says_what_the_run_said(run, tmp_path):
    file = tmp_path / "comparison.json"
    read_run(run).save(file)
    results = Results.load(file)
    assert results.cap == 9
    assert [one.method for one in results.at(0.06)] == ["ga", "sac", "random"]
    ga = results.at(0.06)[0]
    # the last trial may hit, and a miss counts the cap
    np.testing.assert_array_equal(ga.trials, [[1, 9, 9], [2, 9, 9]])
    np.testing.assert_array_equal(ga.hit, [[True, True, False]] * 2)
    assert ga.mean == pytest.approx((1 + 9 + 9 + 2 + 9 + 9) / 6)
    sac = results.at(0.06, convention="mean")[1]
    assert (sac.method, sac.convention, sac.observation) == ("sac", "mean", "goal")
    assert (sac.training_trials, sac.n_diverged, sac.notes) == (32, 1, ("seed 1: ended early",))
    # of a seed that ended early no more is kept of the others either
    np.testing.assert_array_equal(results.rewards["goal"]["sac"], [[1.0, 2.0, 3.0]] * 2)
    assert results.random_episodes == {"goal": 50}
    assert not results.at(0.03)


def test_a_run_that_is_not_finished_is_refused(run):
    next((run / "units").glob("ga-seed1-*")).unlink()
    with pytest.raises(InputError, match="1 are not there"):
        read_run(run)


def test_a_folder_of_another_command_is_refused(tmp_path):
    with pytest.raises(InputError, match="readable"):
        read_run(tmp_path)
    (tmp_path / "config.toml").write_text('command = "optimize"')
    with pytest.raises(InputError, match=r"whiptool\.compare or whiptool\.reproduce"):
        read_run(tmp_path)


def test_a_damaged_file_is_refused(run, tmp_path):
    file = tmp_path / "comparison.json"
    read_run(run).save(file)
    text = file.read_text()
    for broken in (text[:-20], text.replace('"format":1', '"format":2'), text.replace('"cap"', '"cup"'), "[]"):
        file.write_text(broken)
        with pytest.raises(InputError, match="a whole file that whiptool wrote"):
            Results.load(file)
    with pytest.raises(InputError):
        Results.load(tmp_path / "nothing.json")
