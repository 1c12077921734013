"""The controller of a model where none is given: in Python, in MuJoCo, and in the learners' environment."""

from __future__ import annotations

from dataclasses import replace

import pytest
from spatial_arms import of_universal_nodes

from whiptool import CompiledRollout, Controller, ReferenceRollout, default_controller, preset
from whiptool.errors import InputError
from whiptool.impedance import OIAC, PositionControl, constant_preset
from whiptool.models import Model, in_space
from whiptool.rl.environment import make_task

LEMON, UR5E = preset("lemon2024"), preset("ur5e")
OF_MODELS = [
    (LEMON, Controller(OIAC(a=1.3e-4))),  # fitted to Table 4
    (preset("nah2020-n10"), Controller(OIAC(a=1.3e-4))),
    (preset("nah2023"), Controller(constant_preset("nah2023"))),
    (UR5E, Controller(PositionControl())),
    (preset("panda"), Controller(PositionControl())),
    (of_universal_nodes("ur5e"), Controller(PositionControl())),
    (Model(UR5E.whip, in_space(LEMON.arm), name="a file's"), Controller(PositionControl())),
]


@pytest.mark.slow
@pytest.mark.parametrize(("model", "controller"), OF_MODELS, ids=lambda x: getattr(x, "name", ""))
def test_each_kind_of_arm_has_a_controller(model, controller):
    assert default_controller(model) == controller
    assert CompiledRollout(model, engine="interpreter").controller == controller
    assert ReferenceRollout(model).controller == controller


def test_the_environment_has_it_too():
    assert make_task(model=LEMON).rollout.controller == default_controller(LEMON)


def test_ropes_of_robots_bend_alike_all_around():
    for name in ("ur5e", "panda"):
        assert (preset(name).whip.joints, preset(name).whip.N) == ("rod", 20)
    assert preset("nah2023").whip.joints == "universal"  # as published
    universal = of_universal_nodes("ur5e").whip
    assert replace(universal, joints="rod", node_inertia=0.0) == UR5E.whip
    assert universal.per_node("node_inertia")[0] == pytest.approx(universal.per_node("m")[0] * 6.35e-3**2 / 2)


def test_an_arm_is_no_model():
    with pytest.raises(InputError, match="model"):
        default_controller(UR5E.arm)
