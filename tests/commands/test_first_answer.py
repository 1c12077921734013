"""The result is told before anything is drawn, and what a command does not use is not imported."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest
from command_line import called
from processes import HANG

from whiptool.commands.pictures import StrikeRun
from whiptool.progress import Progress

RANDOM = ("--method", "random", "--seed", 1, "--preset", "printed", "--timestep", 0.002)
STRIKE = ("--strike", -1.2, 0.9, 1.2, 0.3, 0.4, "--preset", "printed", "--timestep", 0.002)


@pytest.fixture
def no_pictures(monkeypatch):
    def write_page(self, folder):
        raise OSError("no room for pictures")

    monkeypatch.setattr(StrikeRun, "write_page", write_page)


@pytest.mark.parametrize("command", [("optimize", *RANDOM), ("simulate", *STRIKE)])
@pytest.mark.parametrize("as_json", [False, True])
def test_a_result_is_told_before_it_is_drawn(command, as_json, no_pictures, tmp_path):
    done = called(*command, "--no-video", "--out", "run", *(["--json"] if as_json else []), cwd=tmp_path)
    assert done.returncode == 1
    assert "no room for pictures" in done.stderr
    if as_json:
        assert json.loads(done.stdout) == json.loads((tmp_path / "run" / "result.json").read_text())
    else:
        assert "closest" in done.stdout
        assert "run folder" not in done.stdout
        assert (tmp_path / "run" / "trajectory.npz").is_file()


@pytest.mark.parametrize("quiet", [False, True])
def test_progress_is_told_unless_a_command_is_to_be_quiet(quiet, tmp_path):
    warned = ("--timestep", 0.004, "--preset", "table4", "--t-stay", 0.05, "--max-trials", 30, "--no-stop-at-hit")
    words = ("--method", "random", "--seed", 1, *warned, "--no-video", *(["--quiet"] if quiet else []))
    done = called("optimize", *words, cwd=tmp_path)
    assert "closest" in done.stdout
    assert ("drawing ..." in done.stderr) == (not quiet)
    assert ("trials/s" in done.stderr) == (not quiet)
    assert "whiptool: " in done.stderr  # a warning is told all the same
    assert not Progress.quiet


USED = """
import sys
from whiptool.commands import optimize, pictures
pictures.nullcontext = lambda: print(*sys.modules, file=sys.stderr) or sys.exit(0)
optimize.main(sys.argv[1:])
"""


def test_what_an_answer_does_not_need_is_not_imported_before_it(tmp_path):
    words = [sys.executable, "-c", USED, *map(str, RANDOM), "--no-video"]
    done = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, timeout=HANG, check=True)
    used = set(done.stderr.split())
    assert "whiptool.rollout.compiled" in used
    heavy = {"torch", "matplotlib.figure", "mujoco", "pinocchio", "scipy.special", "scipy.optimize", "pymoo"}
    assert not used & heavy
