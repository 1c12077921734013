"""The command that reports on wave and crack: its quick form to the end, and resumed."""

from __future__ import annotations

import json
import re

import pytest
from command_line import called


@pytest.mark.slow
def test_quick_form_ends_and_resumes(tmp_path):
    """Resumed, the report is the same; a unit that is lost is worked out again."""

    def run(*more: str) -> dict:
        done = called("reproduce", *more, "--json", cwd=tmp_path)
        assert done.returncode == 0, done.stderr
        return json.loads(done.stdout)

    result = run("crack", "--quick", "--workers", "1", "--out", "run")
    page = (tmp_path / "run" / "report.html").read_text()
    assert len(result["claims"]) == page.count("<b class=") == 4
    assert page.count("<img") == 4
    assert not re.search(r"""(src|href)=["'](?!data:|#)""", page)
    for said in ("A folded chain falls faster", "How far to trust it", "744", "speed to crack at"):
        assert said in page
    assert (tmp_path / "run" / "crack.mp4").stat().st_size > 10_000
    lost = next(x for x in (tmp_path / "run" / "units").iterdir() if x.name.startswith("folded-nodes8-"))
    lost.unlink()
    assert run("--resume", "run")["claims"] == result["claims"]
    assert lost.exists()
    assert (tmp_path / "run" / "report.html").read_text() == page
