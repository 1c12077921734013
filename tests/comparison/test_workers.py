"""Worker processes that die, units that fail, and how many are started."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path

import pytest

from whiptool.commands.compare import CompareOptions
from whiptool.comparison.units import UnitFailed, work_on
from whiptool.errors import InputError


class DieOnce:
    """Work that kills its process the first `times` times that it meets the unit `bad`."""

    def __init__(self, marks: Path, times: int) -> None:
        self.marks, self.times = marks, times

    def __call__(self, unit: str) -> str:
        if unit == "bad" and len(list(self.marks.iterdir())) < self.times:
            (self.marks / f"{os.getpid()}-{time.monotonic_ns()}").touch()
            os.kill(os.getpid(), signal.SIGKILL)
        return unit.upper()


@pytest.mark.parametrize("times", [1, 2])
def test_a_dead_worker_is_replaced_and_reported(tmp_path, times):
    units, deaths = {name: name for name in ("a", "b", "bad", "c", "d")}, []
    found = dict(work_on(units, DieOnce(tmp_path, times), workers=2, on_death=deaths.append))
    assert found == {name: name.upper() for name in units}
    assert 1 <= len(deaths) <= times
    assert all("bad" in names for names in deaths)


def test_a_unit_that_kills_every_worker_is_given_up_after_the_others(tmp_path):
    units, found = {name: name for name in ("bad", "a", "b", "c")}, {}
    results = work_on(units, DieOnce(tmp_path, 99), workers=2)
    with pytest.raises(UnitFailed, match=r"^bad: 3 workers died"):
        found.update(results)
    assert set(found) == {"a", "b", "c"}


def test_no_more_processes_than_units_and_cores(monkeypatch, capsys):
    """100,000 workers are neither forked for two units nor on a machine with fewer cores."""
    asked = []

    class Full(Exception):
        pass

    def pool(max_workers, **_):
        asked.append(max_workers)
        raise Full

    monkeypatch.setattr("loky.ProcessPoolExecutor", pool)
    with pytest.raises(Full):
        dict(work_on({"a": 1, "b": 2}, _refuse, workers=100_000))
    assert asked == [2]
    cores = max(2, os.cpu_count() or 1)
    assert CompareOptions(workers=100_000).processes() == cores
    assert capsys.readouterr().err == f"whiptool: --workers 100000: {cores} are used, one per core\n"
    assert CompareOptions(workers=1).processes() == 1
    assert capsys.readouterr().err == ""


def _refuse(unit: str) -> str:

    raise InputError("whip.k", -1, "a number >= 0")


@pytest.mark.parametrize("count", [1, 2])
def test_a_units_own_error_comes_with_its_name(count):
    with pytest.raises(UnitFailed, match=r"^b: whip\.k: got -1"):
        dict(work_on({"b": 1}, _refuse, workers=count))
