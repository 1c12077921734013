"""Bases on walls and ceilings: against turning by hand, and gravity turned the other way."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from whiptool.commands.options.target_options import ModelOptions
from whiptool.errors import InputError
from whiptool.models import JointLimits, Model, SpatialArm, in_space, preset
from whiptool.models.kinematics import arm_frames
from whiptool.models.mount import default_floor, level_links, mount_rotation, mounted
from whiptool.models.robots import PANDA_ARM, UR5E_ARM, rope
from whiptool.models.scene import Scene

Q = (0.3, -0.8, 0.5, -1.2, 0.4, 0.9, 0.1)


@pytest.mark.parametrize(
    ("given", "R"),
    [
        ("wall", [[0, 0, 1], [0, 1, 0], [-1, 0, 0]]),
        ("ceiling", [[1, 0, 0], [0, -1, 0], [0, 0, -1]]),
        ((0.0, 0.0, np.pi / 2), [[0, -1, 0], [1, 0, 0], [0, 0, 1]]),
        ("floor", np.eye(3)),
    ],
)
def test_hand_and_shapes_are_turned_about_the_base(given, R):
    np.testing.assert_allclose(mount_rotation(given), R, atol=1e-15)
    turned = mounted(PANDA_ARM, given)
    hands = [arm_frames(arm, np.array(Q))[-1] for arm in (PANDA_ARM, turned)]
    np.testing.assert_allclose(hands[1].origin, R @ hands[0].origin, atol=1e-15)
    np.testing.assert_allclose(hands[1].rotation, R @ hands[0].rotation, atol=1e-15)
    ends = [Scene(Model(rope(3), arm), of="apart").segments(np.array([Q])) for arm in (PANDA_ARM, turned)]
    for upright, other in zip(*ends, strict=True):
        np.testing.assert_allclose(other, upright @ np.transpose(R), atol=1e-15)


def test_the_option_turns_presets_too_and_refuses_what_is_no_rotation():
    assert ModelOptions(model="ur5e").base == ("floor",)

    class InSpace(ModelOptions):
        in_space = True

    arm = InSpace(model="ur5e", base=("ceiling",)).build_model().arm
    assert arm.links[:5] == mounted(UR5E_ARM, "ceiling").links[:5]  # the last holds a stick
    assert InSpace(model="ur5e", base=("3.141592653589793", "0", "0")).build_model().arm == arm
    for base in (("roof",), ("1", "2"), ("1", "2", "x")):
        with pytest.raises(InputError, match=r"--base: got .*allowed: floor, wall, ceiling, or three numbers"):
            InSpace(model="ur5e", base=base).build_model()
    with pytest.raises(InputError, match=r"--base: got '90 rad of pitch'; .*are these degrees"):
        InSpace(model="ur5e", base=("0", "90", "0")).build_model()
    with pytest.raises(InputError, match="arm in the plane"):
        ModelOptions(base=("wall",)).build_model()
    with pytest.raises(InputError, match=r"tip: got 'tool0'; allowed: nothing but with a robot's file"):
        InSpace(model="ur5e", arm_tip="tool0").build_model()


@pytest.mark.parametrize(
    ("arm", "level", "floor"),
    [
        (UR5E_ARM, 1, 0.0),  # its pan turns about the vertical, its lift is 0.1625 m above the base
        (PANDA_ARM, 1, 0.0),
        (preset("nah2023").arm, 0, None),  # a shoulder stands on nothing
        (in_space(preset("lemon2024").arm), 0, None),
        (preset("lemon2024").arm, None, None),
        (mounted(PANDA_ARM, "wall"), 0, None),
        (mounted(PANDA_ARM, "ceiling"), 1, None),
        (mounted(PANDA_ARM, (0.0, 1.57, 0.0)), 0, None),  # a wall with few digits
    ],
)
def test_a_robot_stands_on_a_floor_where_its_shoulder_is_above_its_base(arm, level, floor):
    assert default_floor(arm) == floor
    if level is not None:
        assert level_links(arm) == level


def test_links_that_stay_at_their_height_are_not_compared_with_the_floor():
    """The Panda's first link begins 6 cm below its base; a robot that slides along a rail and turns above it."""
    scene = Scene(preset("panda"), 0.0, "apart")
    over = {scene.links_of(pair)[0] for pair in scene.pairs if scene.links_of(pair)[1] == -2}
    assert over == {1, 2, 3, 4, 5, 6}
    rail = replace(PANDA_ARM.links[0], axis=(1.0, 0.0, 0.0), kind="prismatic", limits=JointLimits((-1.0, 1.0)))
    on_rail = SpatialArm((rail, replace(PANDA_ARM.links[0], position=(0.0, 0.0, 0.0)), *PANDA_ARM.links[1:]))
    assert level_links(on_rail) == 2
    assert default_floor(on_rail) == 0.0
