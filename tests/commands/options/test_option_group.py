"""What all groups of options have in common: what of them is kept, what they refuse, how they are written."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import pytest
from tyro.conf import Positional

from whiptool.commands import cli, run_folders
from whiptool.commands.options.option_group import (
    Names,
    OptionGroup,
    OutputOptions,
    ResumableOptions,
    SeedOptions,
    flag,
    flags,
    renaming,
    whole,
)
from whiptool.errors import InputError


@dataclass(frozen=True, kw_only=True)
class Pace(OptionGroup):
    """A group of a test."""

    of_this_call: ClassVar[tuple[str, ...]] = ("quiet",)
    changeable: ClassVar[tuple[str, ...]] = ("workers",)

    quiet: bool = False
    workers: int = 1
    t_stay: float = 0.3


@dataclass(frozen=True, kw_only=True)
class Command(Pace, SeedOptions, ResumableOptions):
    """A command of several groups."""

    run: Positional[str] = "x"


def test_a_command_has_what_all_its_groups_name():
    assert Command.named("of_this_call") == {"quiet", "json", "out", "resume"}
    assert Command.named("changeable") == {"workers"}
    assert Command.named("may_be_empty") == set()
    assert OutputOptions.named("of_this_call") == {"json", "quiet", "out"}
    assert SeedOptions.named("of_this_call") == set()


def test_what_is_of_this_call_is_not_kept_with_the_run():
    given = Command(quiet=True, workers=3, t_stay=0.5, seed=4, json=True, out=Path("a"), resume=Path("b"))
    assert given.kept() == Command(workers=3, t_stay=0.5, seed=4)
    assert given.kept().kept() == given.kept()


def test_a_run_keeps_its_options_but_not_those_of_a_call():
    from whiptool.commands.rig import LearnOptions

    options = LearnOptions(out=Path("x"), resume=Path("y"), json=True, yes=True, seed=3, max_trials=2)
    assert options.kept() == LearnOptions(seed=3, max_trials=2)
    assert run_folders.configuration(options, "rig learn", free=["k"]) == {
        "command": "rig learn",
        "options": run_folders.as_plain(LearnOptions(seed=3, max_trials=2)),
        "free": ["k"],
    }


@pytest.mark.parametrize(("seed", "good"), [(0, True), (2**31 - 1, True), (-1, False), (2**31, False)])
def test_seeds_are_whole_numbers_from_zero(seed, good):
    if good:
        Command(seed=seed).check()
        return
    with pytest.raises(InputError, match=rf"^--seed: got {seed}; allowed: a whole number from 0 to 2147483647$"):
        Command(seed=seed).check()


@pytest.mark.parametrize("value", [2, 3, 5])
def test_whole_numbers_of_a_range_pass(value):
    assert whole("--n", value, low=2, high=5) == value


@pytest.mark.parametrize("value", [1, 6, -3])
def test_whole_numbers_out_of_a_range_are_refused(value):
    with pytest.raises(InputError) as caught:
        whole("--n", value, low=2, high=5)
    assert (caught.value.name, caught.value.given) == ("--n", value)
    assert caught.value.allowed == "a whole number from 2 to 5"


def test_options_that_would_change_nothing_are_refused():
    Command(workers=7).refuse_given("nothing", "t_stay", "seed")  # of others nothing is said
    Command(t_stay=0.3, seed=0).refuse_given("nothing", "t_stay", "seed")  # the same as not given
    with pytest.raises(InputError) as caught:
        Command(t_stay=0.5).refuse_given("only without --resume", "seed", "t_stay")
    assert str(caught.value) == "--t-stay: got 0.5; allowed: only without --resume"


def test_what_is_usual_may_be_other_than_the_default():
    class Slower(Command):
        def usual(self, name: str) -> object:
            return 0.5 if name == "t_stay" else super().usual(name)

    Slower(t_stay=0.5).refuse_given("nothing", "t_stay")
    with pytest.raises(InputError, match=r"^--t-stay: got 0\.3"):
        Slower().refuse_given("nothing", "t_stay")


def test_options_are_written_with_dashes_but_positional_ones_are_not():
    assert flag("t_stay") == "--t-stay"
    assert flag("seed") == "--seed"
    assert dict(flags(Command())) == {
        "quiet": "--quiet", "workers": "--workers", "t_stay": "--t-stay", "seed": "--seed",
        "json": "--json", "out": "--out", "resume": "--resume",
    }  # fmt: skip


def test_names_are_those_of_the_library_in_any_spelling():
    known = Names("whiptool.goals.criteria:CRITERIA", others=("none",), without=("miss",))
    assert known.known() == ["effort", "peak-torque", "speed", "robustness", "none"]
    assert known.name("--minimise", "Peak_Torque") == "peak-torque"
    with pytest.raises(InputError, match="--minimise: got 'beauty'; allowed: effort, peak-torque"):
        known.name("--minimise", "beauty")
    assert Names("whiptool.models.presets:PRESETS", beside="|FILE.toml").name("--model", "own.toml") == "own.toml"


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["optimize", "--preset", "table5"], "--preset: got 'table5'; allowed: printed, table4"),
        (["optimize", "--integrator", "RK5"], "--integrator: got 'RK5'; allowed: RK4, Euler, implicit, implicitfast"),
        (["compare", "--observation", "god"], "--observation: got 'god'; allowed: tip, relative, goal"),
        (["servos", "--port", "x", "--baud", "3"], "--baud: got '3'; allowed: 9600, 57600"),
    ],
)
def test_a_name_that_is_none_is_told_the_choices_in_their_order(words, said, capsys):
    assert cli.main_of(words[0])(words[1:]) == 2
    assert said in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (
            ["--throw", "--box", 2, 0, 0.2, "--most-speed", 1, "--least-speed", 2],
            "--most-speed: got 1.0; allowed: a speed above the least speed, 2 m/s",
        ),
        (["--lower", 0, 0, 0, 0, 2, "--upper", 1, 1, 1, 1, 1], "--lower and --upper, number 5: got (2.0, 1.0)"),
        (["--throw", "--box", 2, 0, 0.2, "--box-normal", 1, -1], "--box-normal: got (1.0, -1.0)"),
        (["--throw", "--box", 2, 0, 0.2, "--box-velocity", 99, 0], "--box-velocity: got (99.0, 0.0)"),
        (["--throw", "--box", 2, 0, 0.2, "--thing-mass", 1e-9], "--thing-mass and --thing-diameter: got 354"),
    ],
)
def test_an_error_of_the_library_names_the_option_that_was_given(capsys, words, said):
    from whiptool.commands.optimize import main

    assert main(list(map(str, words))) == 2
    assert f"whiptool: {said}" in capsys.readouterr().err


def test_a_number_of_an_argument_that_is_no_list_keeps_its_place():
    with pytest.raises(InputError, match=r"^new, number 3: got 1"), renaming({"old": "new"}):
        raise InputError("old[2]", 1, "2")
    with pytest.raises(InputError, match=r"^new\[elbow\]: got 1"), renaming({"old": "new"}):
        raise InputError("old[elbow]", 1, "2")


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("foo = 1", r"config\.toml: foo: got 1; allowed: only version, command, options, model, .*; remove it$"),
        ("[options]\nsed = 4", r"config\.toml: options\.sed: got 4; allowed: an option .*; did you mean seed\?$"),
        ("[options]\nzzz = 4", r"config\.toml: options\.zzz: got 4; allowed: an option .*; begin a new run$"),
        ("[options]\nseed = 'x'", r"config\.toml: options\.seed: got 'x'; allowed: a value of the kind int$"),
        ("[options]\nseed = 4", ""),
    ],
)
def test_what_a_stored_configuration_says_is_heard_or_refused_by_file_and_key(tmp_path, line, said):
    (tmp_path / "config.toml").write_text(f'command = "pace"\n{line}\n' + "[options]\n" * ("[" not in line))
    if not said:
        assert run_folders.options_of_run(Command, tmp_path, command="pace").seed == 4
        return
    with pytest.raises(InputError, match=said):
        run_folders.options_of_run(Command, tmp_path, command="pace")


def test_an_option_without_a_default_that_a_stored_configuration_lacks_is_named(tmp_path):
    @dataclass(frozen=True, kw_only=True)
    class Needing(OptionGroup):
        recordings: tuple[str, ...]

    with pytest.raises(InputError, match=r"config\.toml: options\.recordings: got nothing; allowed: a value$"):
        run_folders.stored_options(Needing, {}, tmp_path)
