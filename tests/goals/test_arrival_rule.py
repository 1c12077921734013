"""What is asked of the tip's arrival over a zone: drawn directions, refused targets, words."""

from __future__ import annotations

import math

import numpy as np
import pytest

from whiptool.errors import InputError
from whiptool.goals.arrival_rule import ArrivalRule, sample_goals
from whiptool.goals.target import Target
from whiptool.goals.zone import Disc, sample
from whiptool.models import preset

PLACES = np.array([[1.0, 0.2], [0.8, -0.3], [1.2, 0.5]])
IN_SPACE = np.array([[1.0, 0.2, 0.3], [0.8, -0.3, 0.1], [1.2, 0.5, -0.4]])


def test_one_direction_of_all_targets():
    goals = ArrivalRule(direction=(3.0, 4.0), cone=0.2, speed=2.0).goals_at(PLACES, 0.05)
    np.testing.assert_allclose(goals.directions, np.tile([0.6, 0.8], (3, 1)))
    assert (goals.cone, goals.speed, goals.hit_radius, goals.sights) == (0.2, 2.0, 0.05, None)
    points = ArrivalRule()
    assert points.only_points
    assert points.goals_at(PLACES, 0.05).only_points
    fast = ArrivalRule(speed=3.0)
    assert not fast.only_points
    assert not fast.directed
    assert fast.goals_at(PLACES, 0.05).directions is None


@pytest.mark.parametrize("places", [PLACES, IN_SPACE])
def test_angles_are_those_of_targets_with_arrival_angles(places):
    """One for all, or drawn from a range: the middle of the numbers is the middle of the range, its ends the ends."""
    low, high = math.radians(150), math.radians(210)
    drawn, fixed = ArrivalRule(angle=(low, high)), ArrivalRule(angle=2.5)
    goals = drawn.goals(places, 0.06, np.array([[0.0], [0.5], [1.0]]))
    for i, angle in enumerate((high, math.pi, low)):
        wanted = Target.arriving(places[i], angle)
        np.testing.assert_allclose(Target.of(goals, i).direction, wanted.direction, atol=1e-12)
        assert (Target.of(goals, i).sight is None) == (wanted.sight is None) == (len(places[0]) == 2)
        one = Target.of(fixed.goals_at(places, 0.06), i)
        np.testing.assert_allclose(one.direction, Target.arriving(places[i], 2.5).direction, atol=1e-12)
    assert (drawn.drawn, fixed.drawn) == (1, 0)


def test_drawn_angles_fill_their_range_and_nothing_else():
    rule, zone = ArrivalRule(angle=(0.5, 2.0)), Disc()
    goals = sample_goals(zone, rule, 0.06, 4000, np.random.default_rng(0))
    assert goals.directions is not None
    angles = np.arctan2(goals.directions[:, 1], goals.directions[:, 0])
    counts, _ = np.histogram(angles, 10, (0.5, 2.0))
    assert counts.sum() == 4000
    assert abs(counts - 400).max() < 80
    np.testing.assert_array_equal(goals.positions, sample(zone, 4000, np.random.default_rng(0)))  # as of points alone


def test_angles_are_brought_into_the_range():
    rule = ArrivalRule(angle=(math.radians(150), math.radians(210)))
    given = np.radians([160, -160, -140, 100, 30.1, 29.9, 520])
    np.testing.assert_allclose(np.degrees(rule.within(given)), [160, 200, 210, 150, 150, 150, 160])
    turn = ArrivalRule(angle=(-math.pi, math.pi))
    np.testing.assert_allclose(turn.within(np.array([3.0, -3.0, 4.0])), [3.0, -3.0, 4.0 - 2 * math.pi])


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"direction": (0.0, 0.0)}, "direction: got .* not zero"),
        ({"direction": (1.0,)}, "two coordinates"),
        ({"direction": (1.0, math.nan)}, "direction"),
        ({"direction": (1.0, 0.0), "angle": 1.0}, "not both"),
        ({"angle": (2.0, 1.0)}, "arrival angle"),
        ({"angle": (0.0, 7.0)}, "one turn"),
        ({"angle": (0.0, 1.0, 2.0)}, "arrival angle"),
        ({"angle": math.inf}, "arrival angle"),
        ({"cone": 0.0}, "cone"),
        ({"speed": 0.0}, "least speed"),
    ],
)
def test_rules_that_are_none_are_refused(options, said):
    with pytest.raises(InputError, match=said):
        ArrivalRule(**options)


