"""Whips that hang above a floor before a strike: against where they hang, and differences of the hand's height."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from whiptool.dynamics.posture import start_posture
from whiptool.models import Model, default_bounds, in_space, preset
from whiptool.models.hanging_whip import HangingWhip
from whiptool.models.kinematics import joint_points

STIFF = Model(replace(preset("nah2023").whip, k=300.0, b=1.0), in_space(preset("lemon2024").arm))


@pytest.mark.parametrize("name", ["ur5e", "panda", "nah2023"])
def test_no_whip_hangs_less_low_than_is_reckoned_with(name):
    """Whatever the hand's direction: what is left out would have the whip in the floor."""
    model, floor = preset(name), -0.3
    strikes = default_bounds(model.arm).sample(np.random.default_rng(0), 20)
    points = joint_points(model, start_posture(model, strikes[:, : model.arm.n]))
    lowest = points[:, model.arm.n :, 2].min(axis=1)
    hand = points[:, model.arm.n, 2]
    left_out = ~HangingWhip(model, floor).kept(strikes)
    assert left_out.any()
    assert (lowest[left_out] < floor).all()
    assert (hand - lowest >= 0.4 * model.whip.length).all()


def test_a_stiff_whip_may_be_held_out():
    """As stiff as a rod it does not hang, and only the hand has to be above the floor."""
    arm = STIFF.arm
    up = np.r_[np.zeros(arm.n), np.zeros(arm.n), 0.5]  # the hand hangs 0.65 m below the shoulder
    assert HangingWhip(STIFF, -0.66).kept(up[None])[0]
    assert not HangingWhip(STIFF, -0.64).kept(up[None])[0]
    weightless = replace(preset("ur5e"), gravity=0.0)
    assert HangingWhip(weightless, 0.0, 0.1).constraints(np.r_[np.zeros(12), 0.5])[0] == pytest.approx(
        0.1 - joint_points(weightless, np.zeros(66))[6, 2]
    )


@pytest.mark.parametrize(("name", "floor"), [("ur5e", -1.2), ("nah2023", -1.8)])
def test_slopes_are_differences_and_kept_is_their_sign(name, floor):
    model = preset(name)
    hanging = HangingWhip(model, floor, 0.01)
    strikes = default_bounds(model.arm).sample(np.random.default_rng(1), 30)
    values = np.array([hanging.constraints(strike)[0][0] for strike in strikes])
    np.testing.assert_array_equal(hanging.kept(strikes), values <= 0)
    assert 0 < (values <= 0).sum() < 30
    steps = 1e-6 * np.eye(strikes.shape[1])
    ups, downs = ([hanging.constraints(strikes[0] + side * e)[0] for e in steps] for side in (1, -1))
    differences = (np.array(ups) - np.array(downs)) / 2e-6
    np.testing.assert_allclose(hanging.constraints(strikes[0])[1], differences.T, atol=1e-8)
