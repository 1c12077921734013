"""The picture of a learning curve shows what the table of its episodes holds."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.colors import to_hex
from matplotlib.figure import Figure

from whiptool.viz.plots_learning import plot_learning, running_mean, save_learning
from whiptool.viz.style import COLORS

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
