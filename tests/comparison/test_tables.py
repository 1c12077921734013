"""Tables of a comparison: what stands in each place, by hand."""

from __future__ import annotations

import csv
import io

import pytest
from series_by_hand import TRIALS, series

from whiptool.comparison.series import (
    as_csv,
    as_markdown,
    convention_table,
    figure,
    main_table,
    percent,
    radius_table,
)


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
