"""What to cite: the entries are whole, and everything that can be used is known."""

from __future__ import annotations

import json
import re

import pytest

import whiptool as wt
from whiptool.errors import InputError
from whiptool.impedance.laws import LAWS
from whiptool.models.presets import PRESETS
from whiptool.references import ALWAYS, CITATIONS, WORKS, _entries, citations, used_by
from whiptool.runs import RunFolder


def keys(bibtex: str) -> list[str]:
    return re.findall(r"^@\w+\{(\w+),$", bibtex, re.MULTILINE)


def test_everything_that_can_be_used_is_known():
    assert set(PRESETS) | set(LAWS) | set(wt.METHODS) <= set(WORKS)


def test_entries_are_whole_and_all_used():
    entries = _entries()
    assert list(entries) == keys("\n".join(entries.values()))
    assert {key for works in WORKS.values() for key in works} | set(ALWAYS) == set(entries)
    for key, entry in entries.items():
        assert entry.count("{") == entry.count("}"), key
        assert set(re.findall(r"^  (\w+) = ", entry, re.MULTILINE)) >= {"author", "title", "year"}, key


def test_each_name_brings_its_works_once():
    found = keys(citations("CMA-ES", "ga", "oiac", "nlopt:GN_CRS2_LM"))
    assert found == [*ALWAYS, "hansen2001", "blank2020", "xiong2021", "johnson2007"]
    assert keys(wt.citations()) == list(ALWAYS)
    with pytest.raises(InputError, match=r"'UR7'.*panda"):
        citations("UR7")


def test_a_run_says_what_it_used(tmp_path):
    config = {"command": "human", "model": {"name": "nah2023"}, "controller": {"law": "constant"}}
    config["options"] = {"methods": ["sac", "random"], "arm": "mine.urdf"}
    assert list(used_by(config, {"method": "directl"})) == ["human", "nah2023", "constant", "directl", "sac", "random"]
    with RunFolder.create(tmp_path / "run", config) as folder:
        folder.write_result({"hit": True})
    said = keys((folder.path / CITATIONS).read_text(encoding="utf-8"))
    assert said == [*ALWAYS, "krotov2022", "nah2023", "hogan1985", "haarnoja2018"]
    assert json.loads((folder.path / "result.json").read_text(encoding="utf-8")) == {"hit": True}
