"""Strikes at the one target that methods find."""

from __future__ import annotations

import numpy as np
import pytest

from papers.human.machine_strikes import METHODS, StrikeUnit, by_method, machine, target_of


@pytest.mark.parametrize("method", ["gradient", "CMA-ES"])
def test_a_unit_keeps_the_best_of_its_trials(method):
    found = StrikeUnit(method=method, seed=1, hit_radius=0.04, trials=40).run(None, 1)
    assert len(found["misses"]) <= 40
    assert found["miss_distance"] == pytest.approx(min(found["misses"]))
    near = machine(1).approach(np.array([found["strike"]]), target_of(0.04).position)
    assert near.distance[0] == pytest.approx(found["miss_distance"])


def test_by_method():
    found = [{"method": "SAC", "strike": [1.0, 2]}, {"method": "CMA-ES", "strike": [3.0, 4]}]
    assert list(by_method(found)) == [x for x in METHODS if x in ("SAC", "CMA-ES")]
