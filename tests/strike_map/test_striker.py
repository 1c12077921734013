"""Corrections against SciPy's bounded least squares; refinement on residuals in closed form."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import lsq_linear
from straight_map import CurvedStriker

from whiptool.goals.goals import Goals
from whiptool.strike_map.striker import TOLERANCE, Landings, _Refinement, correct, refine

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
    change, left = correct(residuals, slopes, room, WIDTHS, damping=DAMPING)
    for i in range(20):
        expected = by_scipy(residuals[i], slopes[i], (room[0][i], room[1][i]))
        np.testing.assert_allclose(change[i], expected, rtol=1e-6, atol=1e-8)
        assert left[i] == pytest.approx(np.linalg.norm(residuals[i] + slopes[i] @ change[i]))


def test_in_a_narrow_box_it_is_the_best_inside_it():
    residuals, slopes, room = problems(60, room=1.0)
    change, _ = correct(residuals, slopes, room, WIDTHS, damping=DAMPING)
    assert (change >= room[0] - 1e-12).all()
    assert (change <= room[1] + 1e-12).all()

    def cost(i, change):
        left = residuals[i] + slopes[i] @ change
        return float(left @ left + np.sum((DAMPING * change / WIDTHS) ** 2))

    excess = [  # a few problems end before all sides are found
        cost(i, change[i]) / cost(i, by_scipy(residuals[i], slopes[i], (room[0][i], room[1][i]))) for i in range(60)
    ]
    assert np.median(excess) == pytest.approx(1, abs=1e-3)
    assert np.percentile(excess, 95) < 1.01


def test_each_problem_has_its_own_damping():
    residuals, slopes, room = problems(4, room=1e6)
    damping = np.array([0.01, 0.1, 1.0, 10.0])
    together, _ = correct(residuals, slopes, room, WIDTHS, damping=damping)
    for i in range(4):
        one, _ = correct(residuals[[i]], slopes[[i]], (room[0][[i]], room[1][[i]]), WIDTHS, damping=float(damping[i]))
        np.testing.assert_allclose(together[i], one[0])


def goals(count: int) -> Goals:
    return Goals(np.zeros((count, 2)), 0.01)


def starts(striker: CurvedStriker, count: int, away: float) -> np.ndarray:
    return striker.centre + np.random.default_rng(1).uniform(-away, away, (count, 5)) * striker.widths


def test_a_linear_goal_is_reached_in_a_few_steps_with_exact_derivatives():
    striker = CurvedStriker(0.0)
    first = starts(striker, 20, 0.2)
    found = refine(striker, goals(20), first, striker.derivatives(first, goals(20)))
    assert (found.struck.cost <= TOLERANCE).all()
    assert found.rollouts <= 20 * 4
    assert found.derivatives == 0
    np.testing.assert_allclose(striker.residuals(found.strikes), 0, atol=TOLERANCE)


def test_wrong_derivatives_are_mended_by_the_steps():
    """Broyden's rule: a linear goal is reached with derivatives that were a third off, and none taken anew."""
    striker = CurvedStriker(0.0)
    first = starts(striker, 20, 0.1)
    wrong = striker.derivatives(first, goals(20)) * np.random.default_rng(2).uniform(0.7, 1.3, (20, 3, 5))
    found = refine(striker, goals(20), first, wrong)
    assert (found.struck.cost <= TOLERANCE).all()
    assert found.derivatives == 0


def test_mended_derivatives_explain_the_last_step():
    striker = CurvedStriker(0.3)
    first = starts(striker, 5, 0.1)
    state = _Refinement(striker, goals(5), first, striker.derivatives(first, goals(5)))
    before = state.struck.residuals.copy()
    state.step(np.arange(5))
    change = state.strikes - first
    np.testing.assert_allclose(
        np.einsum("brm,bm->br", state.slopes, change), state.struck.residuals - before, atol=1e-12
    )


