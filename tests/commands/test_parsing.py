"""Command lines in other spellings mean the same."""

from __future__ import annotations

from pathlib import Path

import pytest

from whiptool.commands import cli, compare, identify, map, optimize, simulate, train
from whiptool.commands.parsing import usual_words
from whiptool.errors import InputError
from whiptool.models import preset


def parsed(options, words: str):
    return cli.parse(options, prog="whiptool test", description="", args=words.split())


@pytest.mark.parametrize("words", ["--target 1.25,0.2", "--target=1.25,0.2", "--target 1.25, 0.2", "--target 1.25 0.2"])
def test_coordinates_may_have_commas_between_them(words):
    assert parsed(optimize.OptimizeOptions, words).target == (1.25, 0.2)


def test_every_option_of_several_values_takes_commas():
    strike = parsed(simulate.SimulateOptions, "--strike -1.36,.47,1.73,1.41,.95").strike
    assert strike == (-1.36, 0.47, 1.73, 1.41, 0.95)
    assert parsed(optimize.OptimizeOptions, "--model ur5e --mount 0,0,1.5").mount == ("0", "0", "1.5")
    assert parsed(optimize.OptimizeOptions, "--pareto effort,miss").pareto == ("effort", "miss")
    assert parsed(compare.CompareOptions, "--methods directl,ga --zone-radius 0.2").methods == ("directl", "ga")
    assert parsed(map.BuildOptions, "--sector 1,2,-.5,.5,30 --model ur5e").sector == (1, 2, -0.5, 0.5, 30)


def test_the_run_folder_has_a_short_option():
    for words in ("-o a,b", "-o=a,b", "--out a,b"):
        assert parsed(optimize.OptimizeOptions, words).out == Path("a,b")


def test_paths_keep_their_commas():
    words = ["--drive", "joints", "--free", "k,b", "--cameras", "a,b.toml", "c,d.csv"]
    assert usual_words(words, identify.IdentifyOptions)[-3:] == ["--cameras", "a,b.toml", "c,d.csv"]
    assert usual_words(words, identify.IdentifyOptions)[2:5] == ["--free", "k", "b"]


@pytest.mark.parametrize(
    ("words", "meant"),
    [
        ("--model ur5", "ur5e"),
        ("--method cmeas", "cmaes"),
        ("--controller possition", "position"),
        ("--space joints", "joint"),
        ("--trget 1 0", "--target"),
        ("--limits xm340", "xm430"),
        ("--radius 0.1", "--hit-radius"),
        ("--no-videos", "--no-video"),
        ("--no-vidoe", "--no-video"),
        ("--whip 1", "--whip-length"),
    ],
)
def test_what_was_meant_is_asked(words, meant, capsys):
    assert optimize.main(words.split()) == 2
    assert capsys.readouterr().err.endswith(f"; did you mean {meant}?\n")


def test_a_part_of_a_longer_name_is_asked_for_and_no_other_word_is(capsys):
    assert train.main(["--zone", "0.1"]) == 2
    assert capsys.readouterr().err.endswith("did you mean --zone-radius?\n")
    assert optimize.main(["--zone", "0.1"]) == 2  # it has none; --cone is another thing
    assert capsys.readouterr().err.endswith("the options that --help lists\n")


def test_words_to_choose_from_may_be_in_capital_letters():
    options = parsed(optimize.OptimizeOptions, "--limits XM430 --controller=Position --pareto Effort,MISS --model UR5e")
    assert (options.limits, options.law_or_file, options.pareto) == ("xm430", "position", ("effort", "miss"))
    assert options.find_model() == preset("ur5e")
    assert parsed(compare.CompareOptions, "--observation Tip").observation == ("tip",)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (simulate.SimulateOptions, "--whip-length 1_0.5"),
        (simulate.SimulateOptions, "--strike -1.36,.47,1.7_3,1.41,.95"),
        (simulate.SimulateOptions, "--whip-length=1_0"),
        (optimize.OptimizeOptions, "--target 1.2 0_1"),
        (optimize.OptimizeOptions, "--max-trials 1_000"),
        (optimize.OptimizeOptions, "--target \u0661.\u0662 0.1"),  # digits of other scripts
        (optimize.OptimizeOptions, "--target=1.2,\uff11.\uff12"),
        (optimize.OptimizeOptions, "--max-trials \u0663"),
    ],
)
def test_numbers_have_one_notation(options, words):
    rule = "write numbers without underscores, and with the digits 0 to 9"
    with pytest.raises(InputError, match=rf"{words.split('=')[0].split()[0]}: got .*{rule}"):
        parsed(options, words)
    assert parsed(optimize.OptimizeOptions, "--out \u0663").out == Path("\u0663")
    assert parsed(optimize.OptimizeOptions, "--out 2024_05_06").out == Path("2024_05_06")
