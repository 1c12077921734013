"""Corrections against SciPy's bounded least squares."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from whiptool.strike_map.correction import correct

WIDTHS = np.array([1.0, 2.0, 0.5, 3.0, 1.5])
DAMPING = 0.03


def problems(count: int, *, room: float):
    rng = np.random.default_rng(0)
    residuals, slopes = rng.normal(size=(count, 3)), rng.normal(size=(count, 3, 5))
    return residuals, slopes, (-room * rng.uniform(0, 1, (count, 5)), room * rng.uniform(0, 1, (count, 5)))


def by_scipy(residuals, slopes, room):
    matrix = np.vstack([slopes * WIDTHS, DAMPING * np.eye(5)])
    bounds = (room[0] / WIDTHS, room[1] / WIDTHS)
    return lsq_linear(matrix, np.r_[-residuals, np.zeros(5)], bounds, tol=1e-14).x * WIDTHS


def test_in_a_wide_box_it_is_the_damped_least_squares_solution():
    residuals, slopes, room = problems(20, room=1e6)
    found = correct(residuals, slopes, room, WIDTHS, damping=DAMPING)
    for i in range(20):
        expected = by_scipy(residuals[i], slopes[i], (room[0][i], room[1][i]))
        np.testing.assert_allclose(found.change[i], expected, rtol=1e-6, atol=1e-8)
        left = residuals[i] + slopes[i] @ found.change[i]
        assert found.left[i] == pytest.approx(np.linalg.norm(left))
        assert found.size[i] == pytest.approx(np.linalg.norm(found.change[i] / WIDTHS))


def test_in_a_narrow_box_it_is_the_best_inside_it():
    residuals, slopes, room = problems(60, room=1.0)
    found = correct(residuals, slopes, room, WIDTHS, damping=DAMPING)
    assert (found.change >= room[0] - 1e-12).all()
    assert (found.change <= room[1] + 1e-12).all()

    def cost(i, change):
        left = residuals[i] + slopes[i] @ change
        return float(left @ left + np.sum((DAMPING * change / WIDTHS) ** 2))

    excess = [  # a few problems end before all sides are found
        cost(i, found.change[i]) / cost(i, by_scipy(residuals[i], slopes[i], (room[0][i], room[1][i])))
        for i in range(60)
    ]
    assert np.median(excess) == pytest.approx(1, abs=1e-3)
    assert np.percentile(excess, 95) < 1.01


def test_each_problem_has_its_own_damping():
    residuals, slopes, room = problems(4, room=1e6)
    damping = np.array([0.01, 0.1, 1.0, 10.0])
    together = correct(residuals, slopes, room, WIDTHS, damping=damping)
    for i in range(4):
        one = correct(residuals[[i]], slopes[[i]], (room[0][[i]], room[1][[i]]), WIDTHS, damping=float(damping[i]))
        np.testing.assert_allclose(together.change[i], one.change[0])
