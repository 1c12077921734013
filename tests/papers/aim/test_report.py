"""The report's tables and picture, of goals that are given by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("torch")

from papers.aim.aimed import Aimed, Shots
from papers.aim.report import figures, millimetres, misses, other_searches, percent, planar_figures


def shots(hit: list[bool]) -> Shots:
    count = len(hit)
    return Shots(np.array(hit), np.full(count, 3e-5), np.full(count, 0.05), np.ones(count, bool))


def aimed() -> Aimed:
    """Three goals, of which one shot and refinement hit the same two, and candidates, rolled out, the third as well."""
    return Aimed(
        positions=np.array([[1.7, 0.2, 0.1], [1.9, -0.1, 0.4], [2.2, 0.0, -0.5]]),
        angles=np.radians([-170.0, 0.0, 95.0]),
        one_shot=shots([True, False, True]),
        refined=shots([True, False, True]),
        one_shot_unchecked=np.array([True, False, False]),
        one_shot_by_joints=np.array([True, True, True]),
        strikes=np.zeros((3, 13)),
        rollouts=30,
        derivatives=3,
        followed={"candidates": [{"trials": 4, "hit": True}], "refinement": [{"trials": 3, "hit": True}]},
        seconds=np.array([1.0, 2.0]),
        processor_seconds=np.array([1.5, 3.0]),
        missed={
            1: [{"search": "candidates", "hit": False, "miss": 0.123, "angle": None, "within": True, "strike": []}]
        },
        replayed={0: {"hit": True, "miss": 8e-5, "angle": 0.05}},
        oracle={0: {"hit": True, "miss": 0.012, "angle": np.radians(3)}, 2: {"hit": False, "miss": 0.06, "angle": 0.5}},
        clear={0: {"arm": True, "floor": False}, 2: {"arm": True, "floor": True}},
    )


def row_of(rows: list[list[str]], name: str) -> list[str]:
    return next(row[1:] for row in rows if row[0].startswith(name))


def test_ours_stand_beside_the_published():
    rows = figures(aimed())
    assert rows[0] == ["", "published", "ours"]
    assert {len(row) for row in rows} == {3}
    assert row_of(rows, "hit in one shot") == ["73.5 %", "66.7 %"]
    assert row_of(rows, "hit by the best of 64") == ["92.1 %", "100.0 %"]
    assert row_of(rows, "hit after refinement") == ["-", "66.7 %"]
    assert row_of(rows, "... of the goals that any search") == ["-", "66.7 %"]
    assert row_of(rows, "never reached") == ["-", "0 (0.0 %)"]
    assert row_of(rows, "median miss after") == ["-", "0.030 mm"]
    assert row_of(rows, "refined strikes that hit in MuJoCo") == ["-", "1 of 1"]
    assert row_of(rows, "refined strikes in which arm and whip") == ["-", "100.0 %"]
    assert row_of(rows, "... of the floor, too") == ["-", "50.0 %"]
    assert row_of(rows, "... difference of the miss") == ["-", "0.050 mm, 0.050 mm"]
    assert row_of(rows, "... by the first strike proposed") == ["-", "33.3 %"]
    assert row_of(rows, "... and if collisions") == ["-", "100.0 %"]
    assert row_of(rows, "refined strikes that hit with a Cosserat rod") == ["-", "1 of 2"]
    after = rows[[row[0] for row in rows].index("refined strikes that hit with a Cosserat rod, too") :]
    assert row_of(after, "... miss there") == ["-", "36.0 mm, 60.0 mm"]
    assert row_of(after, "... angle there") == ["-", "15.8, 28.6"]
    assert not [row for row in figures(replace(aimed(), replayed={})) if "MuJoCo" in row[0]]


def never_all_reached() -> Aimed:
    """The same goals, the third of which no candidate hits either."""
    followed = {"candidates": [{"trials": 64, "hit": False}], "refinement": [{"trials": 9, "hit": False}]}
    return replace(aimed(), followed=followed)


def test_a_goal_that_no_search_hits_is_never_reached():
    rows = figures(never_all_reached())
    assert row_of(rows, "hit by the best of 64") == ["92.1 %", "66.7 %"]
    assert row_of(rows, "... of the goals that any search") == ["-", "100.0 %"]
    assert row_of(rows, "never reached") == ["-", "1 (33.3 %)"]


def test_goals_that_refinement_missed_are_listed():
    assert other_searches(aimed())[1:] == [["1", "1.90 -0.10 0.40", "0", "none", "12.3", "-"]]


def test_the_planar_table_counts_trials():
    rows = planar_figures(aimed())
    assert row_of(rows, "SAC") == ["22.0 %", "25.9"]
    assert row_of(rows, "map, then its next") == ["66.7 %", "2.00"]
    assert row_of(rows, "map, then corrections") == ["66.7 %", "1.67"]


def test_shares_are_all_only_where_they_are():
    assert percent(1.0) == "100.0 %"
    assert percent(0.9998) == "99.98 %"
    assert percent(0.925) == "92.5 %"
    assert millimetres(2.5e-2) == "25.0 mm"


def test_the_picture_shows_every_goal_and_what_was_missed():
    figure = misses(never_all_reached())
    assert len(figure.axes) == 4
    for ax in figure.axes:
        hit, missed, never = (line.get_xydata() for line in ax.lines)
        assert (len(hit), len(missed), len(never)) == (2, 1, 1)
        np.testing.assert_array_equal(missed, never)
        assert missed[0, 1] == 0.4
    assert figure.axes[2].lines[0].get_xdata()[0] == pytest.approx(-170)
