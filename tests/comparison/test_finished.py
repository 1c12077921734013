"""Results of a comparison in one file: what is read is what was written."""

from __future__ import annotations

import numpy as np

from whiptool.comparison.finished import Results
from whiptool.comparison.series import Series


def test_results_are_read_as_they_were_written(tmp_path):
    hit = np.array([[True, False], [True, True]])
    series = Series(
        method="sac",
        observation="goal",
        convention="mean",
        hit_radius=0.06,
        trials=np.array([[3, 9], [1, 9]]),  # of the two nines one hit at the last trial
        hit=hit,
        training_trials=32,
        n_diverged=1,
        wall_time=2.5,
        notes=("seed 1: ended early",),
        cap=9,
    )
    rewards = {"goal": {"sac": np.array([[1.0, 2.25]])}}
    written = Results((series,), rewards, {"goal": 50}, cap=9, version="1")
    written.save(tmp_path / "comparison.json")
    read = Results.load(tmp_path / "comparison.json")
    (one,) = read.at(0.06, convention="mean")
    np.testing.assert_array_equal(one.trials, series.trials)
    np.testing.assert_array_equal(one.hit, hit)
    assert (one.training_trials, one.n_diverged, one.wall_time, one.notes) == (32, 1, 2.5, series.notes)
    np.testing.assert_array_equal(read.rewards["goal"]["sac"], [[1.0, 2.25]])
    assert (read.random_episodes, read.cap, read.version) == ({"goal": 50}, 9, "1")
    assert read.at(0.06) == []
