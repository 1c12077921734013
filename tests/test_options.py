"""Groups of options: a controller in a file stands for all of its options, in every command."""

from __future__ import annotations

from dataclasses import replace
from importlib import import_module
from pathlib import Path

import pytest

from whiptool.commands import cli, optimize
from whiptool.commands.rig import ArmOptions
from whiptool.errors import InputError
from whiptool.impedance import OIAC, ConstantImpedance, Controller
from whiptool.impedance.files import write_controller
from whiptool.models.parameters import ArmLink, ArmParameters
from whiptool.options import ControllerOptions, LawOptions, SimulatedControllerOptions

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
    assert cli.as_plain(optimize.OptimizeOptions(controller="own.toml"))["controller"] == file


@pytest.mark.parametrize(
    ("words", "option", "meaning"),
    [
        (["rig", "strike"], "--strike", "q_si q_ei q_sf q_ef [rad] D [s]"),
        (["view"], "RUN", "Run folder"),
        (["simulate"], "--strike", "five numbers"),
        (["optimize", "--method"], "--method", "a value"),
        (["compare", "--methods"], "--methods", "one value or more"),
    ],
)
def test_what_is_missing_is_named_with_its_meaning(words, option, meaning, capsys):
    command, *rest = words
    assert import_module(f"whiptool.commands.{command}").main(rest) == 2
    said = capsys.readouterr().err
    assert said.startswith(f"whiptool: {option}: got nothing; allowed: {meaning}")
    assert said.count("\n") == 1


@pytest.mark.parametrize("command", ["train", "compare"])
def test_a_training_without_an_episode_to_learn_in_says_what_to_give(command: str, capsys) -> None:
    """Who asks for 20 episodes has not heard of the 50 random ones."""
    assert import_module(f"whiptool.commands.{command}").main(["--episodes", "20"]) == 2
    assert capsys.readouterr().err == (
        "whiptool: --random-episodes: got 50; allowed: a whole number from 0 to 19, fewer than --episodes 20: random "
        "episodes come first, and nothing is learned in them; give --random-episodes 4; it is 50 unless given\n"
    )
