"""Descents and sensitivities: on the real model against differences, and what counts as another solution."""

from __future__ import annotations

import numpy as np
import pytest

from whiptool.models.strike import StrikeBounds
from whiptool.studies.reproduction.nah2023 import published
from whiptool.studies.reproduction.nah2023.sensitivity import path_sensitivity
from whiptool.studies.reproduction.nah2023.solutions import descend, distinct, slope_within
from whiptool.studies.reproduction.nah2023.units import BOUNDS, simulator

TARGET = np.array(published.TARGETS[2])


def test_descent_hits_and_its_sensitivity_is_that_of_differences():
    """From the published strike, which the tip misses by far, to the target; there the tip's path moves with each
    parameter as the distance between the old closest point and the new path says."""
    rollout, stay = simulator(None), 0.6
    strikes, misses = descend(rollout, BOUNDS, published.STRIKES[2:3], TARGET, t_stay=stay)
    near = rollout.approach(strikes, TARGET, t_stay=stay)
    assert near.distance == pytest.approx(misses)
    assert misses[0] < 1e-3
    lower, upper = BOUNDS.box
    assert np.all((strikes >= lower) & (strikes <= upper))
    found = path_sensitivity(rollout, strikes, near, t_stay=stay)[0]
    step = 1e-3  # so that the path moves by more than its segments, of a step each, deviate from a smooth curve
    sides = np.concatenate([strikes + sign * step * np.eye(9) for sign in (1, -1)])
    moved = rollout.approach(sides, near.tip[0], t_stay=stay).distance.reshape(2, 9).mean(axis=0) / step
    assert found == pytest.approx(moved, rel=0.01)


def test_slope_ignores_what_leads_out_of_the_box():
    """Beyond reach the miss has a slope; where all parameters but one stand at the bound that it points to, only that
    one's is left."""
    rollout, far = simulator(None), np.array([3.0, 0.0, 0.0])
    strike = published.STRIKES[3]
    _, slope = rollout.gradient(strike[None], far, t_stay=0.3)
    lower, upper = BOUNDS.box
    below, above = strike - 0.1, strike + 0.1
    for j in range(8):  # with what lowers the miss beyond the bound
        below[j], above[j] = (strike[j], strike[j] + 0.1) if slope[0, j] > 0 else (strike[j] - 0.1, strike[j])
    tight = StrikeBounds(tuple(below), tuple(above))
    left = slope_within(rollout, tight, strike, far, t_stay=0.3)
    assert left == pytest.approx(abs(slope[0, 8]) * 0.2)
    assert slope_within(rollout, BOUNDS, strike, far, t_stay=0.3) == pytest.approx(
        np.abs(slope[0] * (upper - lower)).max()
    )


def test_solutions_are_distinct_by_a_share_of_the_box():
    lower, upper = BOUNDS.box
    middle = (lower + upper) / 2
    near, other = middle.copy(), middle.copy()
    near[0] += 0.005 * (upper - lower)[0]
    other[8] += 0.02 * (upper - lower)[8]
    assert distinct(np.array([middle, near, other]), BOUNDS) == [0, 2]
