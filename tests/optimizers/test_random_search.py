"""Random search is uniform in the box and needs an end."""

from __future__ import annotations

import numpy as np
import pytest
from counted_bowl import Counted
from toy_objectives import BOUNDS, Enough

from whiptool.errors import InputError
from whiptool.optimizers.random_search import random_search


def test_random_strikes_are_uniform_and_need_an_end():
    bowl = Counted(most=4000)
    with pytest.raises(Enough):
        random_search(bowl, seed=2)
    lower, upper = BOUNDS.box
    unit = (np.array(bowl.refined) - lower) / (upper - lower)
    np.testing.assert_allclose(unit.mean(axis=0), 0.5, atol=0.02)
    np.testing.assert_allclose(unit.var(axis=0), 1 / 12, rtol=0.06)
    endless = Counted()
    endless.max_trials = None
    with pytest.raises(InputError, match="max trials"):
        random_search(endless, seed=0)
    timed = Counted(most=3)
    timed.max_trials, timed.max_time = None, 1.0
    with pytest.raises(Enough):
        random_search(timed, seed=0)
