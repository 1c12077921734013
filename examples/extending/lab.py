"""What a package of a laboratory adds: its entry points name the objects of this module."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from add_controller import HardeningImpedance
from add_optimizer import cross_entropy
from add_robot import LaggingRobot

import whiptool as wt
from whiptool.adaptation.twins import FAMILIES, Family
from whiptool.goals.criteria import Criterion, StrikesAtGoal
from whiptool.models.mount import mounted
from whiptool.recording.readers import Format

__all__ = [
    "Brief",
    "HardeningImpedance",
    "LaggingRobot",
    "bvh",
    "cross_entropy",
    "hanging",
    "short_whip",
    "soft",
    "strong",
]


class Brief(Criterion):
    """The duration of the movement, for `--minimise brief`."""

    name, words, unit = "brief", "duration", "s"

    def values(self, struck: StrikesAtGoal) -> np.ndarray:
        """Return the number of each strike, (B,)."""
        return struck.strikes[:, -1]

    def measures(self, struck: StrikesAtGoal) -> np.ndarray:
        """Return the smooth measures of each strike, (B, 1)."""
        return struck.strikes[:, -1:]

    def measure_slopes(self, struck: StrikesAtGoal) -> np.ndarray:
        """Return their derivatives by the strike's numbers, (B, 1, m)."""
        return np.broadcast_to(np.eye(struck.strikes.shape[1])[-1], (len(struck.strikes), 1, struck.strikes.shape[1]))


def softer(numbers, rng, model, controller):
    """Draw a whip that bends a third as stiffly as one of the family kin."""
    return FAMILIES["kin"].draw(
        {**numbers, "bending_stiffness": numbers["bending_stiffness"] / 3}, rng, model, controller
    )


short_whip = wt.preset("lemon2024").with_whip(length=0.5)
hanging = replace(wt.preset("ur5e"), arm=mounted(wt.preset("ur5e").arm, "ceiling"), name="hanging")
strong = wt.MotorLimits("strong motor", stall_torque=9.0, no_load_speed=8.0, stall_current=5.0)
soft = Family(7, softer)
bvh = Format("BVH", lambda path, head: path.suffix == ".bvh", lambda path: wt.read_recording("strike.csv"))
