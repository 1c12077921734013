"""Commands of the folder `papers`, in a checkout and in an installation that has only the package."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest
from repository import ROOT

from whiptool.commands import papers
from whiptool.commands.papers import human, of_papers, reproduce


@pytest.fixture
def unseen(monkeypatch) -> None:
    """The folder is not on the path of modules, and nothing of it has been imported."""
    monkeypatch.setattr(sys, "path", [x for x in sys.path if Path(x).resolve() != ROOT])
    for name in [x for x in sys.modules if x.partition(".")[0] == "papers"]:
        monkeypatch.delitem(sys.modules, name)


@pytest.mark.usefixtures("unseen")
def test_the_folder_is_found_beside_the_package():
    """And on the path that processes of workers are given."""
    assert of_papers("unknown").__file__ == str(ROOT / "papers" / "unknown" / "__init__.py")
    assert sys.path[0] == str(ROOT)


@pytest.mark.usefixtures("unseen")
@pytest.mark.parametrize(("command", "words"), [(reproduce, ["fig6"]), (human, ["data"]), (reproduce, ["--help"])])
def test_an_installation_without_the_folder_says_how_to_get_it(monkeypatch, capsys, tmp_path, command, words):
    monkeypatch.setattr(papers, "CHECKOUT", tmp_path)
    assert command(words) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.startswith("whiptool: papers: got an installation")
    assert said.err.endswith("pip install --editable .\n")
    assert said.err.count("\n") == 1


def test_a_module_that_the_folder_has_not_is_no_missing_folder():
    with pytest.raises(ModuleNotFoundError, match="fig99"):
        of_papers("lemon2024.fig99")
