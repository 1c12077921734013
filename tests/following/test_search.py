"""A search as its folder shows it, against the objective that wrote the folder."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from whiptool.errors import InputError
from whiptool.following.search import FollowedSearch
from whiptool.goals.target import Target
from whiptool.models import preset
from whiptool.objective import Arrival, Outcome, Trial
from whiptool.optimizers.trial_log import TRIALS, TrialColumns, TrialLog
from whiptool.rollout.compiled import CompiledRollout
from whiptool.runs import RESULT

MODEL = preset("lemon2024")
NOWHERE = (math.nan, math.nan)
MISSES = (0.5, 0.2, 2.0, 0.3, 0.1, 0.4)


@pytest.fixture(scope="module")
def rollout() -> CompiledRollout:
    return CompiledRollout(MODEL)


def outcome(miss: float, **changes) -> Outcome:
    return Outcome(miss, miss < 0.06, 0.7, (1.0, miss), (3.0, 4.0), NOWHERE, NOWHERE, False, **changes)


def trials() -> list[Trial]:
    """The third is refused, and has a penalty for its miss distance."""
    found = []
    for i, miss in enumerate(MISSES):
        refused = {"refused": "motor"} if miss > 1 else {}
        found.append(Trial(1 + i, (-1.0, 0.5, 1.5 + i, 0.8, 0.8), outcome(miss, **refused)))
    return found


def followed(folder: Path, rollout: CompiledRollout) -> FollowedSearch:
    return FollowedSearch(folder, "a search", rollout, Target((1.2, 0.1)), t_stay=0.3, budget=9)


def test_the_best_strike_and_how_it_was_found_are_shown(tmp_path: Path, rollout: CompiledRollout) -> None:
    log, run = TrialLog(tmp_path / TRIALS, MODEL.arm, limited=True), followed(tmp_path, rollout)
    first = run.look()
    assert first is not None
    assert (first.charts, first.chosen, first.finished) == ((), None, False)
    assert run.look() is None  # nothing changed
    for trial in trials()[:4]:
        log.append(trial)
    view = run.look()
    assert view is not None
    assert view.chosen is not None
    assert (view.chosen.number, view.chosen.vector) == (2, trials()[1].strike)
    assert view.facts["trials"] == "4 of at most 9"
    assert view.facts["refused"] == "1"
    assert view.facts["best trial"] == "2, misses: 200 mm"
    assert view.facts["tip speed"] == "5 m/s"
    each, best = view.charts[0].curves
    np.testing.assert_array_equal(each.y, [0.5, 0.2, np.nan, 0.3])
    np.testing.assert_array_equal(best.y, [0.5, 0.2, 0.2, 0.2])
    np.testing.assert_array_equal(best.x, [1, 2, 3, 4])
    np.testing.assert_array_equal(next(iter(view.points.values())), [[1.0, 0.5], [1.0, 0.2], [1.0, 0.3]])


def test_only_what_is_new_is_read_and_a_half_line_waits(tmp_path: Path, rollout: CompiledRollout) -> None:
    log, run = TrialLog(tmp_path / TRIALS, MODEL.arm), followed(tmp_path, rollout)
    for trial in trials()[:2]:
        log.append(trial)
    run.look()
    line = log.columns.line(trials()[4])
    with log.path.open("a", encoding="utf-8") as file:
        file.write(line[:30])
        file.flush()
        assert run.look() is None
        file.write(line[30:])
    view = run.look()
    assert view is not None
    assert view.facts["best trial"].startswith("5, misses: 100 mm")
    (tmp_path / RESULT).write_text("{}")
    ended = run.look()
    assert ended is not None
    assert ended.finished


def test_a_resumed_run_that_begins_its_log_again_is_shown_from_its_beginning(tmp_path: Path, rollout) -> None:
    log, run = TrialLog(tmp_path / TRIALS, MODEL.arm), followed(tmp_path, rollout)
    for trial in trials():
        log.append(trial)
    run.look()
    log.path.unlink()
    log.append(trials()[0])
    view = run.look()
    assert view is not None
    assert view.facts["trials"] == "1 of at most 9"


def test_the_best_of_a_search_with_direction_or_criteria_is_the_objectives(tmp_path: Path, rollout) -> None:
    log = TrialLog(tmp_path / TRIALS, MODEL.arm, arriving=True, criteria=["speed"])
    costs = ((0.2, 0.9), (0.5, 0.6), (0.3, 0.7))  # miss distance and cost
    for i, (miss, cost) in enumerate(costs):
        arrival = Arrival(math.radians(10 * (i + 1)), 5.0, cost)
        log.append(Trial(1 + i, (0.0,) * 5, outcome(miss, arrival=arrival, values=(5.0 + i,))))
    log.append(Trial(4, (1.0,) * 5, outcome(0.01, arrival=Arrival(0.1, 5.0, 0.01), values=(9.0,), merit=-9.0)))
    run = followed(tmp_path, rollout)
    view = run.look()
    assert view is not None
    assert view.chosen is not None
    assert view.chosen.number == 4
    charts = {chart.title: chart for chart in view.charts}
    np.testing.assert_array_equal(charts["miss distance"].curves[1].y, [0.2, 0.5, 0.5, 0.01])
    np.testing.assert_array_equal(charts["cost of miss and arrival"].curves[0].y, [0.9, 0.6, 0.6, 0.01])
    np.testing.assert_allclose(charts["angle of arrival"].curves[0].y, [10, 20, 20, math.degrees(0.1)])
    np.testing.assert_array_equal(charts["speed"].curves[0].y, [5.0, 6.0, 6.0, 9.0])
    assert charts["speed"].unit == "m/s"


def test_the_best_strike_is_rolled_out_as_the_search_did(tmp_path: Path, rollout: CompiledRollout) -> None:
    log = TrialLog(tmp_path / TRIALS, MODEL.arm)
    log.append(trials()[0])
    run = followed(tmp_path, rollout)
    view = run.look()
    assert view is not None
    assert view.chosen is not None
    motion = run.motion(view.chosen)
    near = rollout.approach(np.array([trials()[0].strike]), np.array([1.2, 0.1]), t_stay=0.3)
    assert np.linalg.norm(motion.trajectory.tip - [1.2, 0.1], axis=1).min() == pytest.approx(near.distance[0], abs=1e-4)


def test_what_is_no_log_is_refused_by_name(tmp_path: Path, rollout: CompiledRollout) -> None:
    (tmp_path / TRIALS).write_text("a,b\n1,2\n")
    with pytest.raises(InputError, match=r"trials\.csv: got .* a log of trials"):
        followed(tmp_path, rollout).look()


@pytest.mark.parametrize("name", ["lemon2024", "ur5e"])
@pytest.mark.parametrize(
    "kind",
    [{}, {"measured": True}, {"arriving": True, "limited": True}, {"criteria": ["tip_speed", "max_torque"]}],
)
def test_columns_are_those_that_their_names_say(name: str, kind: dict, tmp_path: Path) -> None:
    columns = TrialLog(tmp_path / TRIALS, preset(name).arm, **kind).columns
    read = TrialColumns.named(columns.header)
    assert {part: list(names) for part, names in read.parts.items()} == {p: list(n) for p, n in columns.parts.items()}
    assert (read.names, read.header) == (columns.names, columns.header)
