"""Controllers in files: they come back as they were, and whatever is wrong in a file is named."""

from __future__ import annotations

import pytest

from whiptool.errors import InputError
from whiptool.impedance import OIAC, ConstantImpedance, Controller
from whiptool.impedance.controller_files import (
    controller_from_table,
    controller_to_table,
    read_controller,
    write_controller,
)

CONTROLLERS = (
    Controller(),
    Controller(law=ConstantImpedance(), torque_limit=20.0),
    Controller(control_period=1e-3, compensated=(0.25, 0.274, 0.144)),
    Controller(law=ConstantImpedance(((3.0,),), ((0.3,),)), feedforward=True),
)


@pytest.mark.parametrize("controller", CONTROLLERS)
def test_controllers_come_back_from_tables_and_files(controller, tmp_path):
    assert controller_from_table(controller_to_table(controller)) == controller
    file = tmp_path / "controller.toml"
    write_controller(controller, file)
    assert read_controller(file) == controller


def test_a_table_is_what_a_person_would_write():
    assert controller_from_table({"law": "oiac", "a": 0.1, "feedforward": True}) == Controller(
        OIAC(a=0.1), feedforward=True
    )
    constant = controller_from_table({"law": "constant", "K": [[1.0, 0.0], [0.0, 2.0]], "torque_limit": 3.0})
    assert constant.torque_limit == 3.0
    assert isinstance(constant.law, ConstantImpedance)
    assert constant.law.K == ((1.0, 0.0), (0.0, 2.0))


def test_a_file_may_hold_other_tables(tmp_path):
    """The config.toml of a run folder is one."""
    file = tmp_path / "config.toml"
    file.write_text('command = "optimize"\n[model]\nname = "x"\n[controller]\nlaw = "oiac"\na = 0.3\n')
    assert read_controller(file) == Controller(OIAC(a=0.3))


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("", r"\[controller\]"),
        ("controller = 3", r"\[controller\]"),
        ("[controller]", "controller.law"),
        ('[controller]\nlaw = "magic"', "controller.law"),
        ('[controller]\nlaw = "oiac"\nb = 1', "controller.b"),
        ('[controller]\nlaw = "oiac"\na = -1', "controller.a"),
        ('[controller]\nlaw = "oiac"\na = "x"', "controller.a"),
        ('[controller]\nlaw = "oiac"\nfeedforward = "yes"', "controller.feedforward"),
        ('[controller]\nlaw = "oiac"\ntorque_limit = 0', "controller.torque_limit"),
        ('[controller]\nlaw = "oiac"\ncompensated = [1, nan, 1]', "controller.compensated"),
        ('[controller]\nlaw = "constant"\nK = "x"', "controller"),
        ('[controller]\nlaw = "constant"\nK = [[1, 2]]', "controller.K"),
        ('[controller]\nlaw = "constant"\nK = [[1]]', "controller.B"),
        ('[controller]\nlaw = "constant"\nK = [[1, 2], [3]]', "controller.K"),
        ('[controller]\nlaw = "constant"\nK = [["a", 2], [3, 4]]', "controller.K"),
        ('[controller]\nlaw = "constant"\nK = [[1e7, 0], [0, 1]]', "controller.K"),
        ('[controller]\nlaw = "constant"\nB = [[-1, 0], [0, 1]]', "controller.B"),
        ('[controller]\nlaw = "constant"\nK = [[1, 2], [2, 1]]', "controller.K: .*no eigenvalue below 0"),
        ('torque_limit = 4.0\n[controller]\nlaw = "oiac"', "torque_limit"),
        ('a = 0.3\n[controller]\nlaw = "oiac"', "a: got 0.3; allowed: a below the line"),
        ("[controller", "valid TOML"),
    ],
)
def test_what_is_wrong_is_named(text, named, tmp_path):
    file = tmp_path / "controller.toml"
    file.write_text(text)
    with pytest.raises(InputError, match=named) as refused:
        read_controller(file)
    assert str(file) in str(refused.value)


def test_a_file_that_is_not_there_is_named(tmp_path):
    with pytest.raises(InputError, match="readable TOML file"):
        read_controller(tmp_path / "nothing.toml")
