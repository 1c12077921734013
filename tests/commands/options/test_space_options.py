"""Options of what strikes are told by: the controllers that they come to, and their words."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pytest

from whiptool.commands.options.space_options import SpaceOptions
from whiptool.commands.options.target_options import ModelOptions
from whiptool.impedance import HandControl, PositionControl, hand_impedance
from whiptool.models import preset


@dataclass(frozen=True, kw_only=True)
class Options(SpaceOptions, ModelOptions):
    """Of a command that takes models in space."""

    in_space: ClassVar[bool] = True


def test_a_pose_has_gains_of_its_own_for_turns_and_the_usual_ones_elsewhere():
    options = Options(model="ur5e", space="pose", controller="constant", stiffness=900.0, turn_damping=7.0)
    options.check()
    controller = options.build_controller()
    usual = hand_impedance(preset("ur5e"), HandControl(orientation=True))
    assert controller.hand == HandControl(orientation=True)
    for found, other, place, turn in (
        (controller.law.K, usual.K, 900.0 * np.eye(3), None),
        (controller.law.B, usual.B, None, 7.0 * np.eye(3)),
    ):
        gains, other = np.array(found), np.array(other)
        np.testing.assert_allclose(gains[:3, :3], other[:3, :3] if place is None else place)
        np.testing.assert_allclose(gains[3:, 3:], other[3:, 3:] if turn is None else turn)
        np.testing.assert_allclose(gains[:3, 3:], 0)
        assert (np.linalg.eigvalsh(gains) > 0).all()
    plain = Options(model="ur5e", space="pose", controller="constant").build_controller()
    assert plain.law == usual


@pytest.mark.parametrize(
    ("given", "label"),
    [
        ({"space": "joint"}, "position control"),
        ({"space": "joint", "controller": "constant"}, "constant impedance ur5e"),
        ({"space": "hand", "controller": "constant"}, "constant impedance of the hand"),
        ({"space": "pose", "controller": "constant"}, "constant impedance of the hand's pose"),
        ({"space": "pose"}, "position control of the hand's pose"),
        ({"space": "hand", "controller": "oiac"}, "OIAC table4 of the hand"),
    ],
)
def test_the_controller_in_words(given, label):
    assert Options(model="ur5e", **given).controller_label() == label


def test_position_control_of_a_pose_leads_the_joints_along_the_hands_way():
    controller = Options(model="panda", space="pose", controller="position").build_controller()
    assert isinstance(controller.law, PositionControl)
    space = controller.strike_space(preset("panda").arm)
    assert (space.kind, space.led, space.width) == ("pose", True, 13)
