"""The command lines as users meet them: mistakes, help, the examples of README and docs/python.md."""

from __future__ import annotations

import contextlib
import io
import os
import re
import signal
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest
from command_line import assert_one_line, whiptool
from one_joint import one_joint_task
from processes import HANG
from repository import ROOT

from whiptool.commands import cli, optimize, run_folders
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
        (
            ["rig", "strike"],
            "--strike",
            "All joint angles at the start, then all at the end [rad], and the duration [s]:",
        ),
        (["view"], "RUN", "Run folder"),
        (["simulate"], "--strike", "joint angles at start and end [rad], duration [s]"),
        (["optimize", "--method"], "--method", "a value"),
        (["compare", "--methods"], "--methods", "one value or more"),
    ],
)
def test_what_is_missing_is_named_with_its_meaning(words, option, meaning, capsys):
    command, *rest = words
    assert cli.main_of(command)(rest) == 2
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
    assert run_folders.stored_options(TrainOptions, table, Path("run")).observation == "tip"
    stored = run_folders.stored_options(CompareOptions, {"observation": ["goal", "paper"]}, Path("run"))
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


SLOW_TO_END = """
import sys, time
from whiptool.commands import cli

cli.TOGETHER = -1.0  # each signal is one of its own

def command():
    try:
        print("ready", flush=True)
        time.sleep({hang})
    finally:
        print("saving", flush=True)
        time.sleep({saving})
    return 0

sys.exit(cli.run(command))
"""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("times", [1, 2, 3])
def test_a_command_ends_without_a_traceback_however_often_it_is_told(number, times) -> None:
    code = SLOW_TO_END.format(hang=HANG, saving=0.0 if times == 1 else HANG)
    usual = lambda: signal.signal(signal.SIGINT, signal.SIG_DFL)  # noqa: E731  # background jobs inherit it as ignored
    process = subprocess.Popen(
        [sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, preexec_fn=usual
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "ready\n"
    process.send_signal(number)
    assert process.stdout.readline() == "saving\n"
    for _ in range(times - 1):
        process.send_signal(number)
    _, said = process.communicate(timeout=HANG)
    assert process.returncode == 130
    assert "Traceback" not in said
    assert said == ("whiptool: interrupted\n" if times == 1 else "whiptool: ended at once by a second signal\n")


def test_a_stop_that_a_library_drops_is_one_all_the_same(capsys) -> None:
    """As CasADi does when it converts arguments: what it gives back is of another type, and something else fails."""

    def command() -> int:
        with contextlib.suppress(KeyboardInterrupt):
            os.kill(os.getpid(), signal.SIGTERM)
        raise AttributeError("'SX' object has no attribute 'full'")

    assert cli.run(command) == 130
    assert capsys.readouterr().err == "whiptool: interrupted\n"


def test_a_fault_without_a_stop_is_a_traceback() -> None:
    def command() -> int:
        raise AttributeError

    with pytest.raises(AttributeError):
        cli.run(command)


class Ended(BaseException):
    """In the place of the end of the process."""


class Hand:
    """Signals at given times, by a clock that only it moves."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now, self.said = 0.0, b""
        self.signals = cli.Interruptions(lambda: self.now)

        def end(status: int) -> None:
            raise Ended

        def write(stream: int, what: bytes) -> None:
            self.said += what

        monkeypatch.setattr(cli.os, "_exit", end)
        monkeypatch.setattr(cli.os, "write", write)

    def sends(self, number: int, at: float) -> None:
        """Have a signal come."""
        self.now = at
        self.signals._on_signal(number, None)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_signals_of_one_kind_that_come_together_are_one(number: int, monkeypatch) -> None:
    """As coreutils' `timeout` sends them: to the process, and at once to its group, in which the process is."""
    hand = Hand(monkeypatch)
    with pytest.raises(KeyboardInterrupt):
        hand.sends(number, at=10.0)
    hand.sends(number, at=10.0)
    hand.sends(number, at=10.49)
    with pytest.raises(Ended):
        hand.sends(number, at=10.51)  # half a second after the first, not after the one before


def test_a_signal_of_another_kind_is_a_second_one(monkeypatch) -> None:
    hand = Hand(monkeypatch)
    with pytest.raises(KeyboardInterrupt):
        hand.sends(signal.SIGINT, at=10.0)
    with pytest.raises(Ended):
        hand.sends(signal.SIGTERM, at=10.1)


def test_a_second_signal_after_a_strike_that_was_interrupted_tells_what_became_of_torque(monkeypatch) -> None:
    hand, torque = Hand(monkeypatch), "CUT THE POWER"
    monkeypatch.setattr(cli, "_state", [lambda: torque])
    hand.signals.note(signal.SIGINT)  # by whoever noted it while servos were on
    hand.sends(signal.SIGINT, at=0.4)
    with pytest.raises(Ended):
        hand.sends(signal.SIGINT, at=1.0)
    assert hand.said == b"whiptool: ended at once by a second signal; CUT THE POWER\n"


def test_what_a_command_has_to_tell_when_it_is_interrupted_is_told_once(capsys) -> None:
    def interrupted() -> int:
        cli.tell_when_interrupted(lambda: "torque is off")
        raise KeyboardInterrupt

    def noted() -> int:
        cli.tell_when_interrupted(lambda: "torque is off")
        error = KeyboardInterrupt()
        error.add_note("torque is off")
        raise error

    assert cli.run(interrupted) == cli.run(noted) == 130
    assert capsys.readouterr().err == 2 * "whiptool: interrupted; torque is off\n"


def test_handlers_are_as_before_when_a_command_has_ended() -> None:
    before = signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)
    assert cli.run(lambda: 0) == 0
    assert (signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)) == before


