"""The building of a map as its folder shows it."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from whiptool.following.map_building import FollowedMap
from whiptool.strike_map.answers import Answers
from whiptool.strike_map.building import MapPlan
from whiptool.strike_map.map_files import save_part


def part(count: int) -> Answers:
    rng = np.random.default_rng(count)
    strikes, slopes = rng.normal(size=(count, 5)), rng.normal(size=(2, count, 2, 6))
    return Answers(strikes, *rng.normal(size=(2, count, 2)), *slopes)


def test_answers_are_counted_part_by_part(tmp_path: Path) -> None:
    building: Any = SimpleNamespace(plan=MapPlan(random_strikes=2048, rounds=2))
    run = FollowedMap(tmp_path, "a map", building)
    first = run.look()
    assert first is not None
    assert (first.facts, first.chosen, first.charts) == ({"parts": "0 of 3", "answers": "0"}, None, ())
    save_part(tmp_path, 0, part(7))
    run.look()
    save_part(tmp_path, 1, part(4))
    save_part(tmp_path, 2, part(0))  # a round may add nothing
    view = run.look()
    assert view is not None
    assert view.facts == {"parts": "3 of 3", "answers": "11"}
    in_all, of_part = view.charts[0].curves
    np.testing.assert_array_equal(in_all.y, [7, 11, 11])
    np.testing.assert_array_equal(of_part.y, [7, 4, 0])
    assert view.chosen is not None
    np.testing.assert_array_equal(view.chosen.vector, part(4).strikes[-1])
    assert len(next(iter(view.points.values()))) == 11
    assert run.look() is None
