"""Uniformly random strikes: the baseline that every method has to beat."""

from __future__ import annotations

import numpy as np

from whiptool.errors import InputError
from whiptool.objective import Objective


def random_search(objective: Objective, *, seed: int) -> None:
    """Try random strikes until the objective stops the search.

    Raises:
        InputError: The objective has no limit on trials or time.
        SearchStopped: The objective ended the search.
    """
    if objective.max_trials is None and objective.max_time is None:
        raise InputError(
            "max trials",
            None,
            "a number of trials or seconds, for a method that never ends by itself",
            "give max_trials or max_time",
        )
    rng = np.random.default_rng(seed)
    while True:
        objective.trial(objective.admissible(objective.bounds.sample(rng, 1))[0])
