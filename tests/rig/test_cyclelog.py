"""The record of a run's cycles on disk."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from full_disk import full_disk

from whiptool.errors import InputError
from whiptool.rig.cyclelog import CycleLog, Cycles


@pytest.mark.slow
def test_log_survives_a_cut_and_refuses_what_is_none(tmp_path):
    path = tmp_path / "x.cycles"
    log = CycleLog(2, path, about={"a": 1})
    row = list(range(6 + 8 * 2))
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
    row = np.arange(3 + 8 * 2 + 3).tolist()
    log.append(row)
    with full_disk(path.stat().st_size + 20), pytest.raises(OSError, match=r"cycles\.log"):
        log.append(row)
    log.close()
    assert len(Cycles.load(path)) == 1
    assert (path.stat().st_size - path.read_bytes().index(b"\n") - 1) % (8 * len(row)) == 0
