"""Joints of the arm in SI units."""

from __future__ import annotations

import numpy as np
import pytest

from whiptool.errors import InputError
from whiptool.rig.dynamixel import Joints, Units


def test_joints_are_in_si_units(bus):
    joints = Joints(bus, zero=[2048, 2000], direction=[1, -1])
    sample = joints.read()
    np.testing.assert_allclose(sample.q, [0.3, -(0.5 + 48 * Units().position)], atol=Units().position)
    np.testing.assert_array_equal(joints.counts(np.array([1.0, 1.0])), np.array([1, -1]) * round(2.3 / 4.1 / 2.69e-3))
    np.testing.assert_allclose(joints.torque(joints.counts(np.array([2.0, -3.0]))), [2.0, -3.0], atol=0.005)
    joints.current_limit = 100
    assert np.abs(joints.counts(np.array([9.0, -9.0]))).max() == 100
    with pytest.raises(InputError, match="direction"):
        Joints(bus, direction=[1, 2])
