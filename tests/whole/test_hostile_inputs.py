"""Thousands of hostile inputs of files, run folders, options and Python: no traceback, nothing that hangs, no 2 GB.

`python -m pytest -m slow tests/whole/test_hostile_inputs.py` tries all of them. They are tried in forked processes, so
that one that hangs, crashes or takes all memory is named. An answer is right if the input is accepted, or refused in
one line; commands are stopped where they begin to compute.
"""

from __future__ import annotations

import os
import signal
import time

import forked
import hostile_inputs
import pytest
from forked import Input, faults

from tests.whole.test_wrong_types import CALLS

SEED = 0
MOST = {"model": 1100, "recording": 330, "stored": 420, "run folder": 300, "option": 350, "python": 1200}
SOME = {"model": 60, "stored": 12, "python": 120}


def tried(counts: dict[str, int], monkeypatch: pytest.MonkeyPatch) -> str:
    for module, name in hostile_inputs.computing():
        monkeypatch.setattr(module, name, hostile_inputs.accept)
    return "\n\n".join(faults(hostile_inputs.inputs(counts, SEED, CALLS)))


@pytest.mark.parametrize("kind", SOME)
def test_some_hostile_inputs_are_accepted_or_refused_in_one_line(kind, monkeypatch):
    assert tried({kind: SOME[kind]}, monkeypatch) == ""


@pytest.mark.slow
@pytest.mark.parametrize("kind", MOST)
def test_hostile_inputs_are_accepted_or_refused_in_one_line(kind, monkeypatch):
    assert tried({kind: MOST[kind]}, monkeypatch) == ""


def test_there_are_thousands_of_inputs_the_same_each_time():
    labels = [one.label for one in hostile_inputs.inputs(MOST, SEED, CALLS)]
    assert len(labels) == len(set(labels)) == sum(MOST.values()) >= 3000
    assert labels == [one.label for one in hostile_inputs.inputs(MOST, SEED, CALLS)]


def _ends(_) -> str:
    raise SystemExit


def test_what_hangs_crashes_or_takes_memory_is_seen_and_the_rest_is_tried(monkeypatch):
    """Each in a process of its own, or the next one would not be tried."""
    monkeypatch.setattr(forked, "MOST", 1 << 30)

    def seen(*answers) -> list[str]:
        return [line[:30] for line in faults([Input(f"{i}", x) for i, x in enumerate(answers)])]

    def takes_memory(_) -> str:
        return str(len(b"x" * forked.MOST))

    assert seen(takes_memory, lambda _: "", _ends, lambda _: "a traceback", lambda _: "") == [
        "0: stopped: it took more than ",
        "2: SystemExit of the test itse",
        "3: a traceback",
    ]
    assert seen(lambda _: os.kill(os.getpid(), signal.SIGKILL)) == ["0: its process ended without a"]
    waits = Input("waits", lambda _: time.sleep(forked.SILENT) or "")
    assert faults([waits], silent=0.1) == ["waits: stopped: it did not end"]


@pytest.mark.parametrize(
    ("error", "right"),
    [(ValueError("x"), False), (KeyError("x"), False), (MemoryError(), False), (hostile_inputs.Accepted(), True)],
)
def test_errors_that_are_no_refusals_are_faults(error, right):
    def fail():
        raise error

    assert (hostile_inputs.called(fail) == "") == right
