"""The record of a run's cycles on disk."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from full_disk import full_disk

from whiptool.errors import InputError
from whiptool.rig.cyclelog import _COLUMNS, CycleLog, Cycles


def row_of(joints: int) -> dict[str, float | np.ndarray]:
    """A cycle whose numbers count from 0 on."""
    numbers = iter(np.arange(100.0))
    return {
        name: np.array([next(numbers) for _ in range(joints)]) if each else next(numbers) for name, each in _COLUMNS
    }


@pytest.mark.slow
def test_log_survives_a_cut_and_refuses_what_is_none(tmp_path):
    path = tmp_path / "x.cycles"
    log = CycleLog(2, path, about={"a": 1})
    row = row_of(2)
    for _ in range(3):
        log.append(row)
    data = path.read_bytes()  # before it is closed
    path.write_bytes(data[:-5])
    assert len(Cycles.load(path)) == 2
    assert Cycles.load(path).q[0].tolist() == [3, 4]
    path.write_bytes(b"nonsense\n123")
    with pytest.raises(InputError, match="begins with"):
        Cycles.load(path)


def test_a_record_of_cycles_keeps_whole_rows(tmp_path: Path) -> None:
    log, path = CycleLog(2, tmp_path / "cycles.log"), tmp_path / "cycles.log"
    row = row_of(2)
    log.append(row)
    with full_disk(path.stat().st_size + 20), pytest.raises(OSError, match=r"cycles\.log"):
        log.append(row)
    log.close()
    assert len(Cycles.load(path)) == 1
    assert (path.stat().st_size - path.read_bytes().index(b"\n") - 1) % (8 * (6 + 8 * 2)) == 0
