"""Aimed strikes with a Cosserat rod: the whip's profile, units, and a hit where our own tip passes."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

pytest.importorskip("torch")

from papers.aim import oracle
from papers.aim.oracle import OracleUnit, uniform_profile
from papers.aim.task import ur5e
from whiptool.errors import InputError

TASK = ur5e(quick=True)


def test_the_profile_is_that_of_which_the_whip_is_the_lumping():
    """A rope of 1 m and 6.35 mm radius, 700 kg/m3, E = 2e5 Pa."""
    profile = uniform_profile(TASK.model.whip)
    area = np.pi * 0.00635**2
    assert profile.length == pytest.approx(1.0)
    assert profile.linear_density == pytest.approx(700 * area, rel=1e-6)
    assert profile.bending_stiffness == pytest.approx(2e5 * area * 0.00635**2 / 4, rel=1e-6)
    whip = TASK.model.whip
    with pytest.raises(InputError, match="the lumping of a uniform profile"):
        uniform_profile(replace(whip, m=tuple(np.linspace(2, 1, whip.N) * whip.per_node("m"))))


@pytest.mark.slow
def test_a_rod_passes_where_our_tip_does_and_only_there(monkeypatch):
    """Two strikes of different lengths at once, both a little before their ends; another angle is no hit."""
    pytest.importorskip("elastica", reason="needs the extra `oracle`")
    monkeypatch.setattr(oracle, "ELEMENTS", 12)
    striker = TASK.striker(1)
    strike = np.r_[0, -1.5, 1.0, 0, 0.5, 0, 0.3, -0.5, 0.5, 0.2, 0.5, 0, 0.4]
    strikes = np.array([strike, np.r_[strike[:-1], 0.6]])
    paths = list(striker.rollout.trajectories(strikes, t_stay=0.0))
    when = [int(np.searchsorted(path.t, path.t[-1] - 0.0555)) for path in paths]
    place, velocity = (
        np.array([getattr(path, x)[i] for path, i in zip(paths, when, strict=True)]) for x in ("tip", "tip_velocity")
    )
    angles = TASK.region.angles(place, velocity)
    assert angles is not None
    for turn, hit in ((0.0, True), (1.0, False)):
        goals = TASK.region.rule.goals_at(place, 0.05, angles + turn)
        pretended: Any = SimpleNamespace(name="short", model=TASK.model, t_stay=0.0)
        pretended.goals, pretended.striker = (lambda goals=goals: goals), lambda threads: striker
        unit = OracleUnit(task=pretended, goals=(0, 1), strikes=tuple(tuple(x.tolist()) for x in strikes))
        for seen in unit.run(None, None)["played"]:
            assert seen["hit"] == hit
            assert seen["miss"] < 0.01
            assert seen["apart"] < 0.03
            assert seen["angle"] == pytest.approx(turn, abs=0.05)
