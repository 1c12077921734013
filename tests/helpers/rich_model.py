"""A model with every term there is, and what rollouts compute of it."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from whiptool.impedance import OIAC, ConstantImpedance, Controller
from whiptool.models import preset
from whiptool.models.parameters import Model
from whiptool.models.trajectory import Approach

LEMON = preset("lemon2024")
# code of scalars is generated as that of lanes is: its derivatives are compiled in the whole suite only
EVERY_RUNG = ["simd", pytest.param("scalar", marks=pytest.mark.slow), "interpreter"]
MEASURED = ("error", "lost", "integration_error")  # what only strikes on a rig have, or a tolerance
COMPUTED = [field.name for field in dataclasses.fields(Approach) if field.name not in MEASURED]


def everything() -> Model:
    """A model that uses every term there is, with a value per node everywhere."""
    rng = np.random.default_rng(0)
    whip = LEMON.whip

    def vary(value: float) -> tuple[float, ...]:
        return tuple(value * rng.uniform(0.8, 1.2, whip.N))

    return dataclasses.replace(
        LEMON,
        whip=dataclasses.replace(
            whip, l=vary(0.072), m=vary(0.012), k=vary(0.242), b=vary(0.092), drag=vary(1e-3), dry_friction=vary(5e-3),
            rest_angle=vary(0.05), cubic_stiffness=vary(0.05), drag_ratio=0.3, hinge_mass=0.01,
            node_inertia=vary(2e-5),
        ),
    )  # fmt: skip


CONTROLLERS = {
    "constant": Controller(ConstantImpedance()),
    "oiac": Controller(OIAC(a=2e-4)),
    "all options": Controller(OIAC(), feedforward=True, torque_limit=5.0),
    "held": Controller(ConstantImpedance(), control_period=0.001, torque_limit=20.0),
}
