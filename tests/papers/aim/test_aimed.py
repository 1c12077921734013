"""What came of goals: shares by hand, and results that are not worked out twice."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

pytest.importorskip("torch")

from papers.aim import aimed as module
from papers.aim.aimed import Aimed, aim, interval
from papers.aim.oracle import OracleUnit
from papers.aim.units import ClearanceUnit, GoalsUnit, MissedUnit, ReplayUnit
from whiptool.comparison import Store

GOALS = 4


def part(first: int, one_shot: list[bool], refined: list[bool], miss: list[float | None]) -> dict[str, Any]:
    """What a unit of goals would say."""
    count = len(one_shot)
    missed = one_shot.count(False)

    def shots(hit: list[bool], miss: list[float | None]) -> dict[str, list]:
        return {"hit": hit, "miss": miss, "angle": [0.1] * count, "within": [True] * count}

    return {
        "positions": [[1.7, 0.1, 0.01 * (first + i)] for i in range(count)],
        "angles": [0.1 * (first + i) for i in range(count)],
        "one_shot": shots(one_shot, [0.02] * count),
        "one_shot_unchecked": [False, *one_shot[1:]],
        "one_shot_by_joints": [True] * count,
        "refined": shots(refined, miss),
        "strikes": [[float(first + i)] * 3 for i in range(count)],
        "rollouts": 10 * count,
        "derivatives": 1,
        "followed": {"candidates": [{"trials": 3, "hit": False} for _ in range(missed)]},
        "seconds": [1.0, 2.0],
        "processor_seconds": [1.5, 3.0],
    }


@pytest.fixture
def worked(monkeypatch) -> list[str]:
    """Names of the units that are worked on: of the four goals one is missed in one shot, two after refinement."""
    names: list[str] = []
    tables = {
        0: part(0, [True, False], [True, False], [1e-4, 0.3]),
        2: part(2, [True] * 2, [True, False], [3e-4, None]),
    }

    def goals(unit: GoalsUnit, folder, threads) -> dict[str, Any]:
        names.append(unit.key)
        return tables[unit.first]

    def others(unit: MissedUnit, folder, threads) -> dict[str, Any]:
        names.append(unit.key)
        table = {"miss": 0.02, "angle": 0.0, "within": True, "strike": [0.0]}
        return {"found": [{"search": "candidates", "hit": False, **table}]}

    def replay(unit: ReplayUnit, folder, threads) -> dict[str, Any]:
        names.append(unit.key)
        return {"hit": unit.goal == 0, "miss": 5e-4, "angle": 0.1}

    def swing(unit: OracleUnit, folder, threads) -> dict[str, Any]:
        names.append(unit.key)
        table = {"angle": 0.2, "apart": 0.02, "extrapolated": 0.003}
        return {"played": [{"hit": goal == 2, "miss": 0.01 * (1 + goal), **table} for goal in unit.goals]}

    def look(unit: ClearanceUnit, folder, threads) -> dict[str, bool]:
        names.append(unit.key)
        return {"arm": True, "floor": unit.goal == 0}

    monkeypatch.setattr(module, "CHUNK", 2)
    monkeypatch.setattr(module, "TOGETHER", 1)
    runs = {GoalsUnit: goals, MissedUnit: others, ReplayUnit: replay, OracleUnit: swing, ClearanceUnit: look}
    for unit, run in runs.items():
        monkeypatch.setattr(unit, "run", run)
    return names


def struck(folder: Path, *, clear: bool = True, **options) -> Aimed:
    """The four goals of a pretended map."""
    task: Any = SimpleNamespace(name="toy", drawn=GOALS, clear=clear)
    strike_map: Any = SimpleNamespace(answers=SimpleNamespace(strikes=np.arange(6.0)), gate=None)
    return aim(task, strike_map, folder, Store(folder), **{"goals": GOALS, "replays": 5, **options})


def test_shares_by_hand(worked, tmp_path):
    """A goal that one shot hits and refinement does not is reached; the one that nobody hits is not."""
    summary = struck(tmp_path).summary()
    assert summary["goals"] == 4
    assert summary["one_shot"] == 0.75
    assert summary["one_shot_unchecked"] == 0.25
    assert summary["one_shot_by_joints"] == 1.0
    assert summary["processor_seconds_per_goal_together"] == 1.5
    assert summary["refined_of_all"] == 0.5
    assert summary["refined"] == pytest.approx(2 / 3)
    assert summary["never_reached"] == 0.25
    assert [row["goal"] for row in summary["never"]] == [1]
    assert summary["never"][0]["arrival_angle"] == pytest.approx(np.degrees(0.1))
    assert summary["median_miss"] == pytest.approx((3e-4 + 0.3) / 2)  # of 0.1, 0.3, 300 mm and one that diverged
    assert summary["rollouts_per_goal"] == 10
    assert summary["derivatives_per_goal"] == 0.5
    assert summary["seconds_per_goal_together"] == 1.0
    assert summary["mean_trials"] == {"candidates": (3 * 1 + 3) / 4}
    assert summary["in_mujoco"] == {
        "strikes": 2,
        "hits": 1,
        "median_miss": pytest.approx(5e-4),
        "largest_miss": pytest.approx(5e-4),
        "median_angle": pytest.approx(0.1),
        "largest_angle": pytest.approx(0.1),
        "median_difference": pytest.approx(3e-4),
        "largest_difference": pytest.approx(4e-4),
    }
    assert summary["in_cosserat"]["strikes"] == 0
    assert summary["in_cosserat"]["median_miss"] is None


def test_strikes_with_a_cosserat_rod_are_those_that_hit(worked, tmp_path):
    aimed = struck(tmp_path, oracle=5)
    assert set(aimed.oracle) == {0, 2}
    found = aimed.summary()["in_cosserat"]
    assert (found["strikes"], found["hits"]) == (2, 1)
    assert found["median_miss"] == pytest.approx(0.02)
    assert found["largest_miss"] == pytest.approx(0.03)
    assert set(struck(tmp_path, oracle=1).oracle) < {0, 2}


def test_clearance_is_looked_at_afterwards_where_it_is_no_limit(worked, tmp_path):
    assert struck(tmp_path, touched=5).clear == {}
    assert struck(tmp_path, touched=5, clear=False).summary()["clear"] == {"strikes": 2, "arm": 1.0, "floor": 0.5}


def test_intervals_hold_the_share_at_their_usual_rate():
    """Of counts that are drawn with a share, the intervals hold it in about 95 %; none and all are no exceptions."""
    drawn = np.random.default_rng(0).binomial(400, 0.97, 500)
    found = np.array([interval(count, 400) for count in drawn])
    assert 0.92 < np.mean((found[:, 0] <= 0.97) & (found[:, 1] >= 0.97)) < 0.98
    assert interval(0, 10)[0] == 0.0
    assert interval(10, 10)[1] == 1.0


def test_what_another_search_reaches_counts(worked, tmp_path):
    aimed = struck(tmp_path)
    aimed.missed[1].append({"search": "cmaes", "hit": True})
    assert aimed.reached.all()
    assert aimed.summary()["refined"] == 0.5
    assert aimed.summary()["reached_by_others"] == 1


def test_what_the_next_candidate_reaches_counts(worked, tmp_path):
    aimed = struck(tmp_path)
    assert aimed.reached.tolist() == [True, False, True, True]
    aimed.followed["candidates"][0]["hit"] = True
    assert aimed.reached.all()
    assert aimed.summary()["refined"] == 0.5


def test_what_is_done_is_not_done_again(worked, tmp_path):
    first = struck(tmp_path, goals=2)
    assert len(first) == 2
    assert len(worked) == len(set(worked)) == 3  # two goals, one of them missed, and one replayed
    again = struck(tmp_path)
    assert len(again) == 4
    assert len(worked) == len(set(worked)) == 6
    assert struck(tmp_path).summary() == again.summary()
    assert len(worked) == 6
    lost = next(path for path in (tmp_path / "units").iterdir() if path.name.startswith("goals-first2-last4-"))
    lost.unlink()
    assert struck(tmp_path).summary() == again.summary()
    assert worked[6:] == [lost.stem]


def test_another_map_has_other_results(worked, tmp_path):
    struck(tmp_path)
    before = len(worked)
    task: Any = SimpleNamespace(name="toy", drawn=GOALS, clear=True)
    other: Any = SimpleNamespace(answers=SimpleNamespace(strikes=np.arange(7.0)), gate=None)
    aim(task, other, tmp_path, Store(tmp_path), goals=GOALS)
    assert len(worked) == before + 4  # goals and what was missed of them
