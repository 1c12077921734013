"""Maps part by part: what is there is not made again, and what is opened is what was built."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

pytest.importorskip("torch")

from whiptool.errors import InputError
from whiptool.models import preset
from whiptool.strike_map.answers import Answers
from whiptool.strike_map.building import built
from whiptool.strike_map.map_files import opened
from whiptool.strike_map.strike_map import Gate

STRIKER: Any = SimpleNamespace(rollout=SimpleNamespace(model=preset("lemon2024")))


class Toy:
    """A building whose parts tell how many were made before them.

    Args:
        parts: Of the plan.
        trials: Of the plan.
    """

    striker, region = STRIKER, None

    def __init__(self, parts: int, trials: int) -> None:
        self.plan, self.made = SimpleNamespace(parts=parts, gate_strikes=trials), 0

    def part(self, before: list[Answers]) -> Answers:
        self.made += 1
        first = sum(map(len, before))
        strikes = np.arange(first, first + 3, dtype=float)[:, None] * np.ones(5)
        return Answers(strikes, np.ones((3, 2)), np.ones((3, 2)), np.ones((3, 2, 6)), np.ones((3, 2, 6)))

    def gate(self, answers: Answers, *, progress: bool = False) -> Gate:
        rng = np.random.default_rng(0)
        return Gate.trained(rng.normal(size=(40, 4)), rng.random(40) < 0.5, seed=0)


def test_a_building_goes_on_with_what_is_there(tmp_path):
    whole: Any = Toy(4, 10)
    expected = built(whole, tmp_path)
    assert whole.made == 4
    np.testing.assert_array_equal(expected.answers.strikes[:, 0], np.arange(12))
    again: Any = Toy(4, 10)
    for lost in ("answers-002.npz", "answers-003.npz"):
        (tmp_path / lost).unlink()
    np.testing.assert_array_equal(built(again, tmp_path).answers.strikes, expected.answers.strikes)
    assert again.made == 2


def test_what_is_opened_is_what_was_built(tmp_path):
    building: Any = Toy(2, 10)
    whole = built(building, tmp_path)
    other = opened(STRIKER, building.region, tmp_path)
    np.testing.assert_array_equal(other.answers.tip_slopes, whole.answers.tip_slopes)
    seen = np.random.default_rng(1).normal(size=(5, 4))
    assert whole.gate is not None
    assert other.gate is not None
    np.testing.assert_array_equal(other.gate.odds(seen), whole.gate.odds(seen))


def test_without_trials_there_is_no_gate(tmp_path):
    building: Any = Toy(1, 0)
    assert built(building, tmp_path).gate is None
    assert opened(STRIKER, building.region, tmp_path).gate is None


def test_an_empty_folder_is_refused(tmp_path):
    region: Any = None
    with pytest.raises(InputError, match=r"^strike map: got .*every worker"):
        opened(STRIKER, region, tmp_path)
