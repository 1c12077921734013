"""Series of a comparison whose numbers are given."""

from __future__ import annotations

import numpy as np

from whiptool.comparison.series import Series

TRIALS = np.array([[1, 4, 600, 2], [3, 5, 7, 600]])


def series(method="sac", observation="goal", convention="mean-first", radius=0.06, trials=TRIALS, **more) -> Series:
    fields = {"training_trials": 1500.0, "n_diverged": 3, "wall_time": 2.5, **more}
    return Series(method, observation, convention, radius, trials, trials < 600, **fields)
