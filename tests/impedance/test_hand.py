"""Control of the hand: its numbers, its files, and gains that nobody has measured."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import eigvalsh

from whiptool.errors import InputError
from whiptool.impedance import OIAC, Controller, HandControl, PositionControl, hand_impedance
from whiptool.impedance.arm import Arm
from whiptool.impedance.controller_files import (
    controller_from_table,
    controller_to_table,
    read_controller,
    write_controller,
)
from whiptool.models import preset
from whiptool.models.joint_space import JointSpace

LEMON = preset("lemon2024")


def test_its_controller_reads_back_from_a_file(tmp_path):
    for hand in (HandControl(orientation=True), HandControl(posture=(0.4, 1.2), null_damping=0.5)):
        for law in (OIAC(a=0.01), PositionControl()):
            write_controller(Controller(law, hand=hand), tmp_path / "c.toml")
            assert read_controller(tmp_path / "c.toml") == Controller(law, hand=hand)


def test_a_controller_of_the_joints_has_the_table_that_it_had():
    assert set(controller_to_table(Controller())) == {"law", "a", "beta", "C", "feedforward"}


@pytest.mark.parametrize(
    ("table", "said"),
    [
        ({"magic": 1}, "controller.hand.magic"),
        (3, "controller.hand: got 3"),
        ({"null_damping": -1}, "controller.hand.null_damping"),
        ({"orientation": 1}, "controller.hand.orientation"),
        ({"posture": [0.1, "a"]}, r"controller.hand.posture\[1\]"),
        ({"posture": 3}, "controller.hand.posture"),
    ],
)
def test_bad_tables_are_refused(table, said):
    with pytest.raises(InputError, match=said):
        controller_from_table({"law": "oiac", "hand": table})


def test_feedforward_has_no_meaning_there():
    with pytest.raises(InputError, match="only in joint space"):
        Controller(feedforward=True, hand=HandControl())


def test_the_space_of_strikes_follows_from_the_controller():
    assert isinstance(Controller().strike_space(LEMON.arm), JointSpace)
    space = Controller(hand=HandControl()).strike_space(LEMON.arm)
    assert space.kind == "hand"
    assert Controller(hand=HandControl()).strike_space(LEMON.arm) is space
    assert Controller(OIAC(), hand=HandControl(null_damping=0.7)).parameters()["null_damping"] == 0.7
    assert "null_damping" not in Controller(PositionControl(), hand=HandControl()).parameters()


@pytest.mark.parametrize(("name", "pose"), [("lemon2024", False), ("ur5e", False), ("ur5e", True), ("panda", True)])
def test_usual_gains_give_the_hand_its_frequency_where_it_is_the_heaviest(name, pose):
    """Generalised eigenvalues of the joints' stiffness and inertia, the whip's mass fixed to the hand."""
    model, hand = preset(name), HandControl(orientation=pose)
    law = hand_impedance(model, hand, frequency=2.0)
    kinematics = Controller(hand=hand).strike_space(model.arm).kinematics
    q, K = kinematics.posture, np.array(law.K)
    J, arm = kinematics.jacobian(q), Arm(model)
    moving = J[: model.dimension]
    inertia = arm.inertia(q) + model.whip.mass * moving.T @ moving
    squares = eigvalsh(J.T @ K @ J, inertia)
    lowest = squares[squares > 1e-6 * squares.max()][0]
    assert np.sqrt(lowest) / (2 * np.pi) == pytest.approx(2.0, rel=1e-6)
    np.testing.assert_allclose(np.array(law.B), 2 * K / (2 * np.pi * 2.0), rtol=1e-12)  # critical
    if pose:  # in all its motions
        np.testing.assert_allclose(squares[-6:], (2 * np.pi * 2.0) ** 2, rtol=1e-6)
        np.testing.assert_allclose(K, K.T)
