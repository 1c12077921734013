"""Comparisons that are shipped in one file."""

from __future__ import annotations

import json

import numpy as np
import pytest

from papers.finished_comparison import read_run
from whiptool.commands import run_folders
from whiptool.commands.compare import CompareOptions
from whiptool.comparison.finished import Results
from whiptool.errors import InputError
from whiptool.runs import RunFolder


@pytest.fixture
def run(tmp_path):
    """A run folder as `whiptool.compare` leaves it, its results made up."""
    pytest.importorskip("torch", reason="learners are part of the comparison")
    options = CompareOptions(
        methods=("ga", "sac"), observation=("goal",), targets=3, seeds=2, max_trials=9, tighter=(), episodes=4, trials=8
    )
    units = options.comparison(options.methods, options.observation).units()
    folder = RunFolder.create(
        tmp_path / "run", {"version": "1", "command": "compare", "options": run_folders.as_plain(options)}
    )
    (folder.path / "units").mkdir()
    for unit in units:
        learner = unit.method == "sac"
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
        (folder.path / "units" / f"{unit.key}.json").write_text(json.dumps(result))
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


def test_a_run_that_is_not_finished_is_refused(run):
    next((run / "units").glob("search-ga-seed1-*")).unlink()
    with pytest.raises(InputError, match="1 are not there"):
        read_run(run)


def test_a_run_of_an_older_version_is_refused_with_what_to_do(run):
    """Its results are there, under names that left out some fields of their units."""
    for file in (run / "units").iterdir():
        file.rename(file.with_name(f"{file.stem[:-17]}.json"))
    with pytest.raises(InputError, match=r"6 results of an older version.*--resume"):
        read_run(run)


def test_a_folder_of_another_command_is_refused(tmp_path):
    with pytest.raises(InputError, match="readable"):
        read_run(tmp_path)
    (tmp_path / "config.toml").write_text('command = "optimize"')
    with pytest.raises(InputError, match=r"whiptool\.compare or whiptool\.reproduce"):
        read_run(tmp_path)


def test_a_file_that_calls_the_observation_as_it_was_called_is_read(run, tmp_path):
    file = tmp_path / "old.json"
    read_run(run).save(file)
    file.write_text(file.read_text().replace('"goal"', '"paper"'))
    results = Results.load(file)
    assert (list(results.rewards), list(results.random_episodes)) == (["tip"], ["tip"])
    assert {one.observation for one in results.series} == {"", "tip"}
