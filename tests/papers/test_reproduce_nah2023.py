"""The command that reproduces Nah et al. 2023: its quick form to the end, and resumed."""

from __future__ import annotations

import json
import re

import pytest
from command_line import called

from papers.nah2023 import solutions


@pytest.mark.slow
def test_quick_form_ends_and_resumes(tmp_path, monkeypatch):
    """Resumed, nothing is worked out again, and the report is the same; a unit that is lost is worked out again.

    Of every descent the first step: `test_solutions.py` follows them down.
    """
    monkeypatch.setattr(solutions, "_STEPS", 1)

    def run(*more: str) -> dict:
        done = called("reproduce", *more, "--json", cwd=tmp_path)
        assert done.returncode == 0, done.stderr
        return json.loads(done.stdout)

    result = run("nah2023", "--quick", "--workers", "1", "--out", "run")
    page = (tmp_path / "run" / "report.html").read_text()
    assert len(result["claims"]) == page.count("<b class=") == 6
    assert page.count("<img") == 5
    assert not re.search(r"""(src|href)=["'](?!data:|#)""", page)
    for said in ("Evaluations until a target is hit", "How near the tip comes", "CMA-ES", "most sensitive to"):
        assert said in page
    units = sorted((tmp_path / "run" / "units").iterdir())
    lost = next(x for x in units if x.name.startswith("direct-target2-"))
    kept = {x.name: x.stat().st_mtime_ns for x in units}
    lost.unlink()
    again = run("--resume", "run")
    assert again["claims"] == result["claims"]
    for unit in units:
        assert (unit.stat().st_mtime_ns == kept[unit.name]) == (unit != lost)
