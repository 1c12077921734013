"""Position control: a law without numbers, beside which there is no other option, and which no rig can use."""

from __future__ import annotations

import numpy as np
import pytest

from whiptool.commands.options.controller_options import ControllerOptions
from whiptool.commands.options.rig_options import ArmOptions
from whiptool.errors import InputError
from whiptool.impedance import Controller, PositionControl
from whiptool.impedance.arm import Arm
from whiptool.impedance.controller_files import controller_from_table, controller_to_table
from whiptool.models import preset
from whiptool.models.strike import Strike

CONTROLLER = Controller(PositionControl())


def test_a_table_holds_its_name_alone():
    assert controller_to_table(CONTROLLER)["law"] == "position"
    assert controller_from_table({"law": "position"}) == CONTROLLER
    assert CONTROLLER.parameters() == {}
    with pytest.raises(InputError, match=r"^controller\.K: "):
        controller_from_table({"law": "position", "K": [[1.0]]})


@pytest.mark.parametrize(
    ("option", "value"),
    [("feedforward", True), ("torque_limit", 3.0), ("control_period", 0.002), ("compensated", (1.0, 1.0, 1.0))],
)
def test_it_has_no_options(option, value):
    with pytest.raises(InputError, match=rf"^{option}: .*only without position control"):
        Controller(PositionControl(), **{option: value})


def test_it_gives_no_torques_to_a_rig():
    model = preset("lemon2024")
    with pytest.raises(InputError, match=r"^controller: got 'position'; allowed: a law that gives torques"):
        CONTROLLER.bind(Arm(model), Strike((0.0, 0.1), (0.5, 0.6), 0.5))


@pytest.mark.parametrize("port", ["twin", "/dev/ttyUSB0"])
def test_a_rigs_options_refuse_it(port):
    with pytest.raises(InputError, match=r"^--controller: got 'position'; allowed: one that gives torques"):
        ArmOptions(controller="position", port=port, target=(1.3, 0.0)).build_controller()


def test_it_fits_every_arm_and_has_no_impedance():
    for name in ("lemon2024", "ur5e"):
        model = preset(name)
        CONTROLLER.check_fits(model.arm)
        assert CONTROLLER.reckoning_with(model) == CONTROLLER
    K, B = CONTROLLER.law.gains(np.ones((5, 3)), np.ones((5, 3)))
    assert K.shape == B.shape == (5, 3, 3)
    assert not K.any()
    assert not B.any()


def test_the_option_takes_it_without_a_preset():
    assert ControllerOptions(controller="position").build_controller() == CONTROLLER
    assert ControllerOptions(controller="position").controller_label() == "position control"
    for option, value in (("preset", "nah2020"), ("feedforward", True), ("torque_limit", 2.0)):
        with pytest.raises(InputError, match="only without"):
            ControllerOptions(controller="position", **{option: value}).check()
