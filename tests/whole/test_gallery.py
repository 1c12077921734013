"""The scripts of the gallery: each runs, draws one picture, is short, and uses the public names of whiptool alone."""

from __future__ import annotations

import ast
import runpy
from pathlib import Path

import matplotlib.pyplot as plt
import pytest
from page_commands import INSTALL
from repository import ROOT

import whiptool as wt
from whiptool.extras import EXTRAS

SCRIPTS = sorted((ROOT / "examples").glob("*.py"))
MOST_LINES = 60
TAKES_LONG = ("learn", "directions", "reach", "identify", "methods", "unknown_whip")


def test_there_is_a_gallery():
    assert len(SCRIPTS) >= 10


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda script: script.stem)
def test_a_script_is_short_and_uses_public_names(script: Path):
    text = script.read_text(encoding="utf-8")
    assert text.count("\n") < MOST_LINES
    tree = ast.parse(text)
    imported = [node for node in ast.walk(tree) if isinstance(node, ast.Import | ast.ImportFrom)]
    assert all(isinstance(node, ast.Import) for node in imported)
    assert {alias.name for node in imported for alias in node.names} <= {"whiptool", "numpy", "matplotlib.pyplot"}
    used = {
        node.attr
        for node in ast.walk(tree)
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "wt"
    }
    assert used <= set(wt.__all__)
    assert "*Needs:*" in (ast.get_docstring(tree) or "")


@pytest.mark.parametrize(
    "script",
    [pytest.param(s, id=s.stem, marks=[pytest.mark.slow] if s.stem in TAKES_LONG else []) for s in SCRIPTS],
)
def test_a_script_draws_one_picture(script: Path, monkeypatch, tmp_path):
    for found in INSTALL.findall(script.read_text(encoding="utf-8")):
        for module in EXTRAS[found]:
            pytest.importorskip(module)
    monkeypatch.chdir(tmp_path)
    plt.close("all")
    runpy.run_path(str(script))
    assert len(plt.get_fignums()) == 1
    axes = plt.figure(plt.get_fignums()[0]).axes
    assert any(ax.has_data() for ax in axes)
    assert any(ax.get_xlabel() and ax.get_ylabel() for ax in axes)
    plt.close("all")
    assert not list(tmp_path.iterdir())
