"""Effort against closed forms and MuJoCo; derivatives of effort and largest torque against differences."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from rich_model import everything
from scipy.integrate import simpson
from slopes import compare

from whiptool.impedance import OIAC, ConstantImpedance, Controller, PositionControl
from whiptool.models import ArmLink, ArmParameters, Model, WhipParameters, preset
from whiptool.models.strike import Strike, default_bounds
from whiptool.rollout import CompiledRollout, ReferenceRollout
from whiptool.rollout.engine import RUNGS

LEMON = preset("lemon2024")
TARGET = np.array([1.3, 0.0])
STRIKES = default_bounds(LEMON.arm).sample(np.random.default_rng(21), 24)
CONSTANT = Controller(ConstantImpedance())
HELD = replace(CONSTANT, control_period=5e-4)


def test_effort_of_a_mass_on_a_minimum_jerk_path_has_a_closed_form():
    """Without gravity a joint takes the torque I q''; over Eq. 1 the integral of q''^2 is 120/7 span^2 / D^3."""
    mass, length, span, D = 0.4, 0.5, 1.7, 0.6
    whip = WhipParameters(N=2, l=0.01, m=1e-9, k=1e-6, b=1e-9)
    arm = ArmParameters((ArmLink(mass=mass, length=length, com=length, inertia=0.02),))
    model = Model(whip=whip, arm=arm, gravity=0.0)
    near = CompiledRollout(model, Controller(PositionControl()), timestep=2.5e-4).approach(
        np.array([[0.3, 0.3 + span, D]]), TARGET, t_stay=0.1
    )
    inertia = 0.02 + mass * length**2
    assert near.effort is not None
    assert near.effort[0, 0] == pytest.approx((inertia * span) ** 2 * 120 / 7 / D**3, rel=2e-5)


@pytest.mark.parametrize("controller", [CONSTANT, Controller(OIAC()), HELD], ids=["constant", "oiac", "held"])
def test_effort_is_that_of_mujoco(controller):
    """By Simpson's rule over MuJoCo's own steps."""
    strike = Strike.from_vector([-0.9, 0.4, 1.2, 0.8, 0.4])
    near = CompiledRollout(LEMON, controller).approach(strike, TARGET, t_stay=0.1)
    path = ReferenceRollout(LEMON, controller).trajectory(strike, t_stay=0.1)
    expected = simpson(path.tau**2, x=path.t, axis=0)
    assert near.effort is not None
    np.testing.assert_allclose(near.effort[0], expected, rtol=2e-3)


@pytest.mark.slow
@pytest.mark.parametrize("controller", [CONSTANT, HELD], ids=["continuous", "held"])
def test_engines_agree_on_effort_and_on_derivatives(controller):
    strikes, found = np.c_[STRIKES[:2, :4], [0.4, 0.5]], []
    for rung in RUNGS:
        rollout = CompiledRollout(LEMON, controller, timestep=1e-3, engine=rung)
        near, slopes = rollout.slopes(strikes, TARGET, t_stay=0.1)
        plain = rollout.approach(strikes, TARGET, t_stay=0.1)
        np.testing.assert_allclose(near.effort, plain.effort, rtol=1e-6)
        found.append((near.effort, slopes.effort, slopes.max_torque))
    paths = [rollout.trajectory(strike, t_stay=0.1).approach(TARGET).effort for strike in strikes]
    np.testing.assert_allclose(np.concatenate(paths), found[0][0], rtol=1e-9)
    for other in found[1:]:
        for expected, seen in zip(found[0], other, strict=True):
            np.testing.assert_allclose(seen, expected, rtol=1e-5, atol=1e-6 * np.abs(expected).max())


@pytest.mark.slow
@pytest.mark.parametrize("name", ["effort", "max_torque"])
def test_derivatives_against_differences(name):
    """Of each joint, by the whole strike: with D the steps move, too."""
    rollout = CompiledRollout(everything(), CONSTANT, timestep=1e-3)
    slopes = getattr(rollout.slopes(STRIKES, TARGET, t_stay=0.3)[1], name)
    compared = 0
    for j in range(5):
        for joint in range(2):

            def seen(by: float, j: int = j, joint: int = joint) -> np.ndarray:
                shifted = STRIKES.copy()
                shifted[:, j] += by
                return getattr(rollout.approach(shifted, TARGET, t_stay=0.3), name)[:, joint]

            wrong, still = compare(slopes[:, joint, j], seen, 3e-6)
            assert not wrong.any(), (j, joint, slopes[wrong, joint, j])
            compared += int(still.sum())
    assert compared > 0.8 * 5 * 2 * len(STRIKES)
