"""The scene of a comparison whose tip flies straight."""

from __future__ import annotations

from fake_rollout import StraightFlight

from whiptool.comparison.target_scene import TargetScene
from whiptool.goals.zone import Disc
from whiptool.impedance import Controller
from whiptool.models import preset


class Flights(TargetScene):
    def rollout(self, threads=None):
        return StraightFlight(wild_above=2.5)


def scene(**changes) -> TargetScene:
    options = {"targets": 7, "cap": 12, "radii": (0.3, 0.1), "zone": Disc((0.8, -0.8), 0.2), **changes}
    return Flights(model=preset("lemon2024"), controller=Controller(), **options)
