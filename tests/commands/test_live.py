"""`--live`: the process that shows a run, and its end."""

from __future__ import annotations

import importlib.util
import os
import re
import signal
import socket
import subprocess
import sys
import time
import urllib.request
from pathlib import Path
from types import SimpleNamespace

import pytest
from processes import HANG

from whiptool import extras
from whiptool.commands import optimize
from whiptool.commands.options.live_options import LiveOptions

SEARCH = ["--target", "1.2", "0.1", "--method", "cmaes", "--no-stop-at-hit", "--no-video"]


def test_without_viser_one_line_says_how_it_is_installed(tmp_path: Path, monkeypatch, capsys) -> None:
    found = importlib.util.find_spec
    monkeypatch.setattr(extras, "find_spec", lambda name: None if name == "viser" else found(name))
    assert optimize.main([*SEARCH, "--live", "--out", str(tmp_path / "run")]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "pip install 'whiptool[studio]'" in said
    assert not (tmp_path / "run").exists()


def test_the_end_says_how_the_page_is_seen_again(tmp_path: Path, monkeypatch, capsys) -> None:
    done, begun = [], []
    connection = SimpleNamespace(close=lambda: done.append("closed"))
    monkeypatch.setattr(
        "whiptool.rig.child_process.start_child", lambda *words: begun.append(words) or ("process", connection)
    )
    monkeypatch.setattr("whiptool.rig.child_process.end_child", done.append)
    with LiveOptions(live=True).shown(tmp_path):
        (address,) = re.findall(r"watch the run at http://127\.0\.0\.1:(\d+)/", capsys.readouterr().err)
        assert begun == [("whiptool.following", str(tmp_path), address)]
    with socket.create_server(("127.0.0.1", int(address))), LiveOptions(live=True).shown(tmp_path):
        assert int(begun[-1][2]) > int(address)
    assert done == 2 * ["closed", "process"]
    assert f"python -m whiptool.studio {tmp_path} opens it again" in capsys.readouterr().err


def is_alive(pid: int) -> bool:
    """Whether a process runs; one that has ended and was not waited for does not."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


def shown_by(pid: int) -> int:
    """The process that shows the run of a process."""
    for path in Path("/proc").glob("[0-9]*"):
        try:
            words, parent = (path / "cmdline").read_bytes(), (path / "stat").read_text().rpartition(")")[2].split()[1]
        except (FileNotFoundError, ProcessLookupError):
            continue
        if int(parent) == pid and b"whiptool.following" in words:
            return int(path.name)
    raise AssertionError("no process shows the run")


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc").is_dir(), reason="looks for processes in /proc")
@pytest.mark.parametrize("ending", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
def test_the_page_ends_with_the_command_however_that_ends(ending: signal.Signals, tmp_path: Path) -> None:
    pytest.importorskip("viser", reason="the page needs pip install 'whiptool[studio]'")
    command = [sys.executable, "-m", "whiptool.optimize", *SEARCH, "--max-trials", "1000000", "--live"]
    command += ["--out", str(tmp_path / "run")]
    with subprocess.Popen(command, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True) as process:
        assert process.stderr is not None
        said = r"the page of the run answers at (http://127\.0\.0\.1:\d+/)"
        address = next(m[1] for line in process.stderr if (m := re.search(said, line)))
        page = shown_by(process.pid)
        with urllib.request.urlopen(address, timeout=HANG) as answer:
            assert answer.status == 200
        os.kill(process.pid, ending)
        process.stderr.read()  # its end is that of both processes
        assert process.wait(HANG) == (-9 if ending == signal.SIGKILL else 130)
    while is_alive(page):
        time.sleep(0.01)
