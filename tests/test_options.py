"""Groups of options: a controller in a file stands for all of its options, in every command."""

from __future__ import annotations

import re
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import get_args, get_type_hints

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
        (["simulate"], "--strike", "numbers q_si q_ei q_sf q_ef D"),
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


def names_of_the_library() -> dict[tuple[str, str], tuple]:
    """Options whose values are names, and what the library calls by them; `None` and `all` are the options' own."""
    from whiptool.adaptation.materials import MATERIALS
    from whiptool.adaptation.prior import WHIPS
    from whiptool.adaptation.twins import FAMILIES
    from whiptool.identification.drives import DRIVES
    from whiptool.identification.predict import NEUTRAL
    from whiptool.impedance import CONSTANT_PRESETS, OIAC_PRESETS
    from whiptool.models.motor_limits import LIMITS
    from whiptool.rig.dynamixel.control_table import BAUD_RATES
    from whiptool.rl.settings import SETTINGS
    from whiptool.rl.task import OBSERVATIONS, REWARDS
    from whiptool.rollout import reference
    from whiptool.studies.reproduction import PARTS
    from whiptool.studies.reproduction.unknown_whips import METHODS

    return {
        ("optimize.OptimizeOptions", "preset"): (*OIAC_PRESETS, *CONSTANT_PRESETS),
        ("optimize.OptimizeOptions", "integrator"): get_args(reference.Integrator),
        ("optimize.OptimizeOptions", "limits"): (*LIMITS, "arm", "none"),
        ("adapt.AdaptOptions", "limits"): (*LIMITS,),
        ("adapt.AdaptOptions", "family"): FAMILIES,
        ("adapt.AdaptOptions", "material"): (*MATERIALS,),
        ("adapt.AdaptOptions", "whip"): WHIPS,
        ("identify.IdentifyOptions", "drive"): DRIVES,
        ("identify.IdentifyOptions", "per_recording"): (*NEUTRAL, "start"),
        ("train.TrainOptions", "method"): (*SETTINGS,),
        ("train.TrainOptions", "observation"): OBSERVATIONS,
        ("train.TrainOptions", "reward"): (*REWARDS,),
        ("compare.CompareOptions", "observation"): OBSERVATIONS,
        ("reproduce.ReproduceOptions", "what"): (*PARTS, "all"),
        ("reproduce.ReproduceOptions", "rows"): (*METHODS, "chain"),
        ("dynamixel.ServoOptions", "baud"): (*BAUD_RATES.values(),),
        ("emulator.EmulatorOptions", "baud"): (*BAUD_RATES.values(),),
    }


def test_choices_are_what_the_library_knows():
    pytest.importorskip("torch")
    for (command, name), known in names_of_the_library().items():
        module, kind = command.split(".")
        options = getattr(import_module(f"whiptool.commands.{module}"), kind)
        choices = cli.choices(get_type_hints(options)[name])
        assert sorted(choices) == sorted(known), f"{command}.{name}"


def test_open_ended_choices_list_what_the_library_knows(capsys):
    """Laws, models and methods are listed though files or names of NLopt may stand in their place."""
    from whiptool.models import PRESETS
    from whiptool.optimizers import METHODS

    with pytest.raises(SystemExit):
        optimize.main(["--help"])
    said = re.sub(r"[\s│]", "", capsys.readouterr().out)
    assert "--model{" + ",".join(PRESETS) + "}|FILE.toml" in said
    assert "--controller{oiac,constant}|FILE.toml" in said
    (listed,) = re.findall(r"--method\{(.*?)\}", said)
    assert sorted(listed.split(",")) == sorted([*METHODS, "nlopt:NAME"])


def test_a_name_that_is_none_is_told_the_choices_in_their_order(capsys):
    for words, said in (
        (["optimize", "--preset", "table5"], "--preset: got 'table5'; allowed: printed, table4"),
        (["optimize", "--integrator", "RK5"], "--integrator: got 'RK5'; allowed: RK4, Euler, implicit, implicitfast"),
        (["compare", "--observation", "god"], "--observation: got 'god'; allowed: paper, relative, goal"),
        (["rig.dynamixel", "--port", "x", "--baud", "3"], "--baud: got '3'; allowed: 9600, 57600"),
    ):
        command, *rest = words
        assert import_module(f"whiptool.commands.{command.removeprefix('rig.')}").main(rest) == 2
        assert said in capsys.readouterr().err


@pytest.mark.parametrize("name", ["t_stay", "t stay"])
def test_errors_of_the_library_name_options_in_commands(name):
    options = optimize.OptimizeOptions()
    with pytest.raises(InputError, match=r"^--t-stay: got 1; allowed: less; wait$"), cli.options_named(options):
        raise InputError(name, 1, "less", "wait")
    for other in ("whip.k", "t_stayed", "strike"):
        with pytest.raises(InputError, match=f"^{other}: got 1"), cli.options_named(options):
            raise InputError(other, 1, "less")


def test_what_is_positional_keeps_its_name():
    from whiptool.commands.identify_options import IdentifyOptions

    with pytest.raises(InputError, match=r"^recordings: "), cli.options_named(IdentifyOptions()):
        raise InputError("recordings", "none", "one")


def test_a_run_keeps_its_options_but_not_those_of_a_call():
    from whiptool.commands.rig import LearnOptions

    options = LearnOptions(out=Path("x"), resume=Path("y"), json=True, yes=True, seed=3, max_trials=2)
    assert options.kept() == LearnOptions(seed=3, max_trials=2)
    assert cli.configuration(options, "rig learn", free=["k"]) == {
        "command": "rig learn",
        "options": cli.as_plain(LearnOptions(seed=3, max_trials=2)),
        "free": ["k"],
    }


@pytest.mark.parametrize("command", ["train", "compare"])
def test_a_training_without_an_episode_to_learn_in_says_what_to_give(command: str, capsys) -> None:
    """Who asks for 20 episodes has not heard of the 50 random ones."""
    assert import_module(f"whiptool.commands.{command}").main(["--episodes", "20"]) == 2
    assert capsys.readouterr().err == (
        "whiptool: --random-episodes: got 50; allowed: a whole number from 0 to 19, fewer than --episodes 20: random "
        "episodes come first, and nothing is learned in them; give --random-episodes 4; it is 50 unless given\n"
    )
