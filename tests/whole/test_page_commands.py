"""Every command of README and documentation runs as it is typed, in a folder of its page, one after the other.

Those that take more than some ten seconds are marked `hours`: `make docs-commands` runs them, other tests only see them
start. What a page takes from its reader (recordings, robots, people's throws) is made by `page_files`.
"""

from __future__ import annotations

import io
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
from page_commands import NEEDS_HARDWARE, PAGES, Command, commands_of, name_of
from page_files import provide, provide_for
from processes import HANG

from whiptool.runs import RunFolder

TUTORIAL = "tutorial.md"  # its snippets and commands are run together, by `test_docs`
ALL = [command for page in PAGES if page.name != TUTORIAL for command in commands_of(page)]
HARDWARE = [command for command in ALL if any(word in command.line for word in NEEDS_HARDWARE)]
OURS = [command for command in ALL if command not in HARDWARE and not command.serves]
LONG = [command for command in OURS if command.long]
AWAITS = 3  # of `adapt --port robot`: a strike is to be recorded


def first_of_its_line(command: Command) -> bool:
    """Whether no page before has the same command."""
    return command == next(c for c in OURS if c.line == command.line)


def cases(commands: list[Command]) -> list:
    """Commands to run to their ends; what is long, or stands on a page before, is run by `make docs-commands` alone."""
    return [pytest.param(c, id=str(c), marks=marks_of(c)) for c in commands]


def marks_of(command: Command) -> list[pytest.MarkDecorator]:
    """Long ones draw their pictures, too, and so do those of the page on pictures."""
    drawn = [pytest.mark.figures] if command.long or command.page.stem == "pictures" else []
    return [pytest.mark.slow if first_of_its_line(command) and not command.long else pytest.mark.hours, *drawn]


@pytest.fixture(scope="module")
def folder_of(tmp_path_factory):
    """The folder of a page, made when it is first asked for, with what the page takes from its reader."""
    made: dict[str, Path] = {}

    def folder(command: Command) -> Path:
        name = name_of(command.page)
        if name not in made:
            made[name] = tmp_path_factory.mktemp(name.removesuffix(".md").replace("/", "-"))
            provide(command.page, made[name])
        return made[name]

    return folder


@pytest.mark.slow
@pytest.mark.parametrize("command", cases(OURS))
def test_a_command_runs_as_it_is_typed(command, folder_of):
    folder = folder_of(command)
    provide_for(command, folder)
    done = command.run(folder)
    allowed = (0, AWAITS) if "whiptool.adapt" in command.line else (0,)
    assert done.returncode in allowed, f"{command}\n{done.stderr[-2000:]}"


class Started(BaseException):
    """A command came to making its run folder: what it was given is checked."""


@pytest.mark.slow
@pytest.mark.parametrize("command", [pytest.param(c, id=str(c)) for c in LONG if first_of_its_line(c)])
def test_a_long_command_starts(command, folder_of, monkeypatch):
    def start(*_, **__):
        raise Started

    for name in ("create", "open"):
        monkeypatch.setattr(RunFolder, name, start)
    folder = folder_of(command)
    try:
        done = command.run(folder)
    except Started:
        return
    files = [word for word in command.words if not word.startswith("--") and not word.replace(".", "").isdigit()]
    missing = [word for word in files if word in done.stderr and not (folder / word).exists()]
    assert missing, f"{command}\n{done.stderr[-2000:]}"  # what the command before it would have left


def hardware_cases() -> list:
    """Commands that need it; a strike is rehearsed before a camera is asked for, and takes long."""
    marks = [pytest.mark.hours if re.search("rig strike|adapt", c.line) else pytest.mark.slow for c in HARDWARE]
    return [pytest.param(c, id=str(c), marks=mark) for c, mark in zip(HARDWARE, marks, strict=True)]


@pytest.mark.parametrize("command", hardware_cases())
def test_what_needs_hardware_is_refused_where_there_is_none(command, folder_of, monkeypatch):
    monkeypatch.setattr("sys.stdin", io.StringIO("yes\n"))  # the arm may move
    done = command.run(folder_of(command))
    assert done.returncode in (1, 2), f"{command}\n{done.stderr}"
    assert done.stderr.count("\n") == 1, done.stderr
    assert any(
        named in done.stderr
        for named in ("/dev/ttyUSB0", "192.168.0.10", "127.0.0.2", "172.16.0.2", "RealSense", "cluster", "'found'")
    ), done.stderr


@pytest.mark.slow
def test_what_serves_ends_when_it_is_stopped(tmp_path):
    """The emulator of servos, whose place is told when it is there; that of a UR and the studio have other tests."""
    for command in {c.line: c for c in ALL if "emulator" in c.line and "--link" in c.line}.values():
        words = [sys.executable, *shlex.split(command.line)[1:]]
        link = Path(words[words.index("--link") + 1])
        with subprocess.Popen(words, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as server:
            assert server.stdout is not None
            told, there = server.stdout.readline(), link.resolve()
            assert server.stdout.readline() == f"and on {link}\n"
            server.terminate()
            server.communicate(timeout=HANG)
        assert told.split()[-1] == str(there)
        assert not link.is_symlink()
