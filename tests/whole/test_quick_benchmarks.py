"""Benchmarks of the rig and of adaptation, in their quick form: they run, and what they promise holds."""

from __future__ import annotations

import json
import re
import subprocess
import sys

import pytest
from repository import ROOT
from robot_files import MJCF, URDF

pytest.importorskip("dynamixel_sdk")


SCRIPTS = sorted(path for path in (ROOT / "benchmarks").rglob("*.py") if path.parent.name != "peers")


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.name)
def test_every_benchmark_has_a_quick_form_and_json(script):
    """By its text, in no time; `test_benchmarks.py` asks each of them."""
    options = re.findall(r"""add_argument\(\s*["'](--[\w-]+)["']""", script.read_text())
    assert {"--json", "--quick"} <= set(options)


@pytest.mark.slow
@pytest.mark.parametrize(
    "words", ["rig.py", "rig_faults.py", "rig_stops.py", "emulator_load.py", "replan.py", "replan.py --space"]
)
def test_benchmarks_run(words):
    script, *options = words.split()
    command = [sys.executable, str(ROOT / "benchmarks" / script), "--json", "--quick", *options]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT)
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)
    if script == "rig.py":
        assert result["cycles_per_second"] > 0
        assert result["paced_cycles"] > 0
        assert set(result["detection_ms"]) >= {"drop", "hot", "unplug"}
    elif script == "emulator_load.py":
        assert result["command_scans_found"] == result["tries"] == 1
        assert result["lockstep_repeats"]
    elif script == "replan.py":
        assert result["kin"]["number"] == 1
        assert 0 < result["kin"]["learn"] < result["kin"]["both"]
    elif script == "rig_stops.py":
        assert result["armed_after_a_stop"] == result["violations"] == 0
        assert sum(result["ends"].values()) == result["stops"]
    else:
        assert result["violations"] == 0
        assert result["strikes"] >= 20


@pytest.mark.slow
def test_the_defaults_keep_their_tolerance():
    """Nothing beyond ten tolerances, and nothing that diverged, is unmarked."""
    command = [sys.executable, str(ROOT / "benchmarks" / "defaults.py"), "--json", "--quick"]
    presets = json.loads(subprocess.run(command, capture_output=True, text=True, check=True).stdout)["presets"]
    kinds = [entry[kind] for entry in presets.values() for kind in ("free", "limits") if kind in entry]
    assert len(kinds) == 3
    for measured in kinds:
        assert measured["p99_error"] < 1e-4
        assert measured["unmarked"] == measured["diverged_unmarked"] == 0


@pytest.mark.slow
def test_every_robot_in_a_folder_is_read_strikes_or_is_refused_with_the_cure(tmp_path):
    """A tip that has to be named is; what has no joints, and a second copy, are left out."""
    (tmp_path / "one.xml").write_text(MJCF)
    (tmp_path / "two.xml").write_text(MJCF)
    (tmp_path / "two.urdf").write_text(URDF)
    (tmp_path / "still.urdf").write_text('<robot name="still"><link name="base"/></robot>')
    (tmp_path / "broken.xml").write_text(MJCF.replace("</worldbody>", "<joint/>"))
    command = [sys.executable, str(ROOT / "benchmarks" / "robots.py"), str(tmp_path), "--json"]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT)
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)
    assert result["kinds"] == {"struck": 2, "refused": 1}
    assert result["left_out"] == {"without a joint that moves": 1, "copy of another": 1}
    assert all(row["named"] == ["tip"] for row in result["rows"] if row["kind"] == "struck")
