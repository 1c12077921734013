"""Options whose values are names: they offer what the library knows, in every command."""

from __future__ import annotations

import re
from importlib import import_module
from typing import get_args, get_type_hints

import pytest

from whiptool.commands import cli, optimize


def names_of_the_library() -> dict[tuple[str, str], tuple]:
    """Options whose values are names, and what the library calls by them; `None` and `all` are the options' own."""
    from papers.parts import PARTS
    from papers.unknown.study import WAYS
    from whiptool.adaptation.materials import MATERIALS
    from whiptool.adaptation.prior import WHIPS
    from whiptool.adaptation.twins import FAMILIES
    from whiptool.goals.criteria import CRITERIA
    from whiptool.identification.drives import DRIVES
    from whiptool.identification.placement import NEUTRAL
    from whiptool.impedance import CONSTANT_PRESETS, OIAC_PRESETS
    from whiptool.limits.motor_limits import LIMITS
    from whiptool.rig.dynamixel.control_table import BAUD_RATES
    from whiptool.rl.settings import SETTINGS
    from whiptool.rl.task import OBSERVATIONS, REWARDS
    from whiptool.rollout import reference

    return {
        ("optimize.OptimizeOptions", "preset"): (*OIAC_PRESETS, *CONSTANT_PRESETS),
        ("optimize.OptimizeOptions", "integrator"): get_args(reference.Integrator),
        ("optimize.OptimizeOptions", "minimise"): CRITERIA,
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
        ("papers.reproduce.ReproduceOptions", "what"): (*PARTS, "all"),
        ("papers.reproduce.ReproduceOptions", "rows"): tuple(WAYS),
        ("dynamixel.ServoOptions", "baud"): (*BAUD_RATES.values(),),
        ("emulator.EmulatorOptions", "baud"): (*BAUD_RATES.values(),),
    }


def test_choices_are_what_the_library_knows():
    pytest.importorskip("torch")
    for (command, name), known in names_of_the_library().items():
        module, kind = command.rsplit(".", 1)
        options = getattr(import_module(module if "." in module else f"whiptool.commands.{module}"), kind)
        choices = cli.choices(get_type_hints(options)[name])
        assert sorted(choices) == sorted(known), f"{command}.{name}"


def test_open_ended_choices_list_what_the_library_knows(capsys):
    """Laws, models and methods are listed though files or names of NLopt may stand in their place."""
    from whiptool.models import PRESETS
    from whiptool.optimizers import METHODS

    with pytest.raises(SystemExit):
        optimize.main(["--help-all"])
    said = re.sub(r"[\s│]", "", capsys.readouterr().out)
    assert "--model{" + ",".join(PRESETS) + "}|FILE.toml" in said
    assert "--controller{oiac,constant,position}|FILE.toml" in said
    (listed,) = re.findall(r"--method\{(.*?)\}", said)
    assert sorted(listed.split(",")) == sorted([*METHODS, "nlopt:NAME"])


def test_a_name_that_is_none_is_told_the_choices_in_their_order(capsys):
    for words, said in (
        (["optimize", "--preset", "table5"], "--preset: got 'table5'; allowed: printed, table4"),
        (["optimize", "--integrator", "RK5"], "--integrator: got 'RK5'; allowed: RK4, Euler, implicit, implicitfast"),
        (["compare", "--observation", "god"], "--observation: got 'god'; allowed: tip, relative, goal"),
        (["rig.dynamixel", "--port", "x", "--baud", "3"], "--baud: got '3'; allowed: 9600, 57600"),
    ):
        command, *rest = words
        assert import_module(f"whiptool.commands.{command.removeprefix('rig.')}").main(rest) == 2
        assert said in capsys.readouterr().err
