"""Control of the arm: constant and online-adaptive impedance, joints on their reference, the controller around them,
their cost."""

from whiptool.impedance.constant import CONSTANT_PRESETS, ConstantImpedance, constant_preset
from whiptool.impedance.controller import Controller, ControlLoop
from whiptool.impedance.cost import Cost, impedance_cost
from whiptool.impedance.default import default_controller
from whiptool.impedance.hand import HandControl, hand_impedance
from whiptool.impedance.law import LAWS, Law, register
from whiptool.impedance.oiac import OIAC, OIAC_PRESETS, oiac_preset
from whiptool.impedance.position import PositionControl

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
