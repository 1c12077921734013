"""What an adaptation did, in one line for people."""

from __future__ import annotations

import dataclasses

import pytest

from whiptool.adaptation.plan_search import Plan
from whiptool.adaptation.ports import Seen
from whiptool.adaptation.steps import Step, Steps, percent
from whiptool.identification.film_judgement import Judgement
from whiptool.models.strike import Strike

PLAN = Plan((-1.0, 0.5, 2.0, 0.8, 0.8), 0.304, 0.01, 0.0, None, "a strike", 0.1)
LOOK = Step(0, dataclasses.replace(PLAN, probability=None), Seen(None, None), None, None)
UNSEEN = Step(1, PLAN, Seen(None, None), None, None)
MISSED = Step(2, PLAN, Seen(None, None), None, Judgement(0.1124, 0.0052, 0.01))
HIT = Step(3, dataclasses.replace(PLAN, probability=0.97), Seen(None, None), None, Judgement(0.0081, 0.0043, 0.99))


def test_an_adaptation_tells_strikes_hits_misses_and_probabilities() -> None:
    steps = Steps([LOOK, UNSEEN, MISSED, HIT])
    assert repr(steps) == (
        "Steps(3 strikes, 1 hit; misses: not seen, 112 ± 5 mm, 8 ± 4 mm; "
        "probability of a hit as planned: 30 %, 30 %, 97 %)"
    )
    assert steps.strikes == [UNSEEN, MISSED, HIT]
    assert HIT.strike == Strike((-1.0, 0.5), (2.0, 0.8), 0.8)
    assert repr(Steps([LOOK])) == "Steps(0 strikes)"


def test_of_many_strikes_the_last_ones_are_told() -> None:
    told = repr(Steps([LOOK, *[MISSED] * 40, HIT]))
    assert told.startswith("Steps(41 strikes, 1 hit; misses of the last 5: 112 ± 5 mm, ")
    assert "8 ± 4 mm; probability" in told
    assert len(told) < 200


def test_a_step_tells_its_verdict() -> None:
    assert repr(HIT) == "Step(strike 3: hit, 8 ± 4 mm; probability of a hit as planned 97 %)"
    assert repr(MISSED) == "Step(strike 2: missed, 112 ± 5 mm; probability of a hit as planned 30 %)"
    assert repr(UNSEEN) == "Step(strike 1: not seen; probability of a hit as planned 30 %)"
    assert repr(LOOK) == "Step(first look at the whip)"


@pytest.mark.parametrize(
    ("probability", "said"), [(0, "0 %"), (0.004, "< 1 %"), (0.304, "30 %"), (0.9951, "> 99 %"), (1, "100 %")]
)
def test_a_probability_is_never_rounded_to_a_certainty(probability: float, said: str) -> None:
    assert percent(probability) == said
