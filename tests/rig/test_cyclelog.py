"""The record of a run's cycles on disk."""

from __future__ import annotations

import pytest

from whiptool.errors import InputError
from whiptool.rig.cyclelog import CycleLog, Cycles

pytestmark = pytest.mark.slow

pytest.importorskip("dynamixel_sdk")


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
