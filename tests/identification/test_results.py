"""Runs of a fit from several starts are judged by the best."""

from __future__ import annotations

import numpy as np
import pytest

from whiptool.identification.results import FittedStart, judge_starts
from whiptool.identification.solver import Ending, Solution


def test_starts_that_end_far_above_the_best_have_failed():
    """Of 1,000 readings and two unknowns, 13.8 above the best in twice the cost is chi-squared's 0.999."""
    ends = (650.0, 500.0, 506.0, 507.5)
    runs = [FittedStart({}, {"a": 1.0, "b": 1.0}, Solution(np.zeros(2), [], cost, Ending.CONVERGED)) for cost in ends]
    judged = judge_starts(runs, 1000)
    assert [run.solution.cost for run in judged] == [500.0, 506.0, 507.5, 650.0]
    assert [run.failed for run in judged] == [False, False, True, True]
    assert judged[-1].over_best == pytest.approx(1.3)