def test_a_rule_has_the_dimension_of_its_model():
    with pytest.raises(InputError, match=r"direction: got .* 3 coordinates"):
        ArrivalRule(direction=(1.0, 0.0)).check_dimension(preset("ur5e"))
    ArrivalRule(direction=(1.0, 0.0, 0.0)).check_dimension(preset("ur5e"))
    ArrivalRule(angle=1.0).check_dimension(preset("ur5e"))


def test_targets_that_ask_for_what_the_rule_asks_for_are_taken():
    """Also with another cone and hit radius, less speed, and, of one direction, with none named."""
    one = ArrivalRule(direction=(0.0, 1.0), speed=3.0)
    for target in (Target((1.0, 0.2)), Target((1.0, 0.2), 0.01, direction=(0.0, 5.0), cone=0.1, speed=2.0)):
        goals = one.goal_of(target)
        np.testing.assert_allclose(goals.directions, [[0.0, 1.0]])
        assert goals.speed == 3.0
    drawn = ArrivalRule(angle=(math.radians(150), math.radians(210)))
    for place in ((1.0, 0.2), (1.0, 0.2, 0.3)):
        target = Target.arriving(place, math.radians(-160))  # 200 degrees
        np.testing.assert_allclose(drawn.goal_of(target).directions[0], target.direction, atol=1e-12)


@pytest.mark.parametrize(
    ("rule", "target", "said"),
    [
        (ArrivalRule(), Target((1.0, 0.2), direction=(1.0, 0.0)), "direction: got .* made for points alone"),
        (
            ArrivalRule(),
            Target((1.0, 0.2), speed=1.0),
            "least speed: got '1 m/s'; allowed: none, because the policy or map was made without one",
        ),
        (ArrivalRule(speed=2.0), Target((1.0, 0.2), speed=2.1), "least speed: got .2.1 m/s.; allowed: at most 2 m/s"),
        (ArrivalRule(direction=(0.0, 1.0)), Target((1.0, 0.2), direction=(0.01, 1.0)), r"allowed: \(0, 1\), for which"),
        (ArrivalRule(angle=(0.0, 1.0)), Target((1.0, 0.2)), r"direction: got nothing; allowed: .*Target.arriving"),
        (ArrivalRule(angle=(0.0, 1.0)), Target.arriving((1.0, 0.2), 1.01), "angles from 0 to 57.2958 degrees"),
        (ArrivalRule(angle=0.5), Target.arriving((1.0, 0.2), 0.6), "for which the policy or map was made"),
        (ArrivalRule(angle=(-3.0, 3.0)), Target((1.0, 0.2, 0.0), direction=(1.0, 0.0, 0.5)), "Target.arriving"),
        (ArrivalRule(angle=(-3.0, 3.0)), Target((1.0, 0.0, 0.0), direction=(0.0, 0.0, 1.0)), "Target.arriving"),
    ],
)
def test_targets_that_ask_for_more_than_was_learned_are_refused(rule, target, said):
    """The last: all of the velocity counts there, and what was learned leaves out motion along the line of sight."""
    with pytest.raises(InputError, match=said) as refused:
        rule.goal_of(target)
    assert "\n" not in str(refused.value)


def test_rules_in_words_and_as_data():
    assert str(ArrivalRule()) == "arriving in any way"
    assert ArrivalRule().table() is None
    rule = ArrivalRule(angle=(math.radians(60), math.radians(120)), cone=math.radians(15), speed=2.5)
    assert (
        str(rule)
        == "arriving within 15 degrees of a random angle for each target, from 60 to 120 degrees, at 2.5 m/s or more"
    )
    assert rule.table() == {
        "direction": None,
        "arrival_angle": [rule.angle[0], rule.angle[1]],
        "cone": math.radians(15),
        "least_speed": 2.5,
    }
    assert str(ArrivalRule(direction=(0.0, 2.0))) == "arriving within 10 degrees of (0.000, 1.000)"
    assert ArrivalRule(speed=1.0).table() == {
        "direction": None, "arrival_angle": None, "cone": None, "least_speed": 1.0,
    }  # fmt: skip
