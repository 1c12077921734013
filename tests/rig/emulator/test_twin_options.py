"""Options of the twin are checked."""

from __future__ import annotations

import pytest

import whiptool as wt
from whiptool.errors import InputError
from whiptool.rig.emulator import TwinOptions
from whiptool.rig.emulator.physics import Physics


def test_options_are_checked():
    with pytest.raises(InputError, match="baud"):
        TwinOptions(baud=1234)
    with pytest.raises(InputError, match="ids"):
        TwinOptions(ids=(1, 1))
    o = TwinOptions(model=wt.preset("lemon2024"), start=(0.1,))
    with pytest.raises(InputError, match="start"):
        Physics(o)
