"""The command lines as users meet them: mistakes, help, the README's examples."""

from __future__ import annotations

import re
import subprocess
import sys

import pytest
from command_line import assert_one_line, whiptool
from repository import ROOT

pytestmark = pytest.mark.slow


def test_mistakes_end_with_status_2(tmp_path):
    assert_one_line(whiptool("optimize", "--target", "nan", "0", cwd=tmp_path), "target")
    assert_one_line(whiptool("simulate", cwd=tmp_path), "--strike")
    assert_one_line(whiptool("simulate", "--strike", "1", "2", cwd=tmp_path), "--strike", "q_i")
    assert_one_line(whiptool("simulate", "--export", "/proc/nowhere/x.xml", cwd=tmp_path), "--export")


def test_the_installed_command(tmp_path):
    whole = [sys.executable, "-c", "import sys; from whiptool.commands.cli import main; sys.exit(main())"]
    for words, status, said in (
        (["--help"], 0, "optimize"),
        (["--version"], 0, "whiptool 0."),
        (["fly"], 2, "optimize"),
    ):
        done = subprocess.run([*whole, *words], capture_output=True, text=True, check=False, cwd=tmp_path)
        assert done.returncode == status
        assert said in done.stdout + done.stderr
    done = subprocess.run([*whole, "optimize", "--help"], capture_output=True, text=True, check=False, cwd=tmp_path)
    assert done.returncode == 0
    assert "--stop-at-hit" in done.stdout


def test_the_readme_examples_run(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    readme = (ROOT / "README.md").read_text()
    (example,) = re.findall(r"```python\n(.*?)```", readme, re.DOTALL)
    names: dict = {}
    exec(example, names)
    assert names["result"].outcome.hit
    assert names["path"].approach((1.2, 0.1)).distance[0] == pytest.approx(
        names["result"].outcome.miss_distance, abs=1e-4
    )
    assert (tmp_path / "strike.png").stat().st_size > 10_000
