"""What the doctor reports."""

from __future__ import annotations

import json
import os

from command_line import assert_one_line, whiptool


def test_doctor_reports(tmp_path):
    done = whiptool("doctor", "--json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    report = json.loads(done.stdout)
    assert report["engine"]["found"].startswith(("simd", "scalar", "interpreter"))
    assert {"mujoco", "C++ compiler", "OpenGL", "cores", "extra rl"} <= set(report)
    forced = whiptool("doctor", cwd=tmp_path, env={**os.environ, "WHIPTOOL_ENGINE": "interpreter"})
    assert "interpreter (forced by WHIPTOOL_ENGINE)" in forced.stdout
    without = whiptool("doctor", cwd=tmp_path, env={**os.environ, "CXX": "no-such-compiler"})
    assert "install g++" in without.stdout
    wrong = whiptool("doctor", cwd=tmp_path, env={**os.environ, "WHIPTOOL_ENGINE": "abacus"})
    assert_one_line(wrong, "WHIPTOOL_ENGINE")
