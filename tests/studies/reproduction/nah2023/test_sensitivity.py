"""Derivatives of the tip's path: projections by hand, and a rollout whose path is a known function of its parameters.

Those of the real model are tested against differences in `test_solutions.py`.
"""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from whiptool.models.robots import NAH2023
from whiptool.models.strike import strike_names
from whiptool.studies.reproduction.nah2023.sensitivity import across, path_sensitivity, tip_jacobian

RATE = 1000.0


class Quadratic:
    """Tips of derivative `A + B t` by the parameters; the second strike ends after 0.5 s."""

    model = NAH2023

    def __init__(self) -> None:
        self.A, self.B = np.random.default_rng(0).normal(size=(2, 2, 3, 9))
        self.names: object = None

    def tip_path(self, strikes, *, t_stay, rate, names):
        assert rate == RATE
        self.names = names
        t = np.arange(1001) / RATE
        slopes = self.A[:, None] + self.B[:, None] * t[None, :, None, None]
        path = np.zeros((2, len(t), 3))
        path[1, 501:] = slopes[1, 501:] = np.nan
        return None, path, slopes


@pytest.mark.parametrize("time", [(0.25, 0.1), (0.2503, 0.4999), (1.0, 0.5), (0.0, 0.0)])
def test_derivatives_between_samples_change_linearly_until_each_strikes_end(time):
    rollout, at = Quadratic(), np.array(time)
    found = tip_jacobian(rollout, np.zeros((2, 9)), at, t_stay=0.0)  # type: ignore[arg-type]
    np.testing.assert_allclose(found, rollout.A + rollout.B * at[:, None, None], atol=1e-10)
    assert rollout.names == strike_names(NAH2023.arm)


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
    found = path_sensitivity(rollout, np.zeros((2, 9)), near, t_stay=0.0)  # type: ignore[arg-type]
    J = rollout.A + rollout.B * near.time[:, None, None]
    unit = near.velocity / np.linalg.norm(near.velocity, axis=1, keepdims=True)
    along = np.einsum("bi,bij->bj", unit, J)
    np.testing.assert_allclose(found, np.sqrt((J**2).sum(axis=1) - along**2), atol=1e-9)
    np.testing.assert_allclose(found[0], np.hypot(J[0, 0], J[0, 1]), atol=1e-9)
