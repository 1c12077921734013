"""Derivatives of the miss by names that stand for several numbers of the whip."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import whiptool as wt

TAPERED = wt.WhipProfile(0.9, 0.2, 0.02, 0.006, density_taper=0.6, stiffness_taper=0.4, damping_taper=0.5)
LEMON, STRIKE, TARGET = wt.preset("lemon2024"), wt.Strike(-1.3, 0.5, 1.6, 1.2, 0.5), (1.2, 0.1)
CONTROLLER = wt.Controller(wt.ConstantImpedance())
UNEVEN = replace(LEMON, whip=replace(LEMON.whip, k=(0.0, *np.linspace(0.4, 0.1, 11).tolist())))


@pytest.mark.parametrize(
    ("model", "name", "value"),
    [
        (UNEVEN, "whip.k", 0.25),
        (replace(LEMON, whip=TAPERED.lump(12)), "profile.length", 0.9),
        (replace(LEMON, whip=TAPERED.lump(12)), "profile.stiffness_taper", 0.4),
    ],
)
@pytest.mark.slow
def test_gradients_by_a_common_scale_and_by_numbers_of_a_profile(model, name, value):
    """Against central differences of the miss distance."""

    def miss(x):
        changed = model.with_parameters({name: x})
        return wt.CompiledRollout(changed, CONTROLLER, timestep=5e-4).approach(STRIKE, TARGET).distance[0]

    h = 1e-5 * value
    slope = wt.CompiledRollout(model, CONTROLLER, timestep=5e-4).gradient(STRIKE, TARGET, names=[name])[1][0, 0]
    assert slope == pytest.approx((miss(value + h) - miss(value - h)) / (2 * h), rel=1e-5)
