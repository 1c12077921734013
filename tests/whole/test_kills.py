"""`benchmarks/kills.py`, a few kills of it: resumed runs end as those that were left alone."""

from __future__ import annotations

import importlib.util
import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from repository import ROOT

_SCRIPT = ROOT / "benchmarks" / "kills.py"
_SPEC = importlib.util.spec_from_file_location("kills", _SCRIPT)
assert _SPEC is not None
assert _SPEC.loader is not None
kills = importlib.util.module_from_spec(_SPEC)
_SPEC.loader.exec_module(kills)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["identify", "learn"])  # the others are killed in the tests of their commands
def test_a_killed_command_goes_on_to_the_same_end(name: str, tmp_path: Path) -> None:
    if name == "learn":
        pytest.importorskip("dynamixel_sdk")
    whole, kill = kills.all_kills(name, tmp_path, 1, 0)
    assert whole["status"] == 0, whole
    assert whole["refused"], whole["said"]
    assert kill["wrong"] == []
    (tmp_path / "killed").rename(tmp_path / "gone")
    assert kills.all_kills(name, tmp_path, 1, 0) == [whole, kill]  # what is on record is not done again


def test_differences_are_seen(tmp_path: Path) -> None:
    one, two = tmp_path / "one", tmp_path / "two"
    one.mkdir()
    (one / "result.json").write_text(json.dumps({"miss": 0.1, "rows": [{"wall_time": 1.0, "n": 3}]}))
    (one / "table.csv").write_text("n,wall_time\n3,1.0\n")
    (one / "cycles.log").write_bytes(b"cycles")
    np.savez(one / "recording.npz", t=np.array([0.0, np.nan]), markers=np.array(["tip"]))
    shutil.copytree(one, two)
    (two / "result.json").write_text(json.dumps({"miss": 0.1, "rows": [{"wall_time": 2.0, "n": 3}]}))
    (two / "table.csv").write_text("n,wall_time\n3,2.0\n")
    assert kills.differences(one, two) == []
    (two / "result.json").write_text(json.dumps({"miss": 0.1, "rows": [{"wall_time": 1.0, "n": 4}]}))
    (two / "table.csv").write_text("n,wall_time\n4,1.0\n")
    (two / "cycles.log").write_bytes(b"cycle")
    np.savez(two / "recording.npz", t=np.array([0.0, 1.0]), markers=np.array(["tip"]))
    (two / ".lock").write_text("")
    found = ["cycles.log", "recording.npz", "result.json", "table.csv"]
    assert kills.differences(one, two) == [*(f"differs: {name}" for name in found), "only in the resumed: .lock"]
