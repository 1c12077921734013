"""Options of limits: which floor a robot has without them, and how they say another."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import pytest

from whiptool.commands.options.controller_options import SimulatedControllerOptions
from whiptool.commands.options.limit_options import LimitOptions
from whiptool.commands.options.target_options import ModelOptions
from whiptool.errors import InputError
from whiptool.limits.arm_limits import ArmLimits
from whiptool.limits.clearance import Clearance


@dataclass(frozen=True, kw_only=True)
class Options(LimitOptions, SimulatedControllerOptions, ModelOptions):
    """A command that judges strikes."""

    in_space: ClassVar[bool] = True

    def built(self):
        return self.build_limits(self.find_model(), self.build_controller())


@pytest.mark.parametrize(
    ("given", "floor"),
    [
        ({}, 0.0),
        ({"floor": "none"}, None),
        ({"floor": "-0.8"}, -0.8),
        ({"base": ("ceiling",)}, None),
        ({"base": ("wall",)}, None),
        ({"base": ("ceiling",), "floor": "-1.5"}, -1.5),
    ],
)
@pytest.mark.parametrize("model", ["ur5e", "panda"])
def test_a_robot_has_the_floor_on_which_it_stands_or_that_is_told(model, given, floor):
    options = Options(model=model, **given)
    options.check()
    model = options.find_model()
    assert options.built() == [ArmLimits.of(model.arm, prescribed=True), Clearance(model, floor)]


def test_others_have_none_unless_it_is_told():
    for name in ("lemon2024", "nah2023"):
        assert Options(model=name).built() == []
        assert [limits.floor for limits in Options(model=name, floor="-2").built()] == [-2.0]


def test_nothing_is_kept_where_that_is_said():
    assert Options(model="ur5e", limits="none").built() == []
    assert [type(x) for x in Options(model="ur5e", ignore_collisions=True).built()] == [ArmLimits]
    for given in ("high", "", "nan"):
        with pytest.raises(InputError, match=r"--floor: got .*; allowed: a (finite )?number"):
            Options(model="ur5e", floor=given).check()
