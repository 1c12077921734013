"""Strikes planned on the model, played on a twin that is not."""

from __future__ import annotations

import numpy as np
import pytest

import whiptool as wt
from papers.lemon2024.twin_strikes import PlanUnit, controller
from whiptool.comparison import TargetScene
from whiptool.impedance import Controller
from whiptool.limits.arm_limits import XM430

pytest.importorskip("dynamixel_sdk")

MODEL = wt.preset("lemon2024")
SCENE = TargetScene(model=MODEL, controller=Controller())


@pytest.mark.slow
def test_planned_strikes_come_nearer_within_the_motors_line() -> None:
    plan = PlanUnit(scene=SCENE, iterations=2, targets=1).run(None, 1)["strikes"]
    assert len(plan) == 2
    rollout = wt.CompiledRollout(MODEL, controller())
    strikes = np.array([s["strike"] for s in plan])
    near = rollout.approach(strikes, np.array(plan[0]["target"]), t_stay=SCENE.t_stay)
    assert (XM430.violation_of_peaks(near) <= 0).all()
    assert near.distance[1] < near.distance[0]
