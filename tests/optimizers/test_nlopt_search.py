"""NLopt's methods: that they descend and stay in the box, and how they end."""

from __future__ import annotations

import numpy as np
import pytest
from counted_bowl import Counted
from toy_objectives import BOUNDS, Enough

from whiptool.optimizers.nlopt_search import DIRECT_L, nlopt_names, nlopt_search


@pytest.mark.parametrize("algorithm", [DIRECT_L, "GN_CRS2_LM", "GN_ISRES"])
def test_they_descend_within_the_box(algorithm):
    bowl = Counted(most=1500)
    with pytest.raises(Enough):
        nlopt_search(bowl, seed=3, algorithm=algorithm)
    lower, upper = BOUNDS.box
    tried = np.array(bowl.refined)
    assert ((tried >= lower) & (tried <= upper)).all()
    span = np.linalg.norm(upper - lower)
    assert bowl.miss(tried).min() < 0.03 * span
    if algorithm != "GN_CRS2_LM":  # which begins with a random population
        np.testing.assert_allclose(tried[0], (lower + upper) / 2)
    again = Counted(most=50)
    with pytest.raises(Enough):
        nlopt_search(again, seed=3, algorithm=algorithm)
    np.testing.assert_array_equal(again.refined, tried[:50])


def test_a_converged_search_returns():
    bowl = Counted(most=200_000)
    nlopt_search(bowl, seed=1, algorithm="GN_CRS2_LM")
    assert bowl.miss(np.array(bowl.refined)).min() < 1e-5
    assert all(name.startswith("GN_") for name in nlopt_names())
    assert DIRECT_L in nlopt_names()


class StopsAtOnce(Counted):
    """Ends the search at its fourth strike, and counts the strikes that come all the same."""

    def __init__(self) -> None:
        super().__init__()
        self.asked = 0

    def trial(self, strike):
        self.asked += 1
        if self.asked >= 4:
            raise Enough
        return super().trial(strike)


@pytest.mark.parametrize("algorithm", [DIRECT_L, "GN_CRS2_LM", "GN_ISRES", "GN_ESCH", "GN_AGS"])
def test_nothing_is_tried_after_the_search_was_ended(algorithm):
    """CRS2 fills its first population of 60 points before it looks whether it is to stop."""
    bowl = StopsAtOnce()
    with pytest.raises(Enough):
        nlopt_search(bowl, seed=3, algorithm=algorithm)
    assert bowl.asked == 4
