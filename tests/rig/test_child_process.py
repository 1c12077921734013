"""Processes of emulated hardware: their ends where a signal comes while they start."""

from __future__ import annotations

import socket
import subprocess
import sys
from types import SimpleNamespace

import pytest
from processes import HANG

from whiptool.rig import child_process
from whiptool.rig.child_process import Emulated


def test_emulated_hardware_that_no_one_waits_for_ends_in_silence():
    """Who started it has ended, as after Ctrl-C: there is no one to answer, and nothing to say."""
    ours, theirs = socket.socketpair()
    with theirs:
        words = [sys.executable, "-m", "whiptool.rig.emulator", "--control", str(theirs.fileno())]
        process = subprocess.Popen(words, pass_fds=[theirs.fileno()], stderr=subprocess.PIPE, start_new_session=True)
    ours.close()
    _, said = process.communicate(timeout=HANG)
    assert (process.returncode, said) == (0, b"")


def test_a_signal_while_emulated_hardware_starts_ends_its_process(monkeypatch):
    ended = []

    def interrupted():
        raise KeyboardInterrupt

    process = SimpleNamespace(kill=lambda: ended.append("killed"), wait=lambda: ended.append("waited for"))
    control = SimpleNamespace(send=lambda options: None, recv=interrupted, close=lambda: ended.append("closed"))
    monkeypatch.setattr(child_process, "start_child", lambda *words: (process, control))
    with pytest.raises(KeyboardInterrupt):
        Emulated("whiptool.rig.emulator", None)
    assert ended == ["closed", "killed", "waited for"]
