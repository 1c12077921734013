"""What a strike is judged by: names, two of them, and noise where it says something."""

from __future__ import annotations

import numpy as np
import pytest

from whiptool.commands.options.criteria_options import CriteriaOptions
from whiptool.errors import InputError
from whiptool.goals.criteria import Robustness
from whiptool.models import default_bounds, preset

BOUNDS = default_bounds(preset("lemon2024").arm)


def names(**given) -> list[str]:
    options = CriteriaOptions(**given)
    options.check()
    return [criterion.name for criterion in options.build_criteria(BOUNDS)]


def test_the_miss_alone_is_no_criterion():
    assert names() == names(minimise="miss") == []
    assert not CriteriaOptions().judged
    assert names(minimise="speed") == ["speed"]
    assert names(pareto=("effort", "miss")) == ["effort", "miss"]
    assert CriteriaOptions(pareto=("effort", "miss")).judged


def test_noise_is_one_number_or_one_of_each():
    for given, expected in (((0.02,), [0.02] * 5), ((0.1, 0.2, 0.3, 0.4, 0.05), [0.1, 0.2, 0.3, 0.4, 0.05])):
        (found,) = CriteriaOptions(minimise="robustness", noise=given).build_criteria(BOUNDS)
        assert isinstance(found, Robustness)
        np.testing.assert_array_equal(found.noise, expected)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"pareto": ("effort", "effort")}, "two different criteria"),
        ({"pareto": ("effort", "miss"), "minimise": "speed"}, "only without --pareto"),
        ({"noise": (0.02,)}, "only with --minimise robustness"),
        ({"minimise": "robustness", "noise": (-1.0,)}, "0 or more"),
    ],
)
def test_contradictions_are_refused(given, said):
    with pytest.raises(InputError, match=said):
        CriteriaOptions(**given).check()
