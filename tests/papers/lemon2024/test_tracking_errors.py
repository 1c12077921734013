"""Tracking errors over strikes, on paths that are made up: largest, mean, and what diverged left out."""

from __future__ import annotations

import numpy as np
import pytest

from papers.lemon2024 import tracking_errors as tracking
from papers.lemon2024.tracking_errors import NAMES, TABLE4_CONSTANT, TABLE4_OIAC, errors_over_time, tracking_errors
from whiptool.impedance import Controller
from whiptool.models import preset
from whiptool.models.trajectory import Trajectory


def path(q_error: list, v_error: list, diverged: bool = False) -> Trajectory:
    """Of two arm joints and one of the whip, whose errors are 99."""
    e, de = np.array(q_error, float), np.array(v_error, float)
    T, rng = len(e), np.random.default_rng(0)
    q_d, v_d = rng.normal(size=(T, 2)), rng.normal(size=(T, 2))
    whip, none = np.full((T, 1), 99.0), np.zeros((T, 2))
    matrices = np.zeros((T, 2, 2))
    return Trajectory(
        *(np.arange(T) * 0.1, np.hstack([q_d - e, whip]), np.hstack([v_d - de, whip]), q_d, v_d, none),
        *(matrices, matrices, none, none, diverged),
    )


PATHS = [
    path([[0.1, -0.4], [-0.3, 0.2]], [[1.0, 2.0], [-5.0, 0.0]]),
    path([[9.0, 9.0]] * 2, [[9.0, 9.0]] * 2, diverged=True),
    path([[0.2, 0.0], [0.0, 0.0], [0.1, -0.6]], [[0.0, -3.0], [3.0, 0.0], [0.0, 0.0]]),
]


def test_errors_are_desired_less_actual_of_the_arm():
    np.testing.assert_allclose(errors_over_time(PATHS[0]), [[0.1, -0.4, 1.0, 2.0], [-0.3, 0.2, -5.0, 0.0]])
    assert NAMES == ("position shoulder", "position elbow", "velocity shoulder", "velocity elbow")


@pytest.fixture
def rolled(monkeypatch):
    """A rollout that gives so many of the made-up paths, and what it was asked for."""
    asked: dict = {}

    class Rollout:
        def __init__(self, model, controller, *, timestep):
            asked["timestep"] = timestep

        def trajectories(self, strikes, *, t_stay):
            asked["t_stay"] = t_stay
            return iter(asked["paths"])

    monkeypatch.setattr(tracking, "CompiledRollout", Rollout)
    return asked


def test_largest_and_mean_of_each_strike_are_averaged(rolled):
    rolled["paths"] = PATHS
    found = tracking_errors(preset("lemon2024"), Controller(), np.zeros((3, 5)))
    np.testing.assert_allclose(found.largest, [(0.3 + 0.2) / 2, (0.4 + 0.6) / 2, (5 + 3) / 2, (2 + 3) / 2])
    np.testing.assert_allclose(found.mean, [(0.2 + 0.1) / 2, (0.3 + 0.2) / 2, (3 + 1) / 2, (1 + 1) / 2])
    assert found.n_diverged == 1
    assert (rolled["timestep"], rolled["t_stay"]) == (1e-4, 0.3)


def test_where_all_diverge_there_is_no_error(rolled):
    rolled["paths"] = PATHS[1:2]
    found = tracking_errors(preset("lemon2024"), Controller(), np.zeros((1, 5)), timestep=1e-3, t_stay=0.1)
    assert np.isnan(found.largest).all()
    assert np.isnan(found.mean).all()
    assert found.n_diverged == 1
    assert (rolled["timestep"], rolled["t_stay"]) == (1e-3, 0.1)


def test_the_papers_table():
    """Table 4 of the paper: errors of constant impedance and of OIAC."""
    np.testing.assert_array_equal(TABLE4_CONSTANT, [0.161, 0.038, 1.038, 0.229])
    np.testing.assert_array_equal(TABLE4_OIAC, [0.036, 0.009, 0.138, 0.073])
