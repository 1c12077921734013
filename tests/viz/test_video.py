"""Videos on machines without OpenGL."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest
from processes import HANG


@pytest.mark.slow
@pytest.mark.parametrize("gl", ["disabled", "nonsense"])
def test_without_opengl_matplotlib_draws_the_video(tmp_path, gl):
    command = [
        sys.executable,
        "-m",
        "whiptool.simulate",
        "--strike",
        "-1.2",
        "0.9",
        "1.2",
        "0.3",
        "0.4",
        "--t-stay",
        "0",
    ]
    done = subprocess.run(
        [*command, "--out", "run"],
        cwd=tmp_path,
        env={**os.environ, "MUJOCO_GL": gl},
        capture_output=True,
        text=True,
        timeout=HANG,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "run" / "strike.mp4").read_bytes()[4:8] == b"ftyp"
    assert "matplotlib" in done.stderr
