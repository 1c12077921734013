"""Derivatives of links and of the tip's path: projections by hand, and a chain whose path is a known function of its
parameters.

Those of the real model are tested against differences in `test_solutions.py`.
"""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from papers.nah2023.sensitivity import across, links_at, path_sensitivity
from whiptool.models.presets import NAH2023
from whiptool.models.strike import strike_names
from whiptool.rollout.compiled import ChainPath

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
