"""Every benchmark starts: what it imports is there, and it has the options that all have."""

from __future__ import annotations

import json
import re
import subprocess
import sys

import pytest
from processes import HANG
from repository import ROOT

FOLDER = ROOT / "benchmarks"
SCRIPTS = sorted(path.name for path in FOLDER.glob("*.py"))
# one process for all of them: each would import the same for seconds
ASK_EACH = """
import contextlib, io, json, runpy, sys, traceback

answers = {}
for script in sys.argv[1:]:
    sys.argv, said, failed = [script, "--help"], io.StringIO(), ""
    try:
        with contextlib.redirect_stdout(said):
            runpy.run_path(script, run_name="__main__")
    except SystemExit as end:
        failed = "" if end.code in (0, None) else f"it ended with {end.code}"
    except BaseException:
        failed = traceback.format_exc()
    answers[script] = said.getvalue(), failed
print(json.dumps(answers))
"""


@pytest.fixture(scope="module")
def answers() -> dict[str, tuple[str, str]]:
    """What each benchmark says when it is asked for help, and how it failed."""
    done = subprocess.run(
        [sys.executable, "-c", ASK_EACH, *(str(FOLDER / name) for name in SCRIPTS)],
        cwd=FOLDER,  # a script finds those beside it
        capture_output=True,
        text=True,
        timeout=HANG,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


@pytest.mark.slow
@pytest.mark.parametrize("script", SCRIPTS)
def test_a_benchmark_starts(answers, script):
    said, failed = answers[str(FOLDER / script)]
    assert not failed
    assert {"--json", "--quick"} <= set(re.findall(r"^ +(--[\w-]+)", said, re.MULTILINE))
