"""Work units: noise, order of merit, and the search's bookkeeping."""

from __future__ import annotations

import json
from types import SimpleNamespace

import numpy as np
import pytest

from papers.nah2023 import published, units
from papers.nah2023.units import (
    BOUNDS,
    CONTROLLER,
    GROUPS,
    DirectUnit,
    GradientUnit,
    by_merit,
    first_strikes,
    noisy,
)
from whiptool.models.strike import JointSpace
from whiptool.optimizers import Result, Status
from whiptool.rollout.interface import Rollout

SPACE = JointSpace(units.NAH2023.arm)


class Pretended(Rollout):
    """It rolls nothing out."""

    model, timestep = units.NAH2023, units.TIMESTEP

    def trajectory(self, strike, *, t_stay=0.0):
        raise NotImplementedError


def test_groups_are_all_of_a_strikes_vector():
    taken = np.concatenate([np.arange(9)[group] for group in GROUPS.values()])
    np.testing.assert_array_equal(taken, np.arange(9))
    assert len(BOUNDS.box[0]) == 9
    assert np.size(CONTROLLER.law.parameters()["K"]) == 16


def test_the_nearest_come_first_and_equals_keep_their_order():
    strikes = np.arange(8.0).reshape(4, 2)
    ordered, misses = by_merit(strikes, np.array([0.3, 0.1, np.inf, 0.1]))
    assert misses.tolist() == [0.1, 0.1, 0.3, np.inf]
    assert ordered[:, 0].tolist() == [2, 6, 0, 4]


@pytest.mark.parametrize(("nearest", "hit"), [(0.04, True), (0.06, False)])
def test_a_search_says_what_it_found(monkeypatch, nearest: float, hit: bool):
    """By a search that is pretended: its misses in order, and whether the least is within 5 cm."""
    import whiptool.optimizers

    asked = []

    def search(objective, method):
        asked.append((objective, method))
        misses, radius = (0.9, nearest, 0.5), objective.target.hit_radius
        outcomes = [SimpleNamespace(miss_distance=miss, hit=miss <= radius) for miss in misses]
        trials = [SimpleNamespace(number=i + 1, outcome=outcome) for i, outcome in enumerate(outcomes)]
        return Result(method, Status.MAX_TRIALS, "", None, None, tuple(trials), 0, 1.0)

    monkeypatch.setattr(whiptool.optimizers, "search", search)
    monkeypatch.setattr(units, "simulator", lambda *given: Pretended())
    monkeypatch.setattr(units, "LastNodes", lambda rollout, nodes, until: rollout)
    found = DirectUnit(target=1, nodes=15, cap=40).run(None, 1)
    assert found["misses"] == [0.9, nearest, 0.5]
    assert (found["evaluations"], found["best"], found["hit"]) == (3, nearest, hit)
    json.dumps(found)
    [(objective, method)] = asked
    assert method == "directl"
    assert objective.target.position == published.TARGETS[1]
    assert objective.target.hit_radius == published.HIT_RADIUS


def test_an_interrupted_search_is_no_result(monkeypatch):
    """A unit that is kept must be whole."""
    import whiptool.optimizers

    stopped = Result("gradient", Status.INTERRUPTED, "", None, None, (), 0, 1.0)
    monkeypatch.setattr(whiptool.optimizers, "search", lambda objective, method: stopped)
    monkeypatch.setattr(units, "simulator", lambda *given: Pretended())
    with pytest.raises(KeyboardInterrupt):
        GradientUnit(target=0, cap=10).run(None, 1)


def test_noise_is_on_its_group_alone_and_within_five_percent_of_the_width():
    lower, upper = BOUNDS.box
    middle = (lower + upper) / 2
    for group in GROUPS.values():
        share = (noisy(middle, group, 500, np.random.default_rng(0)) - middle) / (upper - lower)
        assert np.abs(share[:, group]).max() == pytest.approx(0.05, rel=0.02)
        assert np.abs(np.delete(share, np.r_[group], axis=1)).max() == 0


def test_first_strikes_are_those_of_their_logs():
    """The second and the 19th, as printed there."""
    found = first_strikes()
    assert found[1] == pytest.approx([-1.36136, 0, 0, 1.41372, 1.72788, 0, 0, 1.41372, 0.95], abs=1e-5)
    assert found[18] == pytest.approx([-0.94248, 0, 0, 1.41372, 1.72788, 0, 0, 1.41372, 1.31667], abs=1e-5)


def test_first_strikes_are_a_third_of_the_box_from_its_middle():
    """Along one axis at a time, to both sides, within the box."""
    lower, upper = BOUNDS.box
    share = (first_strikes() - lower) / (upper - lower)
    assert share.shape == (19, 9)
    assert share[0] == pytest.approx(np.full(9, 0.5))
    for axis in range(9):
        low, high = share[1 + 2 * axis], share[2 + 2 * axis]
        assert (low[axis], high[axis]) == pytest.approx((1 / 6, 5 / 6))
        assert np.delete(np.array([low, high]), axis, axis=1) == pytest.approx(0.5)
