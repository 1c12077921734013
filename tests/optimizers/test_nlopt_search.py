"""NLopt's methods and random search: where they begin, that they descend and stay in the box, how they end."""

from __future__ import annotations

import numpy as np
import pytest
from toy_objectives import BOUNDS, Bowl, Enough

from whiptool.errors import InputError
from whiptool.optimizers.nlopt_search import DIRECT_L, nlopt_names, nlopt_search
from whiptool.optimizers.random_search import random_search


class Counted(Bowl):
    max_trials: int | None = 5
    max_time: float | None = None

    def trial(self, strike):
        return self.gradient(strike)[0]


@pytest.mark.parametrize("algorithm", [DIRECT_L, "GN_CRS2_LM", "GN_ISRES"])
def test_they_descend_within_the_box(algorithm):
    bowl = Counted(most=1500)
    with pytest.raises(Enough):
        nlopt_search(bowl, seed=3, algorithm=algorithm)  # type: ignore[arg-type]
    lower, upper = BOUNDS.box
    tried = np.array(bowl.refined)
    assert ((tried >= lower) & (tried <= upper)).all()
    span = np.linalg.norm(upper - lower)
    assert bowl.miss(tried).min() < 0.03 * span
    if algorithm != "GN_CRS2_LM":  # which begins with a random population
        np.testing.assert_allclose(tried[0], (lower + upper) / 2)
    again = Counted(most=50)
    with pytest.raises(Enough):
        nlopt_search(again, seed=3, algorithm=algorithm)  # type: ignore[arg-type]
    np.testing.assert_array_equal(again.refined, tried[:50])


def test_a_converged_search_returns():
    bowl = Counted(most=200_000)
    nlopt_search(bowl, seed=1, algorithm="GN_CRS2_LM")  # type: ignore[arg-type]
    assert bowl.miss(np.array(bowl.refined)).min() < 1e-5
    assert all(name.startswith("GN_") for name in nlopt_names())
    assert DIRECT_L in nlopt_names()


def test_random_strikes_are_uniform_and_need_an_end():
    bowl = Counted(most=4000)
    with pytest.raises(Enough):
        random_search(bowl, seed=2)  # type: ignore[arg-type]
    lower, upper = BOUNDS.box
    unit = (np.array(bowl.refined) - lower) / (upper - lower)
    np.testing.assert_allclose(unit.mean(axis=0), 0.5, atol=0.02)
    np.testing.assert_allclose(unit.var(axis=0), 1 / 12, rtol=0.06)
    endless = Counted()
    endless.max_trials = None
    with pytest.raises(InputError, match="max-trials"):
        random_search(endless, seed=0)  # type: ignore[arg-type]
    timed = Counted(most=3)
    timed.max_trials, timed.max_time = None, 1.0
    with pytest.raises(Enough):
        random_search(timed, seed=0)  # type: ignore[arg-type]
