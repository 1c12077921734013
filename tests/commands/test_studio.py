"""The command that opens the studio: its address, its end, and what it refuses."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import urllib.request
from types import SimpleNamespace

import pytest
from command_line import called
from processes import HANG
from repository import ROOT

import whiptool as wt
from whiptool.commands import cli
from whiptool.commands.following import say_address
from whiptool.commands.studio import StudioOptions, saved_settings
from whiptool.live_page.export import settings_toml
from whiptool.live_page.session import Session

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


@pytest.mark.parametrize(
    ("asked", "everywhere", "said"),
    [
        (8080, False, "it is at http://x/\nCtrl-C ends it\n"),
        (0, False, "it is at http://x/\nCtrl-C ends it\n"),
        (8079, False, "it is at http://x/\nport 8079 is in use\nCtrl-C ends it\n"),
        (
            8080,
            True,
            "it is at http://x/\non other machines write the name of this machine in place of localhost\n"
            "Ctrl-C ends it\n",
        ),
    ],
)
def test_the_address_comes_with_what_is_unusual_about_it(asked, everywhere, said, capsys):
    say_address("it is", SimpleNamespace(address="http://x/", port=8080, everywhere=everywhere), asked)
    assert capsys.readouterr().out == said


@pytest.mark.parametrize(
    ("words", "taken"),
    [
        ((), "model, controller, target, strike"),
        (("--target", "1.1", "0.2"), "model, controller"),
        (("--controller", "constant"), "model, target, strike"),
    ],
)
def test_a_saved_file_is_taken_whole_and_options_come_first(words, taken, tmp_path, capsys):
    session = Session(wt.preset("lemon2024"), target=wt.Target((0.9, 0.6)))
    session.turn_law("a", 0.02)
    path = tmp_path / "strike.toml"
    path.write_text(settings_toml(session.shown()))
    options = cli.parse(StudioOptions, prog="studio", description="", args=["--model", str(path), *words])
    found = saved_settings(options, options.build_model())
    assert capsys.readouterr().out == f"taken from {path}: {taken}\n"
    assert found is not None
    own = session.settings
    assert found.controller == (own.controller if "controller" in taken else options.build_controller())
    assert (found.target.position, found.strike) == (
        (own.target.position, own.strike) if "target" in taken else ((1.1, 0.2), ())
    )
