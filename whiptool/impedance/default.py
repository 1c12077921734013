"""The controller that goes with a model where none is asked for."""

from __future__ import annotations

from whiptool.errors import expect
from whiptool.impedance.constant import constant_preset
from whiptool.impedance.controller import Controller
from whiptool.impedance.position import PositionControl
from whiptool.models.parameters import Model
from whiptool.models.strike import is_person


def default_controller(model: Model) -> Controller:
    """Return the default controller of a model.

    For an arm in the plane it is OIAC (online impedance adaptation control) with the preset `table4`, for the human arm
    `nah2023` the constant impedance that was published with it, and for every other arm in space position control,
    because robots follow their commands closely.
    """
    expect(Model, model=model)
    if model.dimension == 2:
        return Controller()
    return Controller(constant_preset("nah2023") if is_person(model.arm) else PositionControl())
