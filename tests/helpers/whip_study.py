"""A small study of unknown whips."""

from __future__ import annotations

import dataclasses

from papers.unknown.unknown_whips import Study
from whiptool.comparison import Scene
from whiptool.goals.zone import Disc
from whiptool.impedance import Controller, oiac_preset
from whiptool.models.presets import preset

MODEL, CONTROLLER = preset("lemon2024"), Controller(oiac_preset("table4"))


def study_of(**changes) -> Study:
    scene = Scene(model=MODEL, controller=CONTROLLER, zone=Disc((1.1, 0.0)), targets=8)
    return dataclasses.replace(Study(scene=scene, strikes=2, thorough=False), **changes)
