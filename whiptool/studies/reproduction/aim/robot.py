"""The robot of aimed strikes: a UR5e with a stick of 0.65 m and a rope of 1 m in 20 rods, its joints on their path."""

from __future__ import annotations

from dataclasses import replace

from whiptool.impedance import Controller, PositionControl
from whiptool.models import Model, preset

TIMESTEP = 1.5e-3  # [s]
CONTROLLER = Controller(PositionControl())


def of_rods(name: str) -> Model:
    """Return a preset with its rope of rods."""
    model = preset(name)
    return replace(model, name=f"{name}-rods", whip=replace(model.whip, joints="rod", node_inertia=0.0))


MODEL = of_rods("ur5e")
