"""The command that reports on aimed strikes: its quick form to the end, and resumed."""

from __future__ import annotations

import json
import re

import pytest
from command_line import called

pytest.importorskip("torch")


@pytest.mark.slow
def test_quick_form_ends_and_resumes(tmp_path):
    """Resumed, nothing is worked out again, and the tables are the same; a unit that is lost is worked out again."""

    def run(*more: str) -> str:
        done = called("reproduce", *more, "--json", cwd=tmp_path)
        assert done.returncode == 0, done.stderr
        assert json.loads(done.stdout)["what"] == "aim"
        return (tmp_path / "run" / "report.html").read_text()

    page = run("aim", "--quick", "--out", "run", "--workers", "1")
    assert page.count("<img") == 1
    assert not re.search(r"""(src|href)=["'](?!data:|#)""", page)
    for said in ("73.5 %", "92.1 %", "never reached by any search", "The planar hard task", "mean trials"):
        assert said in page
    units = sorted((tmp_path / "run" / "units").iterdir())
    kept = {x.name: x.stat().st_mtime_ns for x in units}
    lost = next(x for x in units if x.name.startswith("goals-"))
    lost.unlink()
    assert run("--resume", "run") == page
    for unit in units:
        assert (unit.stat().st_mtime_ns == kept[unit.name]) == (unit != lost)
