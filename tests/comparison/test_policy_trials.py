"""Trials of a policy at several radii, against sines."""

from __future__ import annotations

import numpy as np
import pytest
from fake_rollout import StraightFlight
from scripted import Scripted

from whiptool.comparison.learner_unit import trials_within
from whiptool.goals.arrival_rule import ArrivalRule
from whiptool.goals.zone import Disc
from whiptool.models.strike import StrikeBounds
from whiptool.rl.task import StrikeTask

BOUNDS = StrikeBounds((-1.0, 0.0, 0.1, 0.2, 1.0), (1.0, 0.5, 0.3, 0.8, 2.0))
TARGETS = np.array([[1.0, 0.0], [np.cos(0.5), np.sin(0.5)], [np.cos(0.9), np.sin(0.9)]])


def recorded(radius: float) -> StrikeTask:
    return StrikeTask(StraightFlight(), Disc((0.8, 0.2), 1.0), bounds=BOUNDS, hit_radius=radius)


def test_trials_of_a_policy_at_several_radii():
    """Targets at 0, 0.5 and 0.9 rad; samples at -0.3, 0.45, 0.8, 0.89 rad: misses are sines of the difference."""
    angles = [-0.3, 0.45, 0.8, 0.89]
    radii = (0.2, 0.06, 0.02)
    task = recorded(0.02)
    found = trials_within(Scripted(task, angles), task, TARGETS, radii, cap=4, convention="samples")
    for radius, (trials, hit) in found.items():
        for i, at in enumerate((0.0, 0.5, 0.9)):
            misses = [np.sin(abs(at - angle)) for angle in angles]
            within = [n for n, miss in enumerate(misses, 1) if miss <= radius]
            assert trials[i] == (within[0] if within else 4)
            assert hit[i] == bool(within)


def test_trials_at_several_radii_where_a_direction_is_asked_for():
    """The same flights at the same targets; the second one is to be passed at 0.8 rad, within 0.2 rad."""
    angles, wanted = [-0.3, 0.45, 0.8, 0.89], np.array([0.0, 0.8, 0.9])
    radii = (0.4, 0.2, 0.06)
    rule, zone = ArrivalRule(angle=(-1.0, 1.0), cone=0.2), Disc((0.8, 0.2), 1.0)
    task = StrikeTask(StraightFlight(), zone, bounds=BOUNDS, arrival=rule, hit_radius=0.06)
    goals = rule.goals_at(TARGETS, 0.4, wanted)
    found = trials_within(Scripted(task, angles), task, goals, radii, cap=4, convention="samples")
    for radius, (trials, hit) in found.items():
        for i, at in enumerate((0.0, 0.5, 0.9)):
            hits = [
                number
                for number, angle in enumerate(angles, 1)
                if np.sin(abs(at - angle)) <= radius and abs(angle - wanted[i]) <= 0.2
            ]
            assert trials[i] == (hits[0] if hits else 4)
            assert hit[i] == bool(hits)
    assert found[0.4][1].tolist() == [False, True, True]
    assert found[0.06][1].tolist() == [False, False, True]


class Low:
    """The first angle may be 0.6 at most, which peaks tell or only the whole strike."""

    judges, by_peaks, command, positions, smooth = "motor", True, None, None, ()

    def __init__(self, *, whole: bool) -> None:
        self.of_candidates = whole

    def violation_of_peaks(self, near):
        return np.full(len(near.distance), -1.0) if self.of_candidates else near.max_joint_speed[:, 0] - 0.6

    def violation(self, strike):
        return strike.vector[0] - 0.6


class Following(StraightFlight):
    def trajectory(self, strike, *, t_stay):
        return strike


@pytest.mark.parametrize("whole", [False, True])
def test_a_strike_that_the_limits_refuse_is_a_hit_at_no_radius(whole):
    """Of samples at -0.3, 0.45, 0.8 and 0.89 rad the last two are refused, which alone pass the target at 0.9 rad."""
    limits, zone = Low(whole=whole), Disc((0.8, 0.2), 1.0)
    task = StrikeTask(Following(), zone, bounds=BOUNDS, hit_radius=0.02, limits=limits)
    found = trials_within(
        Scripted(task, [-0.3, 0.45, 0.8, 0.89]), task, TARGETS, (0.2, 0.02), cap=4, convention="samples"
    )
    assert found[0.2][1].tolist() == [False, True, False]
    assert found[0.02][1].tolist() == [False, False, False]
