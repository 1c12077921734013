"""Fronts whose course has a closed form."""

from __future__ import annotations

import numpy as np
import pytest
from linear_rollout import BOUNDS, LEAST, LinearRollout

from whiptool.goals.criteria import Effort, Miss, Speed
from whiptool.goals.target import Target
from whiptool.objective import Objective
from whiptool.optimizers import run_search
from whiptool.optimizers.front import ParetoFront
from whiptool.optimizers.pareto_search import pareto_search
from whiptool.rollout.interface import Rollout

PLACE = np.array([0.2, -0.1])
AWAY = np.linalg.norm(LEAST[:2] - PLACE)


class WavyRollout(LinearRollout):
    """Effort has a valley every 0.3 along the third and the fourth number; between them are ridges of 0.8."""

    def approach(self, strikes, target, *, t_stay=0.3):
        near = super().approach(strikes, target, t_stay=t_stay)
        assert near.effort is not None
        near.effort[:] += 0.4 * (1 - np.cos(2 * np.pi / 0.3 * (strikes[:, 2:4] - LEAST[2:4])))
        return near

    def slopes(self, strikes, target, *, t_stay=0.3, names=None):
        near, slopes = super().slopes(strikes, target, t_stay=t_stay)
        change = 0.4 * 2 * np.pi / 0.3 * np.sin(2 * np.pi / 0.3 * (strikes[:, 2:4] - LEAST[2:4]))
        slopes.effort[:, [0, 1], [2, 3]] += change
        return near, slopes


def front(
    criteria, *, trials: int = 700, seed: int = 0, rollout: Rollout | None = None
) -> tuple[ParetoFront, Objective]:
    objective = Objective(
        rollout or LinearRollout(),
        Target(tuple(PLACE), 0.3),
        bounds=BOUNDS,
        max_trials=trials,
        check_reach=False,
        criteria=criteria,
    )
    result = run_search(objective, pareto_search, "pareto", seed=seed)
    assert result.n_trials == trials
    return ParetoFront.of(criteria, objective.trials), objective


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
    for v, e in found.values:
        assert e == pytest.approx(least[np.hypot(x + 3, y) >= v - 1e-9].min(), rel=0.04, abs=0.02)


def test_the_same_seed_makes_the_same_trials():
    a, b = (front((Effort(), Miss()), trials=150, seed=4)[1].trials for _ in range(2))
    assert [trial.strike for trial in a] == [trial.strike for trial in b]
    assert [trial.strike for trial in a] != [x.strike for x in front((Effort(), Miss()), trials=150, seed=5)[1].trials]


@pytest.mark.parametrize("seed", range(3))
def test_the_end_of_a_front_is_not_in_the_valley_nearest_to_a_random_strike(seed):
    """Of 169 valleys one is the deepest, with (AWAY - 0.3)²; the next ones are 0.09 above it."""
    found = front((Effort(), Miss()), seed=seed, rollout=WavyRollout())[0]
    assert found.values[0, 0] < (AWAY - 0.3) ** 2 + 0.3


def test_starts_that_lead_to_one_hit_end_the_search_for_the_first_end(monkeypatch):
    """On a slope without valleys the first descents agree; none begins beside their ends."""
    beside = []
    monkeypatch.setattr("whiptool.optimizers.pareto_search._nearby", lambda *args: beside.append(args) or 1 / 0)
    front((Effort(), Miss()), trials=300)
    assert not beside


def test_a_front_of_one_hit_does_not_end_the_search(monkeypatch):
    """Improving the ends finds the best hit by both criteria, as it did of a UR5e; `front` asserts all its trials."""

    class Free(LinearRollout):
        free = False

        def approach(self, strikes, target, *, t_stay=0.3):
            near = super().approach(strikes, target, t_stay=t_stay)
            assert near.effort is not None
            near.effort[(near.distance == 0) & self.free] = 0.0
            return near

    rollout = Free()

    def improve(objective: Objective, front: ParetoFront) -> None:
        rollout.free = True
        objective.trial(np.r_[PLACE, LEAST[2:]])

    monkeypatch.setattr("whiptool.optimizers.pareto_search._improve_ends", improve)
    found = front((Effort(), Miss()), trials=400, rollout=rollout)[0]
    np.testing.assert_array_equal(found.values, [[0, 0]])
