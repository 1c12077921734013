"""The robot of aimed strikes: a UR5e with a stick of 0.65 m and a rope of 1 m in 20 rods, its joints on their path."""

from __future__ import annotations

from whiptool import default_controller, preset

MODEL = preset("ur5e")
CONTROLLER = default_controller(MODEL)
