"""Fronts whose course has a closed form."""

from __future__ import annotations

import numpy as np
import pytest
from linear_rollout import BOUNDS, LEAST, LinearRollout

from whiptool.criteria import Effort, Miss, Speed
from whiptool.objective import Objective
from whiptool.optimizers import run_search
from whiptool.optimizers.front import Front
from whiptool.optimizers.pareto_search import pareto_search
from whiptool.target import Target

PLACE = np.array([0.2, -0.1])
AWAY = np.linalg.norm(LEAST[:2] - PLACE)


def front(criteria, *, trials: int = 700, seed: int = 0) -> tuple[Front, Objective]:
    objective = Objective(
        LinearRollout(),
        Target(tuple(PLACE), 0.3),
        bounds=BOUNDS,
        max_trials=trials,
        check_reach=False,
        criteria=criteria,
    )
    result = run_search(objective, pareto_search, "pareto", seed=seed)
    assert result.n_trials == trials
    return Front.of(criteria, objective.trials), objective


def test_effort_against_miss_is_a_parabola_without_holes():
    found = front((Effort(), Miss()))[0]
    effort, miss = found.values.T
    np.testing.assert_allclose(effort, (AWAY - miss) ** 2, rtol=2e-2)
    assert (miss.min(), miss.max()) == pytest.approx((0, 0.3), abs=2e-3)
    assert np.abs(np.diff(found.costs, axis=0)).max() < 0.2
    assert len(found.trials) >= 10


def test_speed_against_effort_keeps_more_of_what_is_maximised():
    """Among hits the speed grows with the third and fourth number alone; a quadratic program says at what effort."""
    found = front((Speed(), Effort()))[0]
    speed, effort = found.values.T
    assert (np.diff(speed) < 0).all()
    assert (np.diff(effort) < 0).all()
    x, y = np.meshgrid(np.linspace(-2, 2, 801), np.linspace(-2, 2, 801))
    least = (AWAY - 0.3) ** 2 + (x - LEAST[2]) ** 2 + (y - LEAST[3]) ** 2
    for v, e in found.values[:: max(1, len(speed) // 8)]:
        assert e == pytest.approx(least[np.hypot(x + 3, y) >= v - 1e-9].min(), rel=0.02, abs=0.02)


def test_the_same_seed_makes_the_same_trials():
    a, b = (front((Effort(), Miss()), trials=150, seed=4)[1].trials for _ in range(2))
    assert [trial.strike for trial in a] == [trial.strike for trial in b]
    assert [trial.strike for trial in a] != [x.strike for x in front((Effort(), Miss()), trials=150, seed=5)[1].trials]
