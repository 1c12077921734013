"""People beside machines as a command: what it writes and says, and that it goes on after a kill."""

from __future__ import annotations

import json
import re

import pytest
from command_line import assert_one_line, called
from human_data import write_made_up
from repository import ROOT

from papers.human.command import REPORT

SMALL = ("--resamples", 0, "--seeds", 1, "--trials", 20, "--whips", 0, "--draws", 10)


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("human")
    write_made_up(folder / "data")
    return folder / "data", folder / "run", called("human", "data", *SMALL, "--out", "run", "--json", cwd=folder)


def test_an_object_per_style(run):
    _, folder, done = run
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)
    assert result == json.loads((folder / "result.json").read_text())
    for style in ("discrete", "rhythmic"):
        assert result[style]["throws"] == 80
        assert 0.02 < result[style]["min_distance_median"] < 0.3
        assert 0 <= result[style]["hit_share"] <= 1
        assert len(result["whip"][style]["tapered"]["peaks"]) == 10
    assert {row["method"] for row in result["tolerance"]} == {"DIRECT-L", "CMA-ES", "SAC", "gradient", "robust"}
    assert [one["label"] for one in result["learning"]] == ["people, discrete", "people, rhythmic", "SAC"]


def test_keys_are_documented(run):
    pages = (ROOT / "docs" / "json.md").read_text(encoding="utf-8")
    documented = pages.partition("\n## human\n")[2].partition("\n## ")[0]
    named = set(re.findall(r"`([\w.]+)`", documented))
    result = json.loads(run[2].stdout)
    for where, keys in (("", result), ("style", result["discrete"]), ("tolerance", result["tolerance"][0])):
        assert set(keys) <= named, (where, set(keys) - named)


def test_the_report_is_whole(run):
    page = (run[1] / REPORT).read_text(encoding="utf-8")
    for words in ("What they print", "Style and block", "The whip of the task", "Tolerance, noise", "Learning"):
        assert words in page
    assert page.count("<img") == 6


@pytest.mark.slow
def test_it_goes_on_where_it_was(run):
    _, folder, done = run
    before = {path.name: path.stat().st_mtime_ns for path in (folder / "units").iterdir()}
    again = called("human", "--resume", "run", "--json", cwd=folder.parent)
    assert again.returncode == 0, again.stderr
    assert {path.name: path.stat().st_mtime_ns for path in (folder / "units").iterdir()} == before
    one, other = json.loads(done.stdout), json.loads(again.stdout)
    assert one["tolerance"] == other["tolerance"]


@pytest.mark.parametrize("broken", ["trial_stats.csv", "whip_task_data.mat"])
def test_a_file_that_is_none_is_one_line(tmp_path, broken):
    data = write_made_up(tmp_path / "data")
    (data / broken).write_text("not what it should be\n")
    done = called("human", "data", "--out", "run", cwd=tmp_path)
    assert_one_line(done, broken)
    assert not (tmp_path / "run").exists()
