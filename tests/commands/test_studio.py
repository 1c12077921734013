"""The command that opens the studio: its address, its end, and what it refuses."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import urllib.request

import pytest
from command_line import called
from processes import HANG
from repository import ROOT

pytest.importorskip("viser")


def started(*words: str) -> subprocess.Popen:
    return subprocess.Popen(
        [sys.executable, "-m", "whiptool.studio", "--port", "0", *words],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_it_serves_until_it_is_stopped(number):
    with started() as studio:
        assert studio.stdout is not None
        line = studio.stdout.readline()
        address = line.split()[-1]
        assert line.startswith("the studio is at http://127.0.0.1:")
        with urllib.request.urlopen(address, timeout=HANG) as page:
            assert b"<html" in page.read()
        assert studio.stdout.readline() == "Ctrl-C ends it\n"
        studio.send_signal(number)
        out, err = studio.communicate(timeout=HANG)
    assert studio.returncode == (-signal.SIGHUP if number == signal.SIGHUP else 0)  # closed with its terminal
    assert out == ("" if number == signal.SIGHUP else "the studio is closed\n")
    assert err == ""


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--host", "203.0.113.7"), "host: got '203.0.113.7'"),
        (("--port", "70000"), "--port"),
        (("--model", "no-such-model"), "model"),
        (("--target", "1", "2", "3"), "target"),
        (("--model", "ur5e", "--target", "1", "2"), "target"),
        (("--controller", "constant", "--preset", "ur5e"), "K"),
    ],
)
def test_what_is_refused_is_refused_in_one_line(words, said, tmp_path):
    done = called("studio", *words, cwd=tmp_path)
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert said in done.stderr


def test_a_missing_package_is_named_with_its_installation(monkeypatch, tmp_path):
    from whiptool import extras

    monkeypatch.setattr(extras, "find_spec", lambda name: None if name == "viser" else True)
    done = called("studio", cwd=tmp_path)
    assert done.returncode == 2
    assert "pip install 'whiptool[studio]'" in done.stderr
