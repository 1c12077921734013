"""Runs that are followed by their folders: which are, and how they go as an MCAP file."""

from __future__ import annotations

import csv
import struct
from pathlib import Path

import numpy as np
import pytest

from whiptool.commands import optimize, studio
from whiptool.commands.following import followed
from whiptool.errors import InputError
from whiptool.runs import CONFIG


@pytest.fixture(scope="module")
def run(tmp_path_factory) -> Path:
    """A search that goes on after its hit."""
    folder = tmp_path_factory.mktemp("following") / "run"
    words = ["--target", "1.2", "0.1", "--max-trials", "30", "--no-stop-at-hit", "--no-video", "--quiet"]
    assert optimize.main([*words, "--method", "cmaes", "--out", str(folder)]) == 0
    return folder


def test_a_search_that_has_ended_is_shown_as_it_ended(run: Path) -> None:
    view = followed(run).look()
    assert view is not None
    assert view.finished
    assert view.facts["trials"] == "30 of at most 30"
    assert view.heading == "optimize, cmaes: run"


def test_a_folder_of_another_command_is_refused_by_name(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"run folder"):
        followed(tmp_path)
    (tmp_path / CONFIG).write_text('command = "compare"\n')
    with pytest.raises(
        InputError, match=r"the folder of optimize, train, adapt, map build or rig strike; this one is of compare"
    ):
        followed(tmp_path)


def test_the_progress_of_a_run_is_written_as_mcap(run: Path, tmp_path: Path, capsys) -> None:
    reader = pytest.importorskip("mcap.reader", reason="MCAP files need pip install 'whiptool[io]'")
    path = tmp_path / "progress.mcap"
    assert studio.main([str(run), "--mcap", str(path)]) == 0
    found: dict[str, list] = {}
    with path.open("rb") as file:
        for schema, channel, message in reader.make_reader(file).iter_messages():
            found.setdefault(channel.topic, []).append((schema.name, message.log_time // 10**9, message.data))
    best = found["/progress/miss_distance_m_best_so_far"]
    with (run / "trials.csv").open(encoding="utf-8") as file:
        misses = [float(row["miss_distance"]) for row in csv.DictReader(file)]
    values = [struct.unpack("<d", data[4:])[0] for _, _, data in best]  # CDR: 4 bytes, then the number
    np.testing.assert_array_equal(values, np.minimum.accumulate(misses))
    assert [time for _, time, _ in best] == list(range(1, len(misses) + 1))
    assert {name for name, _, _ in best} == {"std_msgs/msg/Float64"}
    assert found["/tip_path"][0][:2] == ("nav_msgs/msg/Path", len(misses) + 1)
    assert {"/joint_states", "/whip", "/tip", "/target", "/points/closest_points_of_the_last_trials"} < set(found)
    capsys.readouterr()
    other = [str(run), "--mcap", "progress.txt"]
    refused = [(["--mcap", str(path)], "--mcap"), ([str(tmp_path), "--mcap", str(path)], "run folder")]
    for words, said in (*refused, (other, "--mcap: got 'progress.txt'; allowed: a file whose name ends in .mcap")):
        assert studio.main(words) == 2
        assert said in capsys.readouterr().err
    assert studio.main([str(run), "--model", "ur5e"]) == 2
    assert "--model: got 'ur5e'; allowed: only without a run folder" in capsys.readouterr().err
