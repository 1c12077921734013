"""Ctrl-C and SIGTERM of a command, once and more often: one line, status 130, no traceback."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys

import pytest
from processes import HANG

from whiptool.commands import cli, interruptions

SLOW_TO_END = """
import sys, time
from whiptool.commands import cli, interruptions

interruptions.TOGETHER = -1.0  # each signal is one of its own

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
        self.signals = interruptions.Interruptions(lambda: self.now)

        def end(status: int) -> None:
            raise Ended

        def write(stream: int, what: bytes) -> None:
            self.said += what

        monkeypatch.setattr(interruptions.os, "_exit", end)
        monkeypatch.setattr(interruptions.os, "write", write)

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
    monkeypatch.setattr(interruptions, "_state", [lambda: torque])
    hand.signals.note(signal.SIGINT)  # by whoever noted it while servos were on
    hand.sends(signal.SIGINT, at=0.4)
    with pytest.raises(Ended):
        hand.sends(signal.SIGINT, at=1.0)
    assert hand.said == b"whiptool: ended at once by a second signal; CUT THE POWER\n"


def test_what_a_command_has_to_tell_when_it_is_interrupted_is_told_once(capsys) -> None:
    def interrupted() -> int:
        interruptions.tell_when_interrupted(lambda: "torque is off")
        raise KeyboardInterrupt

    def noted() -> int:
        interruptions.tell_when_interrupted(lambda: "torque is off")
        error = KeyboardInterrupt()
        error.add_note("torque is off")
        raise error

    assert cli.run(interrupted) == cli.run(noted) == 130
    assert capsys.readouterr().err == 2 * "whiptool: interrupted; torque is off\n"


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
