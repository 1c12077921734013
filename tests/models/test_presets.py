"""Presets as published."""

from __future__ import annotations

import pytest

from whiptool.errors import InputError
from whiptool.impedance import constant_preset, oiac_preset
from whiptool.limits.motor_limits import limits_preset
from whiptool.models import load_model, preset


def test_published_presets():
    lemon = preset("lemon2024")
    w = lemon.whip
    assert (w.N, w.l, w.m, w.k, w.b) == (12, 0.072, 0.012, 0.242, 0.092)  # Table 2
    assert [(link.mass, link.length) for link in lemon.arm.links] == [(0.25, 0.31), (0.274, 0.34)]  # Table 3
    assert lemon.whip.length == pytest.approx(0.864)
    assert lemon.whip.mass == pytest.approx(0.144)
    fitted = preset("nah2020-fitted")
    assert (fitted.whip.length, fitted.whip.mass) == (pytest.approx(1.8), pytest.approx(0.3))
    assert {preset(f"nah2020-n{n}").whip.N for n in (10, 15, 20)} == {10, 15, 20}


def test_a_preset_of_no_such_name_is_refused_with_all_names():
    names = "lemon2024, nah2020-n10.*panda; did you mean lemon2024"
    with pytest.raises(InputError, match=rf"^model preset: got 'lemon2023'; allowed: {names}\?$"):
        preset("lemon2023")


@pytest.mark.parametrize("written", ["UR5e", "UR5E", "ur5e"])
def test_capital_letters_make_no_difference(written):
    assert preset(written) == load_model(written) == preset("ur5e")
    assert limits_preset("XM430") is limits_preset("xm430")
    assert oiac_preset("Table4") is oiac_preset("table4")
    assert constant_preset(written) is constant_preset("ur5e")
