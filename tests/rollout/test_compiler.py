"""Machines without a compiler, and the cache of what was compiled."""

from __future__ import annotations

import logging
import os
import subprocess
import sys

from processes import HANG
from rich_model import CONTROLLERS, LEMON

from whiptool.rollout import CompiledRollout
from whiptool.rollout import compiler as compiler_module


def test_without_a_compiler_the_interpreter_runs_and_says_so_once(monkeypatch, caplog):
    from whiptool.rollout import engine

    monkeypatch.setenv("CXX", "no-such-compiler")
    compiler_module.find_compiler.cache_clear()
    engine.find_engine.cache_clear()
    with caplog.at_level(logging.WARNING, logger="whiptool"):
        rollout = CompiledRollout(LEMON, CONTROLLERS["constant"], timestep=2e-3)
        CompiledRollout(LEMON, CONTROLLERS["constant"], timestep=1e-3)
    monkeypatch.delenv("CXX")
    compiler_module.find_compiler.cache_clear()
    engine.find_engine.cache_clear()
    assert rollout.engine == "interpreter"
    assert len(caplog.records) == 1


def test_processes_that_start_at_once_share_the_cache(tmp_path):
    """Four first starts on an empty cache: all agree, one library is left, nothing half-written."""
    program = (
        "import numpy as np; from whiptool.models import preset; from whiptool.rollout import CompiledRollout;"
        "from whiptool.impedance import *;"
        "r = CompiledRollout(preset('lemon2024'), Controller(ConstantImpedance()), timestep=1e-3);"
        "assert r.engine != 'interpreter';"
        "print(repr(r.approach(np.array([[-1.2, 0.9, 1.2, 0.3, 0.7]]), np.array([1.3, 0.0]), t_stay=0.3).distance[0]))"
    )  # fmt: skip
    environment = {**os.environ, "XDG_CACHE_HOME": str(tmp_path)}
    runs = [
        subprocess.Popen([sys.executable, "-c", program], env=environment, stdout=subprocess.PIPE) for _ in range(4)
    ]
    printed = {run.communicate(timeout=HANG)[0] for run in runs}
    assert all(run.returncode == 0 for run in runs)
    assert len(printed) == 1
    left = [path.name for path in (tmp_path / "whiptool" / "compiled").iterdir()]
    assert len(left) == 1
    assert left[0].endswith(".so")


def test_a_damaged_cache_is_mended(tmp_path, monkeypatch):
    from whiptool.rollout import engine

    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    engine.find_engine.cache_clear()
    CompiledRollout(LEMON, CONTROLLERS["held"])
    (library,) = (tmp_path / "whiptool" / "compiled").glob("*.so")
    library.unlink()
    library.write_bytes(b"not a library")
    engine.find_engine.cache_clear()
    assert CompiledRollout(LEMON, CONTROLLERS["held"]).engine != "interpreter"
    engine.find_engine.cache_clear()
