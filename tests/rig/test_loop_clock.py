"""The loop's clocks."""

from __future__ import annotations

import pytest

from whiptool.rig.control_loop import StepClock, WallClock

pytest.importorskip("dynamixel_sdk")


def test_clocks_do_not_go_back():
    clock = StepClock()
    clock.sleep_until(1.0)
    clock.sleep_until(0.5)
    assert clock.now() == 1.0
    wall = WallClock()
    start = wall.now()
    wall.sleep_until(start + 0.01)
    assert wall.now() - start >= 0.01
