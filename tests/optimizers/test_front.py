"""Fronts against comparing every hit with every other."""

from __future__ import annotations

import csv
import io

import numpy as np
import pytest

from whiptool.goals.criteria import Effort, Miss, Speed
from whiptool.objective import Outcome, Trial
from whiptool.optimizers.front import ParetoFront, dominated_by, oriented

NAMES = ("q_si", "q_ei", "q_sf", "q_ef", "D")


def trial(number: int, values, *, hit: bool = True) -> Trial:
    pair = (0.0, 0.0)
    outcome = Outcome(0.01, hit, 0.3, pair, (3.0, 4.0), pair, pair, False, values=tuple(values), merit=-1.0)
    return Trial(number, (0.1 * number, 0.0, 0.0, 0.0, 1.0), outcome)


@pytest.mark.parametrize("criteria", [(Effort(), Miss()), (Speed(), Miss()), (Miss(), Speed())])
def test_no_hit_dominates_the_front_and_the_front_dominates_the_rest(criteria):
    rng = np.random.default_rng(1)
    values = np.round(rng.uniform(size=(300, 2)), 2)  # some are equal, and others differ by more than the resolution
    trials = [trial(i + 1, row, hit=i % 5 > 0) for i, row in enumerate(values)]
    front = ParetoFront.of(criteria, trials)
    signs = np.array([-1 if x.largest else 1 for x in criteria])
    costs = {i + 1: signs * values[i] for i in range(300) if i % 5}

    def dominates(a: np.ndarray, b: np.ndarray) -> bool:
        return bool((a <= b).all() and (a < b).any())

    kept = {trial.number for trial in front.trials}
    alone = {tuple(costs[i]) for i in costs if not any(dominates(costs[j], costs[i]) for j in costs)}
    assert {tuple(costs[i]) for i in kept} == alone
    assert len(kept) == len(alone) >= 2
    assert (np.diff(oriented(criteria, front.values)[:, 0]) > 0).all()


def test_gains_that_count_as_nothing_are_left_out_at_both_ends():
    """The first hit gains 5e-4 of the effort's range, the last one as much of the miss's."""
    values = [(0.9995, 3.0), (1.0, 2.0), (1.5, 1.5), (2.0, 1.0), (9.0, 0.999)]
    found = ParetoFront.of((Effort(), Miss()), [trial(i + 1, row) for i, row in enumerate(values)])
    assert [x.number for x in found.trials] == [2, 3, 4]


def test_how_far_a_hit_dominates_is_what_the_front_has_to_be_moved_by():
    front = ParetoFront.of((Effort(), Speed()), [trial(1, (1.0, 10.0)), trial(2, (2.0, 20.0)), trial(3, (5.0, 30.0))])
    given = np.array([[1.0, 10.0], [6.0, 5.0], [4.0, 30.0], [0.6, 10.0], [0.6, 12.0], [4.0, 34.0]])
    np.testing.assert_allclose(
        dominated_by(front.criteria, front.values, given), [0.0, -0.75, 0.25, 0.1, 0.1, 0.25], atol=1e-12
    )
    np.testing.assert_allclose(np.ptp(front.costs, axis=0), 1)


def test_hits_alone_are_on_a_front_and_numbers_that_are_none_are_not():
    trials = [trial(1, (1.0, 2.0)), trial(2, (0.1, 0.1), hit=False), trial(3, (np.inf, 0.1))]
    assert [x.number for x in ParetoFront.of((Effort(), Miss()), trials).trials] == [1]
    empty = ParetoFront.of((Effort(), Miss()), trials[1:2])
    assert empty.values.shape == (0, 2)
    assert empty.table(NAMES)["front"] == []


def test_tables_hold_strikes_and_both_criteria():
    front = ParetoFront.of((Effort(), Speed()), [trial(1, (1.0, 10.0)), trial(2, (2.0, 20.0))])
    table = front.table(NAMES)
    assert [x["maximised"] for x in table["criteria"]] == [False, True]
    assert [(x["trial"], x["effort"], x["speed"]) for x in table["front"]] == [(1, 1.0, 10.0), (2, 2.0, 20.0)]
    assert table["front"][1]["strike"] == dict(zip(NAMES, (0.2, 0, 0, 0, 1.0), strict=True))
    assert table["front"][1]["tip_speed"] == 5
    rows = list(csv.DictReader(io.StringIO(front.csv(NAMES))))
    assert [float(row["q_si"]) for row in rows] == [0.1, 0.2]
    assert [row["effort"] for row in rows] == ["1.0", "2.0"]
