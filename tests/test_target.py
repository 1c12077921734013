"""Targets in the plane and in space: coordinates, radius, reach."""

from __future__ import annotations

import numpy as np
import pytest

from whiptool.errors import InputError
from whiptool.models import preset
from whiptool.target import Target, as_target

FLAT, SPACE = preset("lemon2024"), preset("nah2023")


@pytest.mark.parametrize(
    ("position", "radius", "message"),
    [
        ((1.0,), 0.06, "target"), ((1.0, 0.0, 0.0, 0.0), 0.06, "target"), ((1.0, float("nan")), 0.06, "target"),
        ((1.0, 0.0, float("inf")), 0.06, "target"), ((1.0, 0.0), 0.0, "hit radius"),
    ],
)  # fmt: skip
def test_bad_targets_are_named(position, radius, message):
    with pytest.raises(InputError, match=f"^{message}: got "):
        Target(position, radius)


def test_a_target_is_of_its_model_s_space():
    with pytest.raises(
        InputError, match=r"three coordinates x y z in m, for the model nah2023.* in space; such as 1\.4 0 0$"
    ):
        Target((1.0, 0.0)).check_reach(SPACE)
    with pytest.raises(
        InputError,
        match=r"two coordinates x y in m, for the model lemon2024.* the plane; such as [0-9.]+ 0$",
    ):
        Target((1.0, 0.0, 0.0)).check_reach(FLAT)


def test_a_target_is_within_reach():
    Target((2.385, 0.0, 0.0)).check_reach(SPACE)  # of the stretched arm and whip
    Target((1.4, 1.4, 1.4), 0.06).check_reach(SPACE)
    with pytest.raises(InputError, match=r"within the model's reach of 2\.385 m.*it is 2\.598 m away"):
        Target((1.5, 1.5, 1.5)).check_reach(SPACE)
    with pytest.raises(InputError, match=r"^hit radius"):
        Target((0.0, 0.0, 1.0), 5.0).check_reach(SPACE)


def test_places_become_targets():
    assert as_target(None) == Target((1.3, 0.0))
    assert as_target(None, 3) == Target((1.3, 0.0, 0.0))
    assert as_target(np.array([1.0, 2.0, 0.5])) == Target((1.0, 2.0, 0.5))
    target = Target((1.0, 2.0), 0.01)
    assert as_target(target) is target
