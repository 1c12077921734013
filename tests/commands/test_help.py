"""Help: what is used most on one screen, everything in `--help-all`, types and defaults as people read them."""

from __future__ import annotations

import re
from dataclasses import fields, replace
from pathlib import Path

import pytest

from whiptool.commands import cli
from whiptool.commands.help import SCREEN, help_text
from whiptool.commands.optimize import OptimizeOptions
from whiptool.commands.options.identify_options import IdentifyOptions
from whiptool.commands.options.option_group import flag
from whiptool.commands.options.rig_options import AdaptOptions
from whiptool.commands.simulate import SimulateOptions
from whiptool.commands.train import TrainOptions
from whiptool.errors import InputError

MAIN = ["optimize", "simulate", "train", "compare", "map build", "map strike", "identify", "adapt", "view", "reproduce",
        "human", "doctor", "studio", "rig strike", "rig learn", "robot strike", "recording show",
        "recording convert"]  # fmt: skip


def said_by(words: str, capsys) -> str:
    command, *rest = words.split()
    with pytest.raises(SystemExit) as end:
        cli.main_of(command)(rest)
    assert end.value.code == 0
    return capsys.readouterr().out


@pytest.mark.parametrize("command", MAIN)
def test_help_fits_on_a_screen(command, capsys):
    lines = said_by(f"{command} --help", capsys).splitlines()
    assert len(lines) <= SCREEN
    assert max(map(len, lines)) <= 100


@pytest.mark.parametrize("command", MAIN)
def test_all_help_has_every_option_and_the_first_screen_says_where_it_is(command, capsys):
    whole, first = said_by(f"{command} --help-all", capsys), said_by(f"{command} -h", capsys)
    assert max(map(len, whole.splitlines())) <= 100
    if first != whole:
        assert first.splitlines()[-1].endswith(f"more options: whiptool {command} --help-all")


def test_what_is_used_most_comes_first_in_groups(capsys):
    lines = said_by("optimize --help", capsys).splitlines()
    places = [next(i for i, line in enumerate(lines) if line.strip().startswith(x)) for x in
              ("--method", "target:", "--target", "--hit-radius", "model:", "--model", "-o, --out")]  # fmt: skip
    assert places == sorted(places)
    assert "--null-damping" not in "\n".join(lines)


@pytest.mark.parametrize("command", ["rig", "map", "recording"])
def test_lists_of_subcommands_are_wrapped(command, capsys):
    assert cli.main_of(command)(["--help"]) == 0
    assert max(map(len, capsys.readouterr().out.splitlines())) <= 100


def test_the_first_screen_cuts_no_sentence(capsys):
    said = " ".join(said_by("optimize --help", capsys).split())
    assert "of Wang et al. 2024, or hard" in " ".join(said_by("reproduce --help", capsys).split())
    assert "oiac (adapts the impedance online, default in the plane), constant (default of nah2023) or position" in said


def test_types_and_defaults_are_told_as_people_read_them():
    every = OptimizeOptions(direction=(1.0, 0.0), space="pose")
    said = " ".join(help_text(every, prog="x", description="", whole=True).split())
    for part in (
        "x y, in space x y z (default: 1.3 0, in space 0.405 of the model's reach ahead, 0.1 to the left, 0.17 up).",
        "For ur5e and panda the default is 1.2 0.3 0.5;",
        "--max-trials N Largest number of trials, each of which is one strike. [default: 600]",
        "--space joint|hand|pose Strikes as joint angles (joint), the hand's position (hand),",
        "--video, --no-video Render the strike as a video. [default: --video]",
        "--torque-limit X Largest absolute torque of every joint [N m].",
    ):
        assert part in said
    assert "None" not in said
    assert all(flag(f.name) in said for f in fields(OptimizeOptions))


def test_options_without_effect_are_left_out_and_named_with_what_they_need(capsys):
    planar = said_by("optimize --help-all", capsys)
    assert "\n  --turn-stiffness X" not in planar
    assert "--turn-stiffness, --turn-damping (only with --space pose)" in " ".join(planar.split())
    assert "\n  --turn-stiffness X" in said_by("optimize --space pose --controller constant --help-all", capsys)
    assert "\n  --alpha X" in said_by("train --help-all", capsys)
    assert "--alpha (only with --method sac)" in " ".join(said_by("train --method ppo --help-all", capsys).split())


OTHER = {bool: True, int: 7, float: 0.5, str: "other", Path: Path("other")}


@pytest.mark.parametrize("options", [OptimizeOptions, SimulateOptions, TrainOptions, AdaptOptions, IdentifyOptions])
def test_an_option_without_effect_is_refused_with_the_words_of_help(options):
    usual = options()
    for f in fields(options):
        if (broken := usual.broken_condition(f.name)) is not None:
            kind = next((x for x in OTHER if x.__name__ in str(f.type)), None)
            other = (not f.default) if isinstance(f.default, bool) else OTHER.get(kind, ("x",))
            with pytest.raises(InputError, match=re.escape(f"{flag(f.name)}: ")) as caught:
                replace(usual, **{f.name: other}).check()
            assert broken.words in str(caught.value)
