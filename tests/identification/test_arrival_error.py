"""Errors of a direction against a million draws of it."""

from __future__ import annotations

import numpy as np
import pytest

from whiptool.identification.arrival_error import PACE, angle_probability, direction_error


@pytest.mark.parametrize(("angle", "cone", "error"), [(0.0, 0.17, 0.1), (0.15, 0.17, 0.05), (0.4, 0.17, 0.2)])
def test_the_probability_of_a_cone_is_that_of_draws(angle, cone, error):
    draws = angle + error * np.random.default_rng(0).standard_normal(1_000_000)
    found = angle_probability(np.array([angle]), cone, np.array([error]))[0]
    assert found == pytest.approx((np.abs(draws) <= cone).mean(), abs=2e-3)


def test_a_direction_errs_by_what_the_path_is_off_over_what_the_tip_moves_on():
    """A path that is off by a sine of the pace's size turns the velocity by about as much; a fast tip by less."""
    speed, off = 5.0, 0.004
    t = np.linspace(0, PACE, 2001)
    across = off * np.sin(t / PACE)  # its slope at first is off / PACE
    turned = np.arctan2(np.gradient(across, t), speed)[0]
    assert direction_error(off, np.array([speed]))[0] == pytest.approx(turned, rel=1e-3)
    assert direction_error(off, np.array([10 * speed]))[0] == pytest.approx(turned / 10, rel=1e-3)
    assert direction_error(off, np.array([0.0]))[0] < np.pi / 2
