"""Ctrl-C and SIGTERM of a command, once and more often: one line, status 130, no traceback."""

from __future__ import annotations

import signal
import subprocess
import sys

import pytest
from processes import HANG

from whiptool.commands import cli

SLOW_TO_END = """
import sys, time
from whiptool.commands import cli

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


def test_handlers_are_as_before_when_a_command_has_ended() -> None:
    before = signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)
    assert cli.run(lambda: 0) == 0
    assert (signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)) == before


def test_after_an_interruption_further_signals_are_ignored_to_the_end() -> None:
    def interrupted() -> int:
        raise KeyboardInterrupt

    assert cli.run(interrupted) == 130
    assert signal.getsignal(signal.SIGINT) == signal.SIG_IGN


def test_notes_of_an_error_are_told(capsys) -> None:
    def fails() -> int:
        error = cli.WhiptoolError("it failed")
        error.add_note("torque is off")
        raise error

    assert cli.run(fails) == 1
    assert capsys.readouterr().err == "whiptool: it failed; torque is off\n"
