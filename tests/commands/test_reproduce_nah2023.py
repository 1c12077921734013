"""The command that reproduces Nah et al. 2023: its quick form to the end, and resumed."""

from __future__ import annotations

import json
import re
import subprocess
import sys

import pytest
from processes import HANG

pytestmark = pytest.mark.slow


def test_quick_form_ends_and_resumes(tmp_path):
    """Resumed, nothing is worked out again, and the report is the same; a unit that is lost is worked out again."""

    def run(*more: str) -> dict:
        words = [sys.executable, "-m", "whiptool.reproduce", *more, "--json"]
        done = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, timeout=HANG, check=False)
        assert done.returncode == 0, done.stderr
        return json.loads(done.stdout)

    result = run("nah2023", "--quick", "--out", "run")
    page = (tmp_path / "run" / "report.html").read_text()
    assert len(result["claims"]) == page.count("<b class=") == 6
    assert page.count("<img") == 5
    assert not re.search(r"""(src|href)=["'](?!data:|#)""", page)
    for said in ("Evaluations until a target is hit", "How near the tip comes", "CMA-ES", "most sensitive to"):
        assert said in page
    units = sorted((tmp_path / "run" / "units").iterdir())
    lost, kept = next(x for x in units if "directl-target3" in x.name), {x.name: x.stat().st_mtime_ns for x in units}
    lost.unlink()
    again = run("--resume", "run")
    assert again["claims"] == result["claims"]
    for unit in units:
        assert (unit.stat().st_mtime_ns == kept[unit.name]) == (unit != lost)
