"""The emulator's link replaces nothing that is not its own."""

from __future__ import annotations

from pathlib import Path

import pytest

from whiptool.commands import emulators
from whiptool.rig.emulator.serving import _link


@pytest.mark.parametrize("there", ["file", "folder", "link to a file", "no folder"])
def test_a_link_replaces_nothing_that_is_not_its_own(tmp_path, there, capsys):
    """Its own links lead to a pseudo-terminal; what else has the name stays, and the command says so."""
    link, thesis = tmp_path / "tty", tmp_path / "thesis.tex"
    thesis.write_text("years of work")
    if there == "file":
        link = thesis
    elif there == "folder":
        link.mkdir()
    elif there == "link to a file":
        link.symlink_to(thesis)
    else:
        link = tmp_path / "none" / "tty"
    assert emulators.servos(["--link", str(link)]) == 2
    error = capsys.readouterr().err.strip()
    assert error.startswith("whiptool: --link: got")
    assert "\n" not in error
    assert thesis.read_text() == "years of work"
    assert link.is_symlink() == (there == "link to a file")


def test_a_link_that_a_killed_emulator_left_is_replaced(tmp_path):
    link = tmp_path / "tty"
    link.symlink_to("/dev/pts/987654")
    _link(link, "/dev/pts/3")
    assert link.readlink() == Path("/dev/pts/3")
