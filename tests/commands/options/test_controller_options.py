"""Options of the controller: laws and presets, those of a model's own, and files that stand for all of them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest

from whiptool.commands import optimize, run_folders, simulate
from whiptool.commands.options.controller_options import (
    ControllerOptions,
    LawOptions,
    SimulatedControllerOptions,
    SpaceOptions,
)
from whiptool.commands.options.model_options import ModelOptions
from whiptool.commands.options.rig_options import ArmOptions
from whiptool.errors import InputError
from whiptool.impedance import (
    OIAC,
    ConstantImpedance,
    Controller,
    HandControl,
    PositionControl,
    constant_preset,
    default_controller,
    hand_impedance,
)
from whiptool.impedance.controller import write_controller
from whiptool.models.files import write_model
from whiptool.models.parameters import ArmLink, ArmParameters
from whiptool.models.presets import PRESETS, preset

OWN = Controller(OIAC(a=0.05), feedforward=True, torque_limit=7.0)


@pytest.fixture
def file(tmp_path) -> str:
    write_controller(OWN, tmp_path / "own.toml")
    return str(tmp_path / "own.toml")


@pytest.mark.parametrize("group", [LawOptions, ControllerOptions, SimulatedControllerOptions, ArmOptions])
def test_every_command_takes_a_controller_from_a_file(group, file):
    options = group(controller=file)
    options.check()
    assert options.build_controller() == OWN
    assert options.law_label() == "the controller of own.toml"


def test_without_a_file_the_options_say_it():
    options = SimulatedControllerOptions(preset="printed", feedforward=True, torque_limit=3.0, control_period=0.01)
    assert options.build_controller() == Controller(OIAC(), True, 3.0, 0.01)
    assert ArmOptions().build_controller() == Controller(OIAC())
    assert LawOptions(controller="constant").build_controller() == Controller(ConstantImpedance())
    assert options.controller_label() == "OIAC printed with feedforward"


@pytest.mark.parametrize(
    "beside", [{"preset": "printed"}, {"feedforward": True}, {"torque_limit": 3.0}, {"control_period": 0.01}]
)
def test_what_a_file_has_is_refused_beside_it(beside, file):
    option = "--" + next(iter(beside)).replace("_", "-")
    with pytest.raises(InputError, match=f"{option}.*write it into the file"):
        SimulatedControllerOptions(controller=file, **beside).check()


def test_a_rig_holds_its_torque_for_a_cycle_in_any_case(tmp_path):
    write_controller(replace(OWN, control_period=0.01), tmp_path / "held.toml")
    SimulatedControllerOptions(controller=str(tmp_path / "held.toml")).check()
    with pytest.raises(InputError, match="a cycle of --rate"):
        ArmOptions(controller=str(tmp_path / "held.toml")).check()


def test_a_file_that_holds_none_is_refused(tmp_path):
    (tmp_path / "empty.toml").write_text("x = 1\n")
    for name, said in (
        ("empty.toml", r"\[controller\]"),
        ("nothing.toml", "no such file"),
        ("magic", ".toml file"),
    ):
        with pytest.raises(InputError, match=said):
            LawOptions(controller=str(tmp_path / name) if name.endswith(".toml") else name).check()


def test_gains_for_other_arms_come_from_a_file(tmp_path):
    """Eq. 22 is of two joints; an arm of three takes matrices of its own."""
    arm = ArmParameters(tuple(ArmLink(mass=0.2, length=0.3) for _ in range(3)))
    gains = tuple(tuple(10.0 * (i == j) for j in range(3)) for i in range(3))
    write_controller(Controller(ConstantImpedance(gains, gains)), tmp_path / "three.toml")
    LawOptions(controller=str(tmp_path / "three.toml")).build_controller().check_fits(arm)
    with pytest.raises(InputError, match="one per arm joint"):
        LawOptions(controller="constant").build_controller().check_fits(arm)


def test_a_resumed_run_finds_its_file_from_elsewhere(file, monkeypatch):
    monkeypatch.chdir(Path(file).parent)
    assert run_folders.as_plain(optimize.OptimizeOptions(controller="own.toml"))["controller"] == file


@dataclass(frozen=True, kw_only=True)
class StrikeOptions(SimulatedControllerOptions, ModelOptions):
    """A command that has a model beside its controller."""

    in_space: ClassVar[bool] = True


COMMANDS = [StrikeOptions, optimize.OptimizeOptions, simulate.SimulateOptions]


@pytest.mark.parametrize("command", COMMANDS)
def test_the_persons_arm_has_the_impedance_that_was_published_with_it(command):
    options = command(model="nah2023")
    assert options.build_controller() == Controller(constant_preset("nah2023")) == default_controller(preset("nah2023"))
    assert options.law_label() == "constant impedance nah2023"


@pytest.mark.parametrize("model", ["ur5e", "panda"])
@pytest.mark.parametrize("command", COMMANDS)
def test_robots_go_where_they_are_told_unless_impedance_is_asked_for(command, model):
    options = command(model=model)
    assert options.build_controller() == Controller(PositionControl()) == default_controller(preset(model))
    assert options.law_label() == "position control"
    asked = command(model=model, controller="constant")
    assert asked.build_controller() == Controller(constant_preset(model))
    assert asked.law_label() == f"constant impedance {model}"
    asked.build_controller().check_fits(preset(model).arm)


def test_an_arm_from_a_file_is_a_robot(tmp_path):
    write_model(replace(preset("panda"), name="mine"), tmp_path / "mine.toml")
    for given in ({"model": str(tmp_path / "mine.toml")}, {"arm": str(tmp_path / "mine.toml")}):
        assert StrikeOptions(**given).build_controller() == Controller(PositionControl())
    assert StrikeOptions(arm="panda", controller="constant").build_controller() == Controller(constant_preset("panda"))


@pytest.mark.parametrize("given", [{"feedforward": True}, {"torque_limit": 3.0}, {"control_period": 0.01}])
def test_what_position_control_has_no_use_for_asks_for_another_law(given):
    with pytest.raises(InputError, match=r"only without position control; give --controller constant"):
        StrikeOptions(model="ur5e", **given).check()
    StrikeOptions(model="ur5e", controller="constant", **given).check()


@pytest.mark.parametrize("model", ["nah2023", "ur5e", "panda"])
@pytest.mark.parametrize(("name", "law"), [("printed", OIAC()), ("table4", OIAC(a=1.3e-4))])
def test_a_preset_of_oiac_beside_them_asks_for_oiac(model, name, law):
    options = StrikeOptions(model=model, preset=name)
    assert options.build_controller() == Controller(law)
    assert options.law_label() == f"OIAC {name}"


@pytest.mark.parametrize("model", [name for name, model in PRESETS.items() if model.dimension == 2])
def test_planar_models_get_oiac(model):
    assert StrikeOptions(model=model).build_controller() == Controller(OIAC(a=1.3e-4))  # fitted to Table 4
    assert StrikeOptions(model=model).law_label() == "OIAC table4"
    assert StrikeOptions(model=model, preset="printed").build_controller() == Controller(OIAC())
    constant = StrikeOptions(model=model, controller="constant")
    assert constant.build_controller() == Controller(ConstantImpedance())  # Eq. 22
    assert constant.law_label() == "constant impedance"


@pytest.mark.parametrize("model", ["nah2023", "ur5e", "panda"])
def test_oiac_is_given_where_it_is_asked_for(model):
    assert StrikeOptions(model=model, controller="oiac").build_controller() == Controller(OIAC(a=1.3e-4))


def test_a_constant_preset_is_taken_before_the_models_own():
    assert StrikeOptions(model="ur5e", preset="panda").build_controller() == Controller(constant_preset("panda"))
    for command in (StrikeOptions, LawOptions):
        options = command(controller="constant", preset="nah2023")
        assert options.build_controller() == Controller(constant_preset("nah2023"))


@pytest.mark.parametrize(
    ("given", "allowed"),
    [
        ({"controller": "constant", "preset": "printed"}, "nah2020, nah2023, ur5e, panda, fr3"),
        ({"model": "ur5e", "controller": "constant", "preset": "table4"}, "nah2020, nah2023, ur5e, panda, fr3"),
        ({"controller": "oiac", "preset": "nah2020"}, "printed, table4"),
        ({"preset": "nah2020"}, "printed, table4"),
        ({"model": "ur5e", "controller": "oiac", "preset": "ur5e"}, "printed, table4"),
    ],
)  # fmt: skip
def test_presets_of_the_other_law_are_refused(given, allowed):
    with pytest.raises(InputError) as caught:
        StrikeOptions(**given).check()
    assert (caught.value.name, caught.value.given, caught.value.allowed) == ("--preset", given["preset"], allowed)


@pytest.mark.parametrize(
    ("option", "value"),
    [
        ("controller", "pid"), ("controller", ""), ("torque_limit", 0.0), ("control_period", 0.0),
        ("control_period", 0.11), ("control_period", float("nan")),
    ],
)  # fmt: skip
def test_values_out_of_range_are_named(option, value):
    with pytest.raises(InputError) as caught:
        StrikeOptions(**{option: value}).check()
    assert caught.value.name.lstrip("-").replace("-", "_") == option


@pytest.mark.parametrize("given", [{"model": "nobody"}, {"arm": "nobody"}])
def test_a_model_that_is_none_is_not_taken_for_a_preset(given):
    name = next(iter(given))
    with pytest.raises(InputError, match=f"^(--)?{name}: got 'nobody'"):
        StrikeOptions(controller="constant", **given).build_controller()


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
