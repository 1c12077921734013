"""What a search found: its first hit, its count of trials, and a message for each way to end."""

from __future__ import annotations

from dataclasses import replace

import pytest

from whiptool.models.strike import Strike
from whiptool.objective import Outcome, Trial
from whiptool.optimizers.result import MESSAGES, Result, Status


def outcome(miss: float, hit: bool = False) -> Outcome:
    return Outcome(miss, hit, 0.5, (1.0, 0.0), (3.0, 4.0), (1.0, 2.0), (0.1, 0.2), False)


def result(*misses: float, radius: float = 0.06) -> Result:
    trace = tuple(Trial(i + 1, (0.0,) * 5, outcome(x, x <= radius)) for i, x in enumerate(misses))
    best = min((trial.outcome for trial in trace), key=lambda x: x.miss_distance, default=None)
    strike = None if best is None else Strike((0.0, 0.1), (0.2, 0.3), 0.5)
    return Result("random", Status.MAX_TRIALS, MESSAGES[Status.MAX_TRIALS], strike, best, trace, 0, 1.0)


@pytest.mark.parametrize(
    ("misses", "first"),
    [((0.3, 0.05, 0.2, 0.01), 2), ((0.06,), 1), ((0.3, 0.061), None), ((), None)],
)
def test_the_first_hit_is_the_first_and_not_the_best(misses: tuple[float, ...], first: int | None):
    found = result(*misses)
    assert found.first_hit == first
    assert found.n_trials == len(misses)


def test_the_best_strike_hits_or_misses():
    assert (result(0.3, 0.05).hit, result(0.3, 0.05).miss_distance) == (True, 0.05)
    assert (result(0.3, 0.1).hit, result(0.3, 0.1).miss_distance) == (False, 0.1)
    assert (result().hit, result().miss_distance) == (False, float("inf"))


def test_an_interrupted_search_ends_the_work_it_is_part_of():
    found = result(0.3)
    assert found.uninterrupted() is found
    with pytest.raises(KeyboardInterrupt):
        replace(found, status=Status.INTERRUPTED).uninterrupted()


def test_numbers_of_trials_are_their_own():
    """A search that goes on has trials whose numbers do not begin at 1."""
    trace = tuple(Trial(n, (0.0,) * 5, outcome(0.1 if n < 12 else 0.05, n >= 12)) for n in (11, 12, 13))
    found = Result("random", Status.HIT, "", None, None, trace, 0, 0.0)
    assert found.first_hit == 12
    assert found.n_trials == 3


def test_one_line_says_method_status_and_best():
    assert repr(result(0.3, 0.12345)) == "Result(random: max_trials, 2 trials, best miss 0.1235 m: miss)"
    assert repr(result()) == "Result(random: max_trials, 0 trials, no trial)"


def test_every_status_has_its_own_message():
    assert set(MESSAGES) == set(Status)
    assert len(set(MESSAGES.values())) == len(Status)
    assert len({status.value for status in Status}) == len(Status)
