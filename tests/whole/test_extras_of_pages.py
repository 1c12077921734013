"""What is not installed is asked for before any work, and each page names its extras before its first command.

On the core installation, whose extras' modules are kept from being imported here, every module can be imported and
every command of the overview in `docs/commands.md` starts, except those that need an extra.
"""

from __future__ import annotations

import json
import re
import subprocess
import sys

import pytest
from page_commands import INSTALL, OURS, PAGES, Command, commands_of, lines_of, name_of, needs_of, parts_of
from page_files import provide
from processes import HANG
from repository import ROOT

from whiptool.commands import cli
from whiptool.extras import EXTRAS, extras_with

OVERVIEW = ROOT / "docs/commands.md"
FILMS = (".mkv", ".mp4")


class Asked(BaseException):
    """A command says what it needs."""


def extras_of(command: Command, folder) -> set[str]:
    """The extras that a command asks for, which it does before anything else."""

    for word in command.words:
        if word.endswith(FILMS):  # is known by its name
            (folder / word.replace("*", "1")).write_bytes(b"a film")

    def asked(purpose, modules):
        raise Asked(*modules)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(cli, "require", asked)
        try:
            command.run(folder)
        except Asked as wanted:
            return set(extras_with(wanted.args))
    return set()  # it has no options yet: the run that it goes on with is not there


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_a_page_begins_with_what_its_commands_need(page, tmp_path):
    """README names no extras, and the overview of commands has a table of them; an index is
    about its pages, and the page on installation about all extras."""
    provide(page, tmp_path)
    commands = [c for c in commands_of(page) if "doctor" not in c.line and "emulator" not in c.line]
    needed = set().union(*(extras_of(command, tmp_path) for command in commands))
    if commands and page.name not in ("README.md", "index.md", "install.md", OVERVIEW.name):
        assert needed <= needs_of(page)


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_a_page_names_extras_before_the_commands_that_take_them(page, tmp_path):
    provide(page, tmp_path)
    named: set[str] = set()
    for language, text in parts_of(page):
        if language not in ("sh", "span"):
            continue
        for extras in INSTALL.findall(text):
            named |= set(EXTRAS) if extras == "all" else set(extras.split(","))
        for line in lines_of(text):
            if line.startswith(OURS) and "NAME" not in line and "doctor" not in line and "emulator" not in line:
                assert extras_of(Command(page, line), tmp_path) <= named, f"{page.name}: {line}"


def overview() -> list[tuple[Command, set[str]]]:
    """The commands of the overview, and the extras that it names for each."""
    text = OVERVIEW.read_text(encoding="utf-8")
    rows = re.findall(r"^\| `(python -m whiptool[^`]*)` \|([^|]*)\| ", text, re.MULTILINE)
    return [(Command(OVERVIEW, line), set(re.findall(r"`(\w+)`", extras))) for line, extras in rows]


def test_the_table_of_commands_names_the_extras_of_each(tmp_path):
    provide(OVERVIEW, tmp_path)
    assert len(overview()) >= 12
    for command, extras in overview():
        assert extras_of(command, tmp_path) == extras, command


CORE = ROOT / "tests/helpers/core_installation.py"


def test_on_the_core_installation(tmp_path):
    provide(OVERVIEW, tmp_path)
    (tmp_path / "strike2.mkv").write_bytes(b"a film")
    (tmp_path / "strike1.csv").write_text("t,tip_x,tip_y\n0,0,-1\n0.01,0,-1\n0.02,0,-1\n")
    commands = [command for command, _ in overview()]
    words = [[name.removeprefix("whiptool."), *rest] for name, *rest in (c.words for c in commands)]
    blocked = [module for modules in EXTRAS.values() for module in modules]
    done = subprocess.run(
        [sys.executable, str(CORE), json.dumps(blocked), json.dumps(words)],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=HANG,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    failed, statuses = json.loads(done.stdout.splitlines()[-1])
    learners = {name for name in failed if name.startswith("whiptool.rl.")}
    assert set(failed) - learners == {"whiptool.rollout.cosserat_parts"}
    refused = [c for c, status in zip(commands, statuses, strict=True) if status not in ("started", 0)]
    assert len(refused) == len(INSTALL.findall(done.stderr)) == done.stderr.count("\n"), done.stderr
    assert refused == [c for c in commands if extras_of(c, tmp_path)]
