"""A step that is too coarse is said to be: against MuJoCo, and against the same simulator at a finer step."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from whiptool.impedance import Controller, oiac_preset
from whiptool.models.presets import preset
from whiptool.models.strike import Strike, default_bounds
from whiptool.rollout.compiled import CompiledRollout
from whiptool.rollout.reference import ReferenceRollout
from whiptool.rollout.refinement import refine, share_too_coarse

MODEL, CONTROLLER = preset("lemon2024"), Controller(oiac_preset("table4"))
STRIKE, TARGET = Strike.from_vector([-1.36, 0.47, 1.73, 1.41, 0.95]), np.array([1.2, 0.1])


def warning_at(timestep: float | None) -> str | None:
    rollout = CompiledRollout(MODEL, CONTROLLER, timestep=timestep)
    return refine(rollout, STRIKE, rollout.trajectory(STRIKE, t_stay=0.3), t_stay=0.3, target=TARGET)


def test_torques_of_a_coarse_step_are_corrected_to_those_of_mujoco() -> None:
    true = ReferenceRollout(MODEL, CONTROLLER).trajectory(STRIKE, t_stay=0.3).approach(TARGET).max_torque[0, 1]
    assert true == pytest.approx(3.6, abs=0.05)
    for coarse, wrong in ((0.002, 12.5), (0.01, 340)):
        path = CompiledRollout(MODEL, CONTROLLER, timestep=coarse).trajectory(STRIKE, t_stay=0.3)
        assert path.approach(TARGET).max_torque[0, 1] == pytest.approx(wrong, rel=0.01)
        said = warning_at(coarse)
        assert said is not None
        assert f"the elbow's largest torque is {true:.2f} N m, not " in said


@pytest.mark.parametrize("timestep", [None, 1e-4, 2.5e-4, 1e-3])
def test_nothing_is_said_of_a_step_that_does(timestep: float | None) -> None:
    assert warning_at(timestep) is None


def test_a_strike_that_diverges_at_one_step_only_is_told() -> None:
    rollout = CompiledRollout(MODEL, CONTROLLER, timestep=2.5e-4)
    gone = dataclasses.replace(rollout.trajectory(STRIKE, t_stay=0.3), diverged=True)
    said = refine(rollout, STRIKE, gone, t_stay=0.3, target=TARGET)
    assert said is not None
    assert "the strike does not diverge;" in said


def test_a_zones_strikes_are_tried_before_they_teach() -> None:
    share = share_too_coarse(MODEL, CONTROLLER, default_bounds(MODEL.arm), timestep=0.01, t_stay=0.3, target=TARGET)
    assert share > 0.5
