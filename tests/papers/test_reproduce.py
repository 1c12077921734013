"""The command that reproduces the paper: its quick form, and what is refused."""

from __future__ import annotations

import json
import re
from typing import get_args

import pytest
from command_line import called, whiptool

from papers.parts import PARTS
from whiptool.commands import papers

SECTIONS = 10  # of all parts together, each with a picture


@pytest.mark.slow
def test_quick_form_of_everything(tmp_path):
    """Smaller still than by itself, and also resumed: nothing is worked out again, and the report is the same.

    Without processes of its own, each of which would import for seconds, part by part: `test_compare.py` has them.
    """
    smaller = ["--workers", "1", "--targets", "2", "--max-trials", "8", "--trials", "6"]
    smaller += ["--episodes", "3", "--random-episodes", "2", "--timestep", "0.001"]
    done = whiptool("reproduce", "all", "--quick", *smaller, "--out", "run", "--json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)
    page = (tmp_path / "run" / "report.html").read_text()
    assert len(result["claims"]) == page.count("<b class=") >= 13
    assert page.count("<h2>") >= SECTIONS
    assert page.count("<img") >= SECTIONS
    assert {claim["verdict"] for claim in result["claims"]} == {"no verdict"}  # of a quick form
    assert not re.search(r"""(src|href)=["'](?!data:|#)""", page)
    assert not re.search(r"\binf\b|\bnan\b|\b1 (strikes|targets|trials|seeds|episodes)\b|e-\d\d\b", _text_of(page))
    shown = ("Fig. 5", "Fig. 6", "Fig. 7", "Table 4", "22.36 %", "training trials", "random", "hard task")
    for said in (*shown, "One and the same strike", "a disc of radius 0.3 m", "wherever the tip can pass"):
        assert said in page
    again = called("reproduce", "--resume", "run", "--json", cwd=tmp_path)
    assert again.returncode == 0, again.stderr
    assert json.loads(again.stdout)["claims"] == result["claims"]
    assert (tmp_path / "run" / "report.html").read_text() == page


def _text_of(page: str) -> str:
    """What a reader sees of a page: without its style, and without the addresses of pictures."""
    return re.sub(r"<[^>]*>", " ", re.sub(r"<style>.*?</style>|src=\"[^\"]*\"", "", page, flags=re.DOTALL))


def test_unknown_zone_gets_one_line(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert papers.reproduce(["fig6", "--further-zones", "0.3", "slow"]) == 2
    assert capsys.readouterr().err.startswith("whiptool: --further-zones: got 'slow'; allowed: radii > 0 in m, or fast")


def test_unknown_part_gets_one_line(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert papers.reproduce(["fig99"]) == 2
    error = capsys.readouterr().err
    assert error.startswith("whiptool: what: got 'fig99'")
    assert all(name in error for name in PARTS)
    assert error.count("\n") == 1
    assert not list(tmp_path.iterdir())


def test_choices_are_what_the_papers_know():
    from papers.parts import PARTS
    from papers.reproduce import Part, Row
    from papers.unknown.study import WAYS

    assert sorted(get_args(Part)) == sorted([*PARTS, "all"])
    assert sorted(get_args(Row)) == sorted(WAYS)
