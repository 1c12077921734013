"""Targets in the plane and in space: coordinates, radius, reach."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from whiptool.errors import InputError
from whiptool.goals.target import Target, as_target, usual_target
from whiptool.models import preset
from whiptool.models.mount import mounted

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
        InputError, match=r"three coordinates x y z in m, for the model nah2023.* in space; such as 1\.3 0 0$"
    ):
        Target((1.0, 0.0)).check_reach(SPACE)
    with pytest.raises(
        InputError,
        match=r"two coordinates x y in m, for the model lemon2024.* the plane; such as 1\.3 0; a hit radius is",
    ):
        Target((1.0, 0.0, 0.0)).check_reach(FLAT)


def test_a_target_is_within_reach():
    Target((2.385, 0.0, 0.0)).check_reach(SPACE)  # of the stretched arm and whip
    Target((1.4, 1.4, 1.4), 0.06).check_reach(SPACE)
    with pytest.raises(InputError, match=r"within the model's reach of 2\.385 m.*it is 2\.598 m away"):
        Target((1.5, 1.5, 1.5)).check_reach(SPACE)
    with pytest.raises(InputError, match=r"^hit radius"):
        Target((0.0, 0.0, 1.0), 5.0).check_reach(SPACE)


def test_the_usual_target_lies_where_the_model_can_strike_and_clear_of_its_floor():
    """By hand: 45 % of the reach of 2.851 m, 2.969 m and 2.351 m; without a floor 55 % of 2.385 m and 2.851 m."""
    assert usual_target(preset("lemon2024")) == Target((1.3, 0.0))
    assert usual_target(SPACE) == Target((1.3, 0.0, 0.0))
    assert usual_target(preset("ur5e")) == usual_target(preset("panda")) == Target((1.2, 0.3, 0.5))
    assert usual_target(preset("ur5e").with_whip(length=0.5)).position == (1.0, 0.2, 0.4)
    hanging = dataclasses.replace(preset("ur5e"), arm=mounted(preset("ur5e").arm, "ceiling"))
    assert usual_target(hanging).position == (1.6, 0.0, 0.0)


def test_places_become_targets():
    assert as_target(np.array([1.0, 2.0, 0.5])) == Target((1.0, 2.0, 0.5))
    target = Target((1.0, 2.0), 0.01)
    assert as_target(target) is target


@pytest.mark.parametrize(
    ("asked", "message"),
    [
        ({"direction": (0.0, 0.0)}, "direction: got .*a vector that is not zero"),
        ({"direction": (1.0, 0.0, 0.0)}, "direction: got .*2 finite numbers"),
        ({"direction": (1.0, float("nan"))}, "direction"),
        ({"direction": (1.0, 0.0), "cone": 0.0}, "cone: got 0.0; allowed: a finite number > 0"),
        ({"direction": (1.0, 0.0), "cone": 3.2}, "cone: got 3.2"),
        ({"speed": 0.0}, "least speed: got 0.0"),
        ({"sight": (0.0, 1.0)}, "line of sight: got .*None unless a direction"),
        ({"direction": (1.0, 0.0), "sight": (1.0, 1.0)}, "line of sight: got .*right angles"),
    ],
)  # fmt: skip
def test_bad_directions_cones_and_speeds_are_named(asked, message):
    with pytest.raises(InputError, match=f"^{message}"):
        Target((1.3, 0.0), **asked)


def test_a_direction_is_kept_as_a_unit_vector():
    target = Target((1.3, 0.0), direction=(3.0, -4.0), speed=5.0)
    assert target.direction == pytest.approx((0.6, -0.8))
    assert (
        repr(target) == "Target((1.3, 0) m, hit radius 0.06 m, within 10 degrees of (0.600, -0.800), at 5 m/s or more)"
    )
    np.testing.assert_allclose(target.goals.directions, [[0.6, -0.8]])
    assert target.goals.speed == 5.0


def test_an_arrival_angle_needs_an_upward_direction_across_the_line_of_sight():
    target = Target.arriving((1.3, 0.0, 0.0), np.pi / 2, cone=0.2, hit_radius=0.05)
    assert target.direction == pytest.approx((0.0, 1.0, 0.0), abs=1e-12)
    assert target.sight == (-1.0, 0.0, 0.0)
    assert (target.cone, target.hit_radius) == (0.2, 0.05)
    with pytest.raises(InputError, match="not straight above or below the base; give a direction"):
        Target.arriving((0.0, 0.0, 1.3), 0.0)


def test_no_tip_moves_outward_where_arm_and_whip_are_stretched():
    reach = SPACE.reach
    with pytest.raises(
        InputError, match=r"^direction: got .*at right angles to the line from the base, within the cone of 10 degrees"
    ):
        Target((reach, 0.0, 0.0), direction=(1.0, 0.3, 0.0)).check_reach(SPACE)
    Target((reach, 0.0, 0.0), direction=(0.1, 1.0, 0.0)).check_reach(SPACE)
    Target((reach - 0.01, 0.0, 0.0), direction=(1.0, 0.0, 0.0)).check_reach(SPACE)
    Target((reach, 0.0, 0.0), direction=(1.0, 0.0, 0.0), cone=np.pi / 2).check_reach(SPACE)  # asks for nothing


@pytest.mark.parametrize("angle", [60, -90.0, 400])
def test_an_arrival_angle_in_degrees_is_noticed(angle):
    with pytest.raises(InputError, match=r"^arrival angle: got .*are these degrees"):
        Target.arriving((1.3, 0), angle)
    assert Target.arriving((1.3, 0), np.radians(60)).direction == pytest.approx((0.5, 3**0.5 / 2))


def test_a_radius_in_millimetres_is_asked_about():
    for radius in (60.0, 12):
        with pytest.raises(InputError, match=r"^hit radius: got .*at most 10 m; .*are these millimetres\?$"):
            Target((1.2, 0.1), radius)
    with pytest.raises(InputError, match=r"^target: got \(1200\.0, 100\.0\).*are these millimetres\?$"):
        Target((1200, 100))
    reach = 0.31 + 0.34 + 12 * 0.072  # of the model, Tables 2 and 3
    farthest = reach + (1.2**2 + 0.5**2) ** 0.5
    Target((1.2, 0.5), farthest - 1e-6).check_fits(FLAT)
    with pytest.raises(InputError, match=r"^hit radius: got .* are these millimetres\?$"):
        Target((1.2, 0.5), farthest + 1e-6).check_fits(FLAT)


def test_a_third_number_is_no_hit_radius():
    with pytest.raises(InputError, match=r"^target: got \(1\.2, 0\.1, 0\.03\); .*a hit radius is given by its name$"):
        Target(1.2, 0.1, 0.03).check_fits(FLAT)
