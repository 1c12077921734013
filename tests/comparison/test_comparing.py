"""Comparisons in memory."""

from __future__ import annotations

import pytest

from whiptool.comparison import plan
from whiptool.models import preset
from whiptool.rollout import CompiledRollout


@pytest.mark.parametrize("accuracy", [{}, {"tolerance": 1e-3}, {"timestep": 2e-3}])
def test_methods_are_compared_at_the_accuracy_of_the_rollout_that_is_given(monkeypatch, accuracy):
    units = []
    monkeypatch.setattr(plan.Store, "results", lambda self, some, desc: units.extend(some))
    monkeypatch.setattr(plan, "collect", lambda *_: [])
    rollout = CompiledRollout(preset("lemon2024"), **accuracy)
    plan.compare(rollout, methods=("random",), targets=1, max_trials=1)
    again = units[0].scene.rollout()
    assert (again.tolerance, again.timestep) == (rollout.tolerance, rollout.timestep)
