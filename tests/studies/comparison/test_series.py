"""Series and tables of a comparison: what stands in each place, by hand."""

from __future__ import annotations

import csv
import io

import numpy as np
import pytest

from whiptool.impedance import Controller
from whiptool.models import preset
from whiptool.studies.comparison.series import Series, collect
from whiptool.studies.comparison.tables import (
    as_csv,
    as_markdown,
    convention_table,
    figure,
    main_table,
    percent,
    radius_table,
)
from whiptool.studies.comparison.units import Scene, SearchUnit

TRIALS = np.array([[1, 4, 600, 2], [3, 5, 7, 600]])
HIT = TRIALS < 600


def series(method="sac", observation="goal", convention="mean-first", radius=0.06, trials=TRIALS, **more) -> Series:
    fields = {"training_trials": 1500.0, "n_diverged": 3, "wall_time": 2.5, **more}
    return Series(method, observation, convention, radius, trials, trials < 600, **fields)


def test_a_row_by_hand():
    row = series(notes=("one", "two")).row()
    assert row["mean_trials"] == pytest.approx(1222 / 8)
    assert row["median_trials"] == 4.5
    assert row["largest"] == 600
    assert row["share_hit"] == 0.75
    assert (row["seeds"], row["targets"], row["notes"]) == (2, 4, "one; two")
    assert row["low"] <= row["mean_trials"] <= row["high"]
    labels = [series().label, series("ga", "").label, series("ga+library", "").label, series("other", "").label]
    assert labels == ["SAC, goal", "GA", "GA from a library", "other"]
    assert (series().learned, series("ga", "").learned) == (True, False)
    assert [series(convention=x).main for x in ("mean-first", "", "mean")] == [True, True, False]
    assert HIT.mean() == 0.75


def test_units_become_series():
    scene = Scene(model=preset("lemon2024"), controller=Controller(), targets=4, radii=(0.06, 0.02))
    units, results = [], {}
    for seed in (0, 1):
        for first in (0, 2):
            unit = SearchUnit(scene=scene, method="ga", seed=seed, first=first, last=first + 2)
            units.append(unit)
            trials = [100 * seed + 10 * first + i for i in (1, 2)]
            results[unit.name] = {
                "outcomes": [
                    {"convention": "", "hit_radius": radius, "hit": [True, scale == 1],
                     "trials": [scale * x for x in trials]}
                    for radius, scale in ((0.06, 1), (0.02, 2))
                ],
                "training_trials": 10 + seed, "n_diverged": 1 + first, "wall_time": 2.0 + seed,
                "note": "late" if (seed, first) == (1, 2) else "",
            }  # fmt: skip
    wide, tight = collect(units, results)
    np.testing.assert_array_equal(wide.trials, [[1, 2, 21, 22], [101, 102, 121, 122]])
    np.testing.assert_array_equal(tight.trials, 2 * wide.trials)
    assert wide.hit.all()
    np.testing.assert_array_equal(tight.hit, [[True, False, True, False]] * 2)
    assert (wide.hit_radius, tight.hit_radius) == (0.06, 0.02)
    assert (wide.training_trials, wide.n_diverged, wide.wall_time) == (10.5, 8, 5.0)
    assert wide.notes == ("seed 1: late",)


@pytest.mark.parametrize(
    ("value", "text"),
    [(1.0, "1"), (1 + 1e-12, "1"), (1.0004, "1.0004"), (1.01, "1.01"), (1.009, "1.0090"), (9.994, "9.99"),
     (10.0, "10.0"), (123.46, "123.5"), (0.5, "0.5")],
)  # fmt: skip
def test_figures(value, text):
    assert figure(value) == text


@pytest.mark.parametrize(("share", "text"), [(1.0, "100 %"), (0.9999, "99.9 %"), (0.5, "50.0 %"), (0.0, "0.0 %")])
def test_shares(share, text):
    assert percent(share) == text


def test_tables():
    every = [
        series(radius=0.06), series(radius=0.02, trials=2 * TRIALS), series(convention="samples", trials=TRIALS + 1),
        series("ga", "", "", 0.06), series("ga", "", "", 0.02),
    ]  # fmt: skip
    head, *rows = main_table(every)
    assert [row[0] for row in rows] == ["SAC, goal", "GA"]
    assert len(head) == len(rows[0])
    assert rows[0][1] == figure(TRIALS.mean())
    assert rows[0][3:] == ["4.5", "600", "75.0 %", "2", "1,500", "2.5"]
    low, high = every[0].interval
    assert rows[0][2] == f"{figure(low)} to {figure(high)}"
    head, *rows = radius_table(every)
    assert head[1:] == ["0.06 m", "0.02 m"]
    assert rows[0] == ["SAC, goal", "152.8 (75.0 %)", "305.5 (75.0 %)"]
    assert [row[0] for row in rows] == ["SAC, goal", "GA"]
    head, *rows = convention_table(every)
    assert head[1:] == ["mean-first", "samples"]
    assert rows == [["SAC, goal", "152.8 (75.0 %)", f"{figure(TRIALS.mean() + 1)} (75.0 %)"]]
    lines = list(csv.DictReader(io.StringIO(as_csv(every))))
    assert [float(line["hit_radius"]) for line in lines] == [0.06, 0.02, 0.06, 0.06, 0.02]
    assert float(lines[1]["mean_trials"]) == 2 * TRIALS.mean()
    assert as_markdown([["a", "bcd"], ["ef", "g"]]).split("\n") == ["| a  | bcd |", "|----|-----|", "| ef | g   |"]