def test_where_derivatives_are_useless_exact_ones_are_taken():
    striker = CurvedStriker(0.3)
    first = starts(striker, 10, 0.1)
    useless = -striker.derivatives(first, goals(10))
    striker.taken = 0
    found = refine(striker, goals(10), first, useless)
    assert (found.struck.cost <= TOLERANCE).all()
    assert found.derivatives == striker.taken > 0
    assert refine(striker, goals(10), first).derivatives >= 10


def test_no_strike_comes_out_worse_and_finished_ones_are_left_alone():
    striker = CurvedStriker(3.0)
    first = starts(striker, 30, 0.4)
    before = striker.land(striker.admissible(first), goals(30)).cost
    found = refine(striker, goals(30), first)
    assert (found.struck.cost <= before + 1e-15).all()
    again = refine(striker, goals(30), found.strikes)
    done = found.struck.cost <= TOLERANCE
    assert done.sum() >= 5
    np.testing.assert_array_equal(again.strikes[done], found.strikes[done])


class SlowStriker(CurvedStriker):
    """Strikes whose tips pass a point, along a direction and at a speed that are linear in them."""

    velocity = np.array([0.8, 0.6])

    def tips(self, strikes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Places (B, 2) and velocities (B, 2)."""
        away = (strikes - self.centre) @ self.linear.T
        return away[:, :2], (1 + away[:, 2:]) * self.velocity

    def land(self, strikes: np.ndarray, goals: Goals) -> Landings:
        tips, velocities = self.tips(strikes)
        distance, nothing = np.linalg.norm(tips, axis=1), np.zeros(len(strikes))
        hit = (distance <= goals.hit_radius) & goals.arrives(velocities)
        return Landings(goals.residuals(tips, velocities), distance, nothing, nothing, hit)

    def derivatives(self, strikes: np.ndarray, goals: Goals) -> np.ndarray:
        by_tip = np.broadcast_to(self.linear[:2], (len(strikes), 2, 5))
        by_velocity = np.broadcast_to(self.velocity[:, None] * self.linear[2], (len(strikes), 2, 5))
        return goals.residual_slopes(self.tips(strikes)[1], by_tip, by_velocity)


def test_a_strike_that_misses_by_a_hair_of_speed_is_refined():
    """What is missing costs less than the tolerance, and the strike is no hit all the same."""
    striker = SlowStriker(0.0)
    asked = Goals(np.zeros((1, 2)), 0.05, speed=1.0)
    short = np.linalg.lstsq(striker.linear, np.array([0.0, 0.0, -1e-3]), rcond=None)[0]
    first = (striker.centre + short)[None]
    before = striker.land(first, asked)
    assert 0 < before.cost[0] < TOLERANCE
    assert not before.hit[0]
    found = refine(striker, asked, first)
    assert found.struck.hit[0]


def test_a_hit_is_better_than_what_costs_less_and_is_none():
    """A limit may be missed by less than what a hit leaves."""
    nothing = np.zeros(2)
    hit, none = (
        Landings(np.full((2, 3), left), nothing, nothing, nothing, np.array([is_hit, False]))
        for left, is_hit in ((1e-3, True), (1e-6, False))
    )
    np.testing.assert_array_equal(hit.beats(none), [True, False])
    np.testing.assert_array_equal(none.beats(hit), [False, True])


def test_of_two_refinements_the_better_of_each_row_is_kept():
    striker = CurvedStriker(0.3)
    near, far = starts(striker, 6, 0.01), starts(striker, 6, 0.3)
    first = refine(striker, goals(6), far, steps=0)
    other = refine(striker, goals(2), near[[1, 4]], steps=0)
    both = first.improved(np.array([1, 4]), other)
    np.testing.assert_array_equal(both.strikes[[1, 4]], near[[1, 4]])
    np.testing.assert_array_equal(both.strikes[[0, 2, 3, 5]], far[[0, 2, 3, 5]])
    assert both.rollouts == first.rollouts + other.rollouts
    assert both.struck.cost[1] == pytest.approx(other.struck.cost[0])
    worse = both.improved(np.array([1]), refine(striker, goals(1), far[[1]], steps=0))
    np.testing.assert_array_equal(worse.strikes[1], near[1])
