"""Boxes: their hit rule, their refusals, and speeds that are bounded on both sides."""

from __future__ import annotations

import math

import numpy as np
import pytest

from whiptool.errors import InputError
from whiptool.models import preset
from whiptool.throws.box import Box


def test_a_box_is_a_target_that_may_be_out_of_reach():
    box = Box((5.0, -0.5), 0.1, normal=(-3.0, 4.0))
    box.check_reach(preset("lemon2024"))
    assert box.normal == (-0.6, 0.8)
    assert box.goals.hit(np.array([0.09, 0.11]), np.zeros((2, 2))).tolist() == [True, False]
    with pytest.raises(InputError, match="three coordinates"):
        box.check_reach(preset("fr3"))


def test_openings_that_nothing_falls_into_are_refused():
    for normal in ((1.0, 0.0), (0.0, -1.0), (0.0, 0.0)):
        with pytest.raises(InputError, match="normal of the box"):
            Box((1.8, -0.5), 0.1, normal=normal)
    with pytest.raises(InputError, match="largest speed"):
        Box((1.8, -0.5), 0.1, speed=4.0, most_speed=3.0)


def test_speeds_bounded_on_both_sides():
    goals = Box((1.8, -0.5), 0.1, speed=3.0, most_speed=5.0).goals
    velocity = np.array([[0.0, -2.0], [0.0, -4.0], [3.0, -4.2]])
    assert goals.hit(np.zeros(3), velocity).tolist() == [False, True, False]
    beyond = math.hypot(3.0, 4.2) / 5 - 1
    assert goals.cost(np.zeros(3), velocity) == pytest.approx([0.1 / 3, 0.0, 0.1 * beyond])
    assert goals.excess(np.zeros(3), velocity)["speed"] == pytest.approx([1.0, -1.0, math.hypot(3.0, 4.2) - 5])
    assert not goals.only_points
    change = np.array([[[0.3], [-0.7]]])
    for one in velocity:
        slope = goals.residual_slopes(one[None], np.zeros((1, 2, 1)), change)[0, 2, 0]
        ahead, behind = (
            goals.residuals(np.zeros((1, 2)), one[None] + x * change[:, :, 0])[0, 2] for x in (1e-6, -1e-6)
        )
        assert slope == pytest.approx((ahead - behind) / 2e-6, abs=1e-8)


def test_outline_and_motion():
    box = Box((1.8, -0.5), 0.1, velocity=(0.5, 0.0))
    assert box.at(2.0).position == (2.8, -0.5)
    assert box.at(2.0).velocity is None
    rim = Box((1.0, 2.0, 0.5), 0.1, normal=(0.0, 0.6, 0.8)).outline[:25] - [1.0, 2.0, 0.5]
    assert np.linalg.norm(rim, axis=1) == pytest.approx(0.1)
    assert rim @ [0.0, 0.6, 0.8] == pytest.approx(0.0, abs=1e-9)
    assert box.outline[0] == pytest.approx([1.7, -0.5])


def test_directions_that_the_opening_cannot_be_entered_by_and_fast_boxes_are_refused():
    for direction in ((0.0, 1.0), (1.0, 0.0), (1.0, -0.08)):
        with pytest.raises(InputError, match=r"direction.*75 degrees from its normal"):
            Box((1.8, -0.5), 0.1, direction=direction)
    Box((1.8, -0.5), 0.1, direction=(1.0, -0.2))  # the cone of 10 degrees reaches 69 degrees
    Box((1.8, -0.5), 0.1, direction=(1.0, 0.5), velocity=(0.0, 3.0))  # as seen from the rising box it falls
    with pytest.raises(InputError, match="direction"):
        Box((1.8, -0.5), 0.1, direction=(0.0, 1.0), speed=4.0, velocity=(0.0, 3.0))
    with pytest.raises(InputError, match="at most 10 m/s"):
        Box((1.8, -0.5), 0.1, velocity=(8.0, 8.0))
