"""The table of a training: whole lines of the same columns, cut back to a checkpoint, read as numbers."""

from __future__ import annotations

import os

import numpy as np
import pytest

from whiptool.errors import InputError
from whiptool.rl.policy import Score
from whiptool.rl.training import TrainingEpisode
from whiptool.rl.training_log import EpisodeTable

FIRST = TrainingEpisode(1, 4, -2.5, 0.25, 0, {})
SECOND = TrainingEpisode(2, 8, 1.0, 0.5, 1, {"critic": 3.5, "actor": -1.0}, Score(0.75, 0.125), best=True)
THIRD = TrainingEpisode(3, 12, 2.0, 0.5, 1, {"critic": 3.0, "actor": -2.0})


def test_every_line_has_the_same_columns(tmp_path):
    table = EpisodeTable(tmp_path / "episodes.csv", ("critic", "actor"))
    table.cut(0)
    for episode in (FIRST, SECOND, THIRD):
        table.add(episode)
    assert table.path.read_text() == (
        "number,strikes,mean_reward,share_hit,diverged,critic,actor,held_out_hit,held_out_cost\n"
        "1,4,-2.5,0.25,0,,,,\n"
        "2,8,1.0,0.5,1,3.5,-1.0,0.75,0.125\n"
        "3,12,2.0,0.5,1,3.0,-2.0,,\n"
    )
    columns = table.columns()
    np.testing.assert_array_equal(columns["number"], [1, 2, 3])
    np.testing.assert_array_equal(columns["held_out_hit"], [np.nan, 0.75, np.nan])
    np.testing.assert_array_equal(columns["critic"], [np.nan, 3.5, 3.0])


def test_a_table_is_cut_to_the_episodes_of_a_checkpoint(tmp_path):
    table = EpisodeTable(tmp_path / "episodes.csv", ("critic", "actor"))
    table.cut(0)
    for episode in (FIRST, SECOND, THIRD):
        table.add(episode)
    whole = table.path.read_text()
    again = EpisodeTable(table.path, ("critic", "actor"))
    again.cut(2)
    assert len(table.path.read_text().splitlines()) == 3
    again.add(THIRD)
    assert table.path.read_text() == whole
    again.cut(0)
    assert table.path.read_text() == ""


def test_a_table_of_an_earlier_version_keeps_its_columns(tmp_path):
    path = tmp_path / "episodes.csv"
    path.write_text("number,strikes,mean_reward,share_hit,diverged,critic\n1,4,-2.5,0.25,0,\n")
    table = EpisodeTable(path, ("critic",))
    table.cut(1)
    table.add(SECOND)
    assert path.read_text().splitlines()[-1] == "2,8,1.0,0.5,1,3.5"
    assert np.isnan(table.columns()["held_out_hit"]).all()


HEADER = "number,strikes,mean_reward,share_hit,diverged,critic\n"
LINES = "1,4,-2.5,0.25,0,\n2,8,1.0,0.5,1,3.5\n"


@pytest.mark.parametrize(
    ("text", "line"),
    [
        (HEADER + LINES.replace("-2.5", "x"), 2),
        (HEADER + LINES.replace("2,8", "7,8"), 3),
        (HEADER + LINES.replace("1.0,0.5", "1.0"), 3),
        (HEADER.replace("share_hit", "magic") + LINES, 1),
        (LINES, 1),
        ("\x00" + HEADER + LINES, 1),
        ("\n", 1),
    ],
)
def test_a_damaged_table_is_refused_by_its_line_and_stays(text, line, tmp_path):
    path = tmp_path / "episodes.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=rf"episodes\.csv, line {line}: got"):
        EpisodeTable(path, ("critic",)).cut(2)
    assert path.read_text() == text


def test_a_table_that_is_no_file_is_refused(tmp_path):
    os.mkfifo(tmp_path / "episodes.csv")
    with pytest.raises(InputError, match="not a pipe"):
        EpisodeTable(tmp_path / "episodes.csv", ("critic",)).cut(2)


def test_a_run_whose_table_was_moved_away_can_be_resumed_again_and_again(tmp_path):
    table = EpisodeTable(tmp_path / "episodes.csv", ("critic", "actor"))
    table.cut(1)
    for episode in (SECOND, THIRD):
        table.add(episode)
    again = EpisodeTable(table.path, ("critic", "actor"))
    again.cut(2)
    np.testing.assert_array_equal(again.columns()["number"], [2])
