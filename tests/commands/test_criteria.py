"""Searches for the best hit, and for a front, from the command line."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest

from whiptool.commands import optimize
from whiptool.models import preset
from whiptool.models.strike import strike_names
from whiptool.optimizers.trial_log import TRIALS, TrialLog

QUIET = ["--no-video", "--json", "--timestep", "1e-3", "--controller", "constant"]


@pytest.fixture(autouse=True)
def in_a_folder(tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)


def said(capsys) -> dict:
    return json.loads(capsys.readouterr().out)


def test_a_search_for_little_effort_ends_with_a_hit_of_the_least_it_saw(capsys):
    words = ["--method", "cmaes", "--minimise", "effort", "--max-trials", "300", *QUIET, "--out", "run"]
    assert optimize.main(words) == 0
    result = said(capsys)
    assert result["n_trials"] == 300  # the first hit is not the end
    (judged,) = result["judged"]
    assert (judged["name"], judged["unit"], judged["maximised"]) == ("effort", "N² m² s", False)
    log = TrialLog(Path("run") / TRIALS, preset("lemon2024").arm, criteria=["effort"]).read()
    hits = [trial.outcome for trial in log if trial.outcome.hit]
    assert judged["value"] == min(outcome.values[0] for outcome in hits)
    assert all(outcome.merit is not None for outcome in hits)
    assert {len(trial.outcome.values) for trial in log if not trial.outcome.diverged} == {1}


@pytest.mark.slow
def test_people_are_told_by_what_a_strike_is_judged(capsys):
    words = [*QUIET[:1], *QUIET[2:], "--method", "random", "--minimise", "peak-torque", "--max-trials", "40"]
    assert optimize.main([*words, "--hit-radius", "0.5"]) == 0
    line = next(line for line in capsys.readouterr().out.splitlines() if line.strip().startswith("peak-torque"))
    assert line.endswith(" N m")


@pytest.mark.slow
def test_a_front_is_written_and_goes_on_where_it_was_killed(capsys):
    words = ["--pareto", "effort", "miss", "--max-trials", "120", *QUIET, "--out"]
    assert optimize.main([*words, "whole"]) == 0
    result = said(capsys)
    assert [x["name"] for x in result["judged"]] == ["effort", "miss"]
    front = json.loads(Path("whole/front.json").read_text())
    rows = list(csv.DictReader(Path("whole/front.csv").read_text().splitlines()))
    assert len(rows) == len(front["front"]) >= 2
    names = strike_names(preset("lemon2024").arm)
    for row, entry in zip(rows, front["front"], strict=True):
        assert float(row["effort"]) == entry["effort"]
        assert [float(row[name]) for name in names] == [entry["strike"][name] for name in names]
        assert entry["miss"] == entry["miss_distance"] <= 0.06
    assert (np.diff([entry["effort"] for entry in front["front"]]) > 0).all()
    assert (np.diff([entry["miss"] for entry in front["front"]]) < 0).all()
    assert Path("whole/front.png").stat().st_size > 1000

    trials = Path("whole/trials.csv").read_text().splitlines(keepends=True)
    Path("whole/trials.csv").write_text("".join(trials[:91]))  # as after a kill
    Path("whole/front.json").unlink()
    assert optimize.main(["--resume", "whole", "--no-video", "--json"]) == 0
    said(capsys)
    assert Path("whole/trials.csv").read_text() == "".join(trials)
    assert json.loads(Path("whole/front.json").read_text()) == front
