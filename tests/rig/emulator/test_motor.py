"""The emulated motor against the maker's three figures."""

from __future__ import annotations

import math

import numpy as np
import pytest

from whiptool.errors import InputError
from whiptool.rig.emulator import HARDWARE, Fault, Motor


def test_motor_has_the_makers_three_figures():
    m = Motor()
    stall = m.current(99, 0.0)
    assert stall == pytest.approx(2.3)
    assert m.torque(stall, 0.0) == pytest.approx(4.1)
    no_load = 46 * 2 * math.pi / 60
    assert m.current(99, no_load) == pytest.approx(0, abs=1e-12)
    for w in np.linspace(0, no_load, 7):  # the line between them
        assert m.torque(m.current(99, w), w) == pytest.approx(4.1 * (1 - w / no_load))


def test_motor_friction_takes_power_at_any_speed():
    for w in (-3.0, -0.01, 0.01, 3.0):
        assert (HARDWARE.torque(0.0, w)) * w < 0
    assert HARDWARE.torque(0.0, 5.0) == pytest.approx(-0.03 * 5 - 0.08, rel=1e-3)


def test_motor_refuses_nonsense():
    with pytest.raises(InputError, match="efficiency"):
        Motor(efficiency=1.2)
    with pytest.raises(InputError, match="fault"):
        Fault("explode")
