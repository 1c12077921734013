"""A strike of a rig as its log of cycles shows it, while it is written."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from whiptool.following.rig_strike import FollowedStrike
from whiptool.goals.target import Target
from whiptool.models import preset
from whiptool.models.strike import Strike
from whiptool.rig.cyclelog import CycleLog, Phase
from whiptool.rig.session import CYCLES
from whiptool.rollout.compiled import CompiledRollout

STRIKE = Strike((-1.0, 0.5), (2.0, 0.8), 0.8)


def row(t: float, phase: Phase, q: float | None) -> dict:
    measured = {} if q is None else {"q": np.array([q, 2 * q])}
    return {
        "t": t,
        "phase": phase,
        "q_d": np.zeros(2),
        "current": np.array([0.1, 0.2]),
        "flags": 0,
        "state": 0,
    } | measured


@pytest.fixture(scope="module")
def rollout() -> CompiledRollout:
    return CompiledRollout(preset("lemon2024"))


def test_the_measured_joints_are_shown_by_the_strikes_clock(tmp_path: Path, rollout: CompiledRollout) -> None:
    run = FollowedStrike(tmp_path, "a strike", rollout, STRIKE, Target((1.2, 0.1)), t_stay=0.3)
    first = run.look()
    assert first is not None
    assert (first.measured, first.facts["phase"]) == (None, "not begun")
    log = CycleLog(2, tmp_path / CYCLES)
    assert run.look() is None  # nothing but its first line
    log.append(row(0.0, Phase.APPROACH, -0.5))
    approach = run.look()
    assert approach is not None
    assert approach.measured is not None
    np.testing.assert_array_equal(approach.measured.t, [0.0])
    for t, q in ((1.0, 0.0), (1.1, None), (1.2, 0.2)):
        log.append(row(t, Phase.STRIKE, q))
    log.close()
    view = run.look()
    assert view is not None
    assert view.measured is not None
    np.testing.assert_allclose(view.measured.t, [-1.0, 0.0, 0.2])  # 0 is the strike's first cycle
    np.testing.assert_allclose(view.measured.at(0.1), [0.1, 0.2])
    np.testing.assert_allclose(view.measured.at(9.0), [0.2, 0.4])
    assert view.facts == {"phase": "strikes", "cycles": "4", "missed": "1"}
    errors = next(chart for chart in view.charts if chart.unit == "deg").curves
    np.testing.assert_allclose(errors[1].y, np.degrees([-1.0, 0.0, np.nan, 0.4]))


def test_the_twin_is_the_simulated_strike(tmp_path: Path, rollout: CompiledRollout) -> None:
    run = FollowedStrike(tmp_path, "a strike", rollout, STRIKE, Target((1.2, 0.1)), t_stay=0.3)
    view = run.look()
    assert view is not None
    assert view.chosen is not None
    twin = run.motion(view.chosen).trajectory
    np.testing.assert_array_equal(twin.q, rollout.trajectory(STRIKE, t_stay=0.3).q)