STOPPED_IN_A_TEXT = """
import sys
from whiptool.commands import cli

def search():
    text = "import os, signal; os.kill(os.getpid(), signal.SIGTERM); os.kill(os.getpid(), 0)"
    try:
        exec(text)  # as dataclass, namedtuple and scipy.stats do while they are imported
    except KeyboardInterrupt:
        return cli.INTERRUPTED

sys.exit(cli.run(search))
"""


def test_a_signal_in_the_middle_of_an_import_ends_a_command_with_its_own_status(tmp_path: Path) -> None:
    (tmp_path / "stopped_in_a_text.py").write_text(STOPPED_IN_A_TEXT)
    command = [sys.executable, "-m", "stopped_in_a_text"]
    assert subprocess.run(command, cwd=tmp_path, check=False, timeout=HANG).returncode == 130


def test_after_an_interruption_further_signals_are_ignored_to_the_end() -> None:
    def interrupted() -> int:
        raise KeyboardInterrupt

    assert cli.run(interrupted) == 130
    assert signal.getsignal(signal.SIGINT) == signal.SIG_IGN


def test_further_signals_are_ignored_after_a_command_that_answered_one_itself() -> None:
    """A search that was interrupted keeps what it found, and returns the status; so does a server that ends."""
    assert cli.run(lambda: cli.INTERRUPTED) == 130
    assert signal.getsignal(signal.SIGINT) == signal.getsignal(signal.SIGTERM) == signal.SIG_IGN


def test_further_signals_are_ignored_after_a_server_that_a_signal_ended() -> None:
    def served() -> int:
        with contextlib.suppress(KeyboardInterrupt):
            os.kill(os.getpid(), signal.SIGTERM)
        return 0

    assert cli.run(served) == 0
    assert signal.getsignal(signal.SIGINT) == signal.SIG_IGN


def test_notes_of_an_error_are_told(capsys) -> None:
    def fails() -> int:
        error = cli.WhiptoolError("it failed")
        error.add_note("torque is off")
        raise error

    assert cli.run(fails) == 1
    assert capsys.readouterr().err == "whiptool: it failed; torque is off\n"


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("words", [["whiptool.optimize"], ["whiptool.rig", "strike"], ["whiptool", "train"]])
def test_a_signal_during_the_imports_of_a_command_ends_it_in_one_line(tmp_path, number, words):
    """Here while tyro is imported, before a command runs."""
    (tmp_path / "tyro.py").write_text(f"import os, time\nos.kill(os.getpid(), {int(number)})\ntime.sleep({HANG})\n")
    done = subprocess.run(
        [sys.executable, "-m", *words],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=HANG,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # background jobs inherit it as ignored
    )
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "whiptool: interrupted\n")
