"""Descents and sensitivities: on the real model against differences, and what counts as another solution."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from papers.nah2023 import published
from papers.nah2023.solutions import (
    LinksThen,
    across,
    bounded_step,
    descend,
    distinct,
    links_at,
    model_rows,
    path_sensitivity,
)
from papers.nah2023.units import BOUNDS, simulator
from whiptool.models.presets import NAH2023
from whiptool.models.strike import strike_names
from whiptool.rollout.compiled import ChainPath

TARGET = np.array(published.TARGETS[2])


@pytest.mark.slow
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


class Pendulums:
    """Three rigid links in a plane, each at an angle of its own (three parameters) that the time adds to; where it is
    stretched it reaches 1.5 m. Everything has a closed form."""

    timestep, model = 1e-3, None
    lengths = np.array([0.6, 0.5, 0.4])

    def angles(self, strikes, t):
        return strikes[:, :3] + np.array([1.0, 0.5, 0.2]) * np.asarray(t)[:, None]

    def links(self, strikes, t):
        angle = self.angles(strikes, t)
        unit = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=-1)
        turned = np.stack([-unit[..., 1], unit[..., 0], 0 * angle], axis=-1)
        slopes = np.einsum("bki,k,kj->bkij", turned, self.lengths, np.eye(3))
        velocities = turned * (self.lengths * np.array([1.0, 0.5, 0.2]))[:, None]
        return LinksThen(unit * self.lengths[:, None], velocities, slopes)


def test_rows_of_the_model_are_the_hessian_where_the_target_lies_beyond_a_straight_chain():
    """Against differences of half the squared miss in closed form, the instant eliminated by Schur's complement."""
    chain, target = Pendulums(), np.array([1.7, 0.0, 0.0])
    x = np.zeros((1, 3))

    def half_square(at: np.ndarray) -> float:
        return 0.5 * float(((chain.links(at[None, :3], at[3:]).vectors.sum(axis=1)[0] - target) ** 2).sum())

    e, z = 1e-4 * np.eye(4), np.zeros(4)
    H = np.array(
        [[sum(s * u * half_square(z + s * a + u * b) for s in (1, -1) for u in (1, -1)) / 4e-8 for b in e] for a in e]
    )
    schur = H[:3, :3] - np.outer(H[:3, 3], H[:3, 3]) / H[3, 3]
    links = chain.links(x, [0.0])
    A = model_rows(links, links.vectors.sum(axis=1) - target, np.ones(3))[0]
    np.testing.assert_allclose(A.T @ A, schur, atol=1e-6)
    assert np.linalg.eigvalsh(schur)[1] > 0.01  # which the tip's derivatives alone, of rank 1, do not have


@pytest.mark.parametrize("u", [(0.5, 0.5), (0.0, 1.0), (0.95, 0.5)])
def test_a_step_is_the_best_within_the_box(u):
    """Against all of a fine grid."""
    rng = np.random.default_rng(3)
    A, r, at = rng.normal(size=(5, 2)), rng.normal(size=3), np.array(u)
    step = bounded_step(A, r, at, damping=0.1)
    grid = np.stack(np.meshgrid(*[np.linspace(0, 1, 401)] * 2, indexing="ij"), axis=-1).reshape(-1, 2) - at
    rows, right = np.vstack([A, np.sqrt(0.1) * np.eye(2)]), np.r_[-r, np.zeros(4)]
    costs = ((grid @ rows.T - right) ** 2).sum(axis=1)
    assert step == pytest.approx(grid[costs.argmin()], abs=3e-3)
    assert np.all((at + step >= -1e-12) & (at + step <= 1 + 1e-12))


def test_a_descent_at_full_reach_follows_the_curvature_of_the_links():
    """Where one by the tip's derivatives alone gains a tenth of a millimetre, from 15.8 mm."""
    rollout, target = simulator(None), np.array(published.TARGETS[4])
    start = np.array([[-1.005, 0.68, -1.469, 0.653, 1.702, -0.819, 1.5707, 0.0436, 0.988]])
    assert rollout.approach(start, target, t_stay=0.6).distance[0] > 0.0158
    strikes, misses = descend(rollout, BOUNDS, start, target, t_stay=0.6)
    lower, upper = BOUNDS.box
    assert np.all((strikes >= lower) & (strikes <= upper))
    assert misses[0] < 0.008


