"""Parameters: validation at the door, and changes by name."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from random_models import models

from whiptool.errors import InputError
from whiptool.models import (
    ArmLink,
    ArmParameters,
    WhipParameters,
    preset,
)


def test_the_hinge_is_free_and_links_are_rods():
    whip = preset("lemon2024").whip
    assert whip.per_node("k")[0] == whip.per_node("b")[0] == 0
    assert (whip.per_node("k")[1:] == 0.242).all()
    link = ArmLink(mass=0.3, length=0.4)
    assert (link.com, link.inertia) == (0.2, pytest.approx(0.3 * 0.4**2 / 12))
    sprung = dataclasses.replace(whip, k=tuple(np.full(12, 0.3)))
    assert sprung.per_node("k")[0] == 0.3  # a value per node speaks of the hinge, too


def _whip(**changes):
    return WhipParameters(**{"N": 3, "l": 0.1, "m": 0.01, "k": 0.2, "b": 0.1, **changes})


@pytest.mark.parametrize(
    ("changes", "name"),
    [
        ({"N": 0}, "N"), ({"N": 2.5}, "N"), ({"N": True}, "N"), ({"l": 0.0}, "l"), ({"m": -0.1}, "m"),
        ({"k": -1.0}, "k"), ({"b": float("nan")}, "b"), ({"l": [0.1, 0.1]}, "l"), ({"m": [0.1, 0.1, -0.1]}, r"m\[2\]"),
        ({"k": "stiff"}, "k"), ({"drag": -1.0}, "drag"), ({"friction_velocity": 0.0}, "friction_velocity"),
        ({"rest_angle": float("inf")}, "rest_angle"), ({"hinge_mass": -1e-9}, "hinge_mass"),
    ],
)  # fmt: skip
def test_bad_whips_are_named(changes, name):
    with pytest.raises(InputError, match=f"^{name}: got .*allowed: ") as caught:
        _whip(**changes)
    assert "\n" not in str(caught.value)


def test_bad_arms_are_named():
    for wrong, name in (({"mass": 0}, "mass"), ({"length": -1}, "length"), ({"friction": -1}, "friction")):
        with pytest.raises(InputError, match=f"^{name}"):
            ArmLink(**{"mass": 1.0, "length": 1.0, **wrong})
    with pytest.raises(InputError, match="joints"):
        ArmParameters((ArmLink(1.0, 1.0),), joints=("a", "b"))
    with pytest.raises(InputError, match="lemon2024, nah2020-n10"):
        preset("lemon2023")


@given(models())
@settings(max_examples=50, deadline=None, derandomize=True)
def test_every_parameter_can_be_changed_by_name(model):
    for name, value in model.parameters().items():
        changed = model.with_parameters({name: value + 0.5})
        assert changed != model
        assert changed.parameters()[name] == pytest.approx(value + 0.5)
        assert changed.with_parameters({name: value}) == model
    with pytest.raises(InputError, match=r"whip\.l"):
        model.with_parameters({"whip.q": 1.0})
