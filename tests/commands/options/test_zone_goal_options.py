"""Options of what is asked of arrivals over a zone: what rule they build, and what they refuse."""

from __future__ import annotations

import math

import pytest

from whiptool.commands.options.zone_goal_options import ZoneGoalOptions
from whiptool.errors import InputError
from whiptool.goals.arrival_rule import ArrivalRule
from whiptool.models import preset


@pytest.mark.parametrize(
    ("options", "rule"),
    [
        ({}, ArrivalRule()),
        ({"direction": (0.0, 2.0), "cone": 30.0}, ArrivalRule(direction=(0.0, 1.0), cone=math.radians(30))),
        ({"arrival_angle": (30.0,)}, ArrivalRule(angle=math.radians(30))),
        ({"arrival_angle": (-180.0, 180.0)}, ArrivalRule(angle=(-math.pi, math.pi))),
        ({"least_speed": 3.0}, ArrivalRule(speed=3.0)),
    ],
)
def test_the_rule_that_options_ask_for(options, rule):
    given = ZoneGoalOptions(**options)
    given.check()
    assert given.build_arrival() == rule


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"cone": 20.0}, "--cone: got 20.0; allowed: only with --direction or --arrival-angle"),
        (
            {"direction": (1.0, 0.0), "arrival_angle": (1.0,)},
            "only without --direction",
        ),
        ({"arrival_angle": (90.0, 30.0)}, "--arrival-angle"),
        ({"arrival_angle": (0.0, 361.0)}, "one turn at most"),
        ({"arrival_angle": ()}, "--arrival-angle"),
    ],
)
def test_what_contradicts_itself_is_refused(options, said):
    with pytest.raises(InputError, match=said):
        ZoneGoalOptions(**options).check()


def test_a_direction_fits_the_model_and_the_middle_of_the_zone():
    """Where arm and whip are stretched no tip moves outward."""
    lemon = preset("lemon2024")
    assert ZoneGoalOptions(direction=(0.0, 1.0)).build_zone(lemon) == ZoneGoalOptions().build_zone(lemon)
    with pytest.raises(InputError, match="2 coordinates"):
        ZoneGoalOptions(direction=(0.0, 1.0, 0.0)).build_zone(lemon)
    at_reach = {"target": (lemon.reach, 0.0), "zone_radius": 0.01}
    with pytest.raises(InputError, match="stretched to their reach"):
        ZoneGoalOptions(direction=(1.0, 0.0), **at_reach).build_zone(lemon)
    ZoneGoalOptions(direction=(0.0, 1.0), **at_reach).build_zone(lemon)