def test_solutions_are_distinct_by_a_share_of_the_box():
    lower, upper = BOUNDS.box
    middle = (lower + upper) / 2
    near, other = middle.copy(), middle.copy()
    near[0] += 0.005 * (upper - lower)[0]
    other[8] += 0.02 * (upper - lower)[8]
    assert distinct(np.array([middle, near, other]), BOUNDS) == [0, 2]


INTERVAL = 1e-3  # [s]


class Quadratic:
    """Two links, their ends' derivatives `A + B t` by the parameters; the second strike breaks off after 0.5 s."""

    model, timestep = NAH2023, 2.5e-4

    def __init__(self) -> None:
        self.A, self.B = np.random.default_rng(0).normal(size=(2, 2, 2, 3, 9))
        self.asked: tuple = ()

    def chain_paths(self, strikes, *, t_stay, names, stride):
        self.asked = names, stride
        t = np.arange(1001) * INTERVAL
        for strike, A, B in zip(strikes, self.A, self.B, strict=True):
            slopes = A + B * t[:, None, None, None]
            points = slopes @ strike
            if strike[0] > 0:
                points[501:] = slopes[501:] = np.nan
            yield ChainPath(t, points, slopes)


STRIKES = np.stack([np.zeros(9), np.full(9, 0.5)]) + np.eye(2, 9, 1)


@pytest.mark.parametrize("time", [(0.25, 0.1), (0.2503, 0.4999), (1.0, 0.5), (0.0, 0.0)])
def test_links_between_samples_change_linearly_until_each_strike_breaks_off(time):
    rollout, at = Quadratic(), np.array(time)[:, None, None, None]
    links = links_at(rollout, STRIKES, np.array(time), t_stay=0.0)
    ends = rollout.A + rollout.B * at
    np.testing.assert_allclose(links.slopes, np.stack([ends[:, 0], ends[:, 1] - ends[:, 0]], axis=1), atol=1e-10)
    np.testing.assert_allclose(links.vectors, np.einsum("bkij,bj->bki", links.slopes, STRIKES), atol=1e-10)
    tips = np.einsum("bij,bj->bi", rollout.B[:, 1], STRIKES)  # their velocities, which are steady
    np.testing.assert_allclose(links.velocities.sum(axis=1), tips, atol=1e-9)
    assert rollout.asked == (strike_names(NAH2023.arm), 4)


def test_what_is_across_a_velocity():
    P = across(np.array([[0.0, 0.0, 2.0], [3.0, 4.0, 0.0]]))
    assert P[0] == pytest.approx(np.diag([1.0, 1.0, 0.0]))
    assert P[1] @ [3.0, 4.0, 5.0] == pytest.approx([0, 0, 5])


def test_projections_across_leave_nothing_along():
    v = np.random.default_rng(1).normal(size=(5, 3))
    P = across(v)
    np.testing.assert_allclose(np.einsum("bij,bj->bi", P, v), 0, atol=1e-14)
    np.testing.assert_allclose(P @ P, P, atol=1e-14)
    np.testing.assert_allclose(np.trace(P, axis1=1, axis2=2), 2)


def test_a_path_moves_as_far_as_its_derivatives_across_its_velocity():
    """By Pythagoras: of each column, what is left of its length without the share along the velocity."""
    rollout = Quadratic()
    near = SimpleNamespace(time=np.array([0.3, 0.2]), velocity=np.array([[0.0, 0.0, 5.0], [1.0, -2.0, 2.0]]))
    found = path_sensitivity(rollout, STRIKES, near, t_stay=0.0)
    J = (rollout.A + rollout.B * near.time[:, None, None, None])[:, 1]
    unit = near.velocity / np.linalg.norm(near.velocity, axis=1, keepdims=True)
    along = np.einsum("bi,bij->bj", unit, J)
    np.testing.assert_allclose(found, np.sqrt((J**2).sum(axis=1) - along**2), atol=1e-9)
    np.testing.assert_allclose(found[0], np.hypot(J[0, 0], J[0, 1]), atol=1e-9)
