"""The command lines as users meet them: mistakes, help, the examples of README and docs/python.md."""

from __future__ import annotations

import io
import os
import re
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest
from command_line import assert_one_line, whiptool
from one_joint import one_joint_task
from processes import HANG
from repository import ROOT

from whiptool.commands import cli, optimize
from whiptool.commands.compare import CompareOptions
from whiptool.commands.train import TrainOptions
from whiptool.errors import InputError


@pytest.mark.slow
def test_mistakes_end_with_status_2(tmp_path):
    assert_one_line(whiptool("optimize", "--target", "nan", "0", cwd=tmp_path), "target")
    assert_one_line(whiptool("simulate", cwd=tmp_path), "--strike")
    assert_one_line(whiptool("simulate", "--strike", "1", "2", cwd=tmp_path), "--strike", "q_i")
    assert_one_line(whiptool("simulate", "--export", "/proc/nowhere/x.xml", cwd=tmp_path), "--export")


@pytest.mark.slow
def test_the_installed_command(tmp_path):
    whole = [sys.executable, "-c", "import sys; from whiptool.commands.cli import main; sys.exit(main())"]
    for words, status, said in (
        (["--help"], 0, "optimize"),
        (["--version"], 0, "whiptool 0."),
        (["fly"], 2, "optimize"),
    ):
        done = subprocess.run([*whole, *words], capture_output=True, text=True, check=False, cwd=tmp_path)
        assert done.returncode == status
        assert said in done.stdout + done.stderr
    done = subprocess.run([*whole, "optimize", "--help-all"], capture_output=True, text=True, check=False, cwd=tmp_path)
    assert done.returncode == 0
    assert "--stop-at-hit" in done.stdout


@pytest.mark.slow
def test_the_examples_of_readme_and_python_run(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    names: dict = {}
    for page in ("README.md", "docs/python.md"):
        text = (ROOT / page).read_text(encoding="utf-8")
        for example in re.findall(r"```python\n(.*?)```", text, re.DOTALL):  # as in one interpreter
            exec(example, names)
    assert names["result"].outcome.hit
    assert names["path"].approach((1.2, 0.1)).distance[0] == pytest.approx(
        names["result"].outcome.miss_distance, abs=1e-4
    )
    assert (tmp_path / "strike.png").stat().st_size > 10_000
    assert names["steps"][-1].hit


@pytest.mark.parametrize("name", ["t_stay", "t stay"])
def test_errors_of_the_library_name_options_in_commands(name):
    options = optimize.OptimizeOptions()
    with pytest.raises(InputError, match=r"^--t-stay: got 1; allowed: less; wait$"), cli.options_named(options):
        raise InputError(name, 1, "less", "wait")
    for other in ("whip.k", "t_stayed", "strike"):
        with pytest.raises(InputError, match=f"^{other}: got 1"), cli.options_named(options):
            raise InputError(other, 1, "less")


def test_what_is_positional_keeps_its_name():
    from whiptool.commands.options.identify_options import IdentifyOptions

    with pytest.raises(InputError, match=r"^recordings: "), cli.options_named(IdentifyOptions()):
        raise InputError("recordings", "none", "one")


@pytest.mark.parametrize(
    ("words", "option", "meaning"),
    [
        (["rig", "strike"], "--strike", "Joint angles at start and end [rad], and duration [s]. They are q_si q_ei"),
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


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("--pareto effort", "--pareto: got 'effort'; allowed: two of miss, effort, peak-torque, speed, robustness"),
        ("--target 1.2,a", "--target: got '1.2 a'; allowed: numbers with a space or comma between them"),
        ("--lower=1;2", "--lower: got '1;2'; allowed: numbers with a space or comma between them"),
        (
            "--minimise efort",
            "--minimise: got 'efort'; allowed: miss, effort, peak-torque, speed, robustness; did you mean effort?",
        ),
        ("-metod cmaes", "-metod: got '-metod cmaes'; allowed: the options that --help lists; did you mean --method?"),
        ("--max-trials 1.5", "--max-trials: got '1.5'; allowed: a whole number"),
        ("--max-time a", "--max-time: got 'a'; allowed: a number"),
        (
            "--metod cmaes",
            "--metod: got '--metod cmaes'; allowed: the options that --help lists; did you mean --method?",
        ),
        ("--zzzz", "--zzzz: got '--zzzz'; allowed: the options that --help lists"),
    ],
)
def test_what_does_not_parse_is_told_in_words(words, said, capsys):
    assert import_module("whiptool.commands.optimize").main(words.split()) == 2
    assert capsys.readouterr().err == f"whiptool: {said}\n"


def test_runs_that_call_an_observation_as_it_was_called_are_read():
    """What the learners' tip alone was once called in options and in shipped results."""
    table = {"observation": "paper", "method": "td3"}
    assert cli.stored_options(TrainOptions, table, Path("run")).observation == "tip"
    stored = cli.stored_options(CompareOptions, {"observation": ["goal", "paper"]}, Path("run"))
    assert stored.observation == ("goal", "tip")
    with pytest.raises(InputError, match="tip, relative, goal; it is called tip"):
        one_joint_task(observation="paper")


@pytest.mark.parametrize(("variable", "said"), [("MPLBACKEND", "MPLBACKEND:"), ("MATPLOTLIBRC", "matplotlibrc:")])
def test_settings_that_matplotlib_does_not_take_are_told_before_work(variable: str, said: str, tmp_path: Path) -> None:
    (tmp_path / "broken").write_bytes(b"\xff\xfe")
    program = "import sys; from whiptool.commands.cli import main; sys.exit(main())"
    done = subprocess.run(
        [sys.executable, "-c", program, "simulate", "--strike", "0", "0", "0", "0", "1"],
        cwd=tmp_path, env={**os.environ, variable: "broken"}, capture_output=True, text=True, check=False, timeout=HANG,
    )  # fmt: skip
    assert done.returncode == 2
    assert said in done.stderr.splitlines()[-1]
    assert "Traceback" not in done.stderr
    assert not (tmp_path / "runs").exists()


def test_letters_that_the_terminal_lacks_are_escaped(monkeypatch) -> None:
    written = io.BytesIO()
    monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(written, encoding="ascii", write_through=True))
    assert cli.run(lambda: print("päitsche") or 0) == 0
    assert written.getvalue() == b"p\\xe4itsche\n"
