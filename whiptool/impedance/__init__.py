"""Control of the arm: constant and online-adaptive impedance, position control, the controller, and its cost."""

from whiptool.impedance.controller import Controller, ControlLoop, HandControl, default_controller, hand_impedance
from whiptool.impedance.cost import Cost, impedance_cost
from whiptool.impedance.laws import (
    CONSTANT_PRESETS,
    LAWS,
    OIAC,
    OIAC_PRESETS,
    ConstantImpedance,
    Law,
    PositionControl,
    constant_preset,
    oiac_preset,
    register,
)

__all__ = [
    "CONSTANT_PRESETS",
    "LAWS",
    "OIAC",
    "OIAC_PRESETS",
    "ConstantImpedance",
    "ControlLoop",
    "Controller",
    "Cost",
    "HandControl",
    "Law",
    "PositionControl",
    "constant_preset",
    "default_controller",
    "hand_impedance",
    "impedance_cost",
    "oiac_preset",
    "register",
]
