"""A training as its folder shows it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("tensorboard", reason="training needs pip install 'whiptool[rl]'")

from whiptool.following.training import FollowedTraining
from whiptool.rl.policy import Score
from whiptool.rl.trained import BEST, EPISODES
from whiptool.rl.training import TrainingEpisode
from whiptool.rl.training_log import EpisodeTable


def test_the_learning_curve_grows_and_a_resumed_run_is_cut(tmp_path: Path) -> None:
    table = EpisodeTable(tmp_path / EPISODES, ("critic",))
    table.cut(0)
    run = FollowedTraining(tmp_path, "a training", episodes=40)
    run.look()
    for number in range(1, 11):
        held_out = Score(0.1 * number, 1 / number) if number % 5 == 0 else None
        losses = {"critic": 2.0 * number} if number > 2 else {}
        table.add(TrainingEpisode(number, 100 * number, -1.0 * number, 0.02 * number, 3, losses, held_out))
    view = run.look()
    assert view is not None
    assert view.facts["episodes"] == "10 of 40"
    assert view.facts["strikes"] == "1000"
    assert view.facts["diverged"] == "3"
    assert view.chosen is None  # no policy was stored
    charts = {chart.title: chart for chart in view.charts}
    np.testing.assert_array_equal(charts["reward"].curves[0].y, -np.arange(1.0, 11))
    (trials,), (held_out,) = (charts[f"share of hits{where}"].curves for where in ("", " at held-out goals"))
    np.testing.assert_allclose(trials.y, 0.02 * np.arange(1, 11))
    np.testing.assert_array_equal(held_out.x, [5, 10])
    np.testing.assert_allclose(held_out.y, [0.5, 1.0])
    np.testing.assert_array_equal(charts["losses"].curves[0].x, np.arange(3, 11))
    (tmp_path / BEST).write_bytes(b"")
    table.cut(6)
    again = run.look()
    assert again is not None
    assert again.facts["episodes"] == "6 of 40"
    assert again.chosen is not None
    assert again.chosen.number == 5
