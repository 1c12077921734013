"""The scene of a comparison with the published whip."""

from __future__ import annotations

from whiptool.comparison import TargetScene
from whiptool.goals.zone import Disc
from whiptool.impedance import ConstantImpedance, Controller
from whiptool.models import preset


def scene(radius: float) -> TargetScene:
    return TargetScene(
        model=preset("lemon2024"),
        controller=Controller(ConstantImpedance()),
        zone=Disc((1.3, 0.0), radius),
        targets=40,
        radii=(0.06,),
        timestep=1e-3,
    )
