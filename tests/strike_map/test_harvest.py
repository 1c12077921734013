"""The harvest: each cell once, each answer a hit where it says so, only strikes that are worth it."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest
from planar_map import AIMED, POINTS, random_strikes, striker

from whiptool.goals.goals import arrival_angles
from whiptool.limits.arm_limits import ArmLimits
from whiptool.models.spatial_arm import JointLimits
from whiptool.strike_map.building import Harvest


def cells(answers, region) -> Counter:
    columns = answers.tips / (2 * region.hit_radius)
    if region is AIMED:
        angles = arrival_angles(answers.tips, answers.velocities)
        columns = np.column_stack([columns, angles / (2 * region.rule.cone)])
    return Counter(map(tuple, np.floor(columns).astype(int).tolist()))


@pytest.mark.parametrize("region", [AIMED, POINTS], ids=["aimed", "points"])
def test_answers_hit_what_they_say_and_fill_each_cell_but_once(region):
    one = striker()
    harvest = Harvest(one, region, np.random.default_rng(0))
    found = harvest.pick(random_strikes(one, 400), room=1)
    assert len(found) > 60
    assert max(cells(found, region).values()) == 1
    assert region.zone.contains(found.tips).all()
    goals = region.goals_of(found.tips, found.velocities)
    struck = one.strike(found.strikes, goals)
    assert struck.hit.mean() > 0.98  # another branch of the path may pass nearer
    assert np.median(struck.distance) < 1e-3
    passages = Counter(map(tuple, found.strikes.tolist()))
    assert min(passages.values()) >= 4


def test_what_was_counted_leaves_no_room_and_more_room_is_used():
    one = striker()
    strikes = random_strikes(one, 300)
    first = Harvest(one, POINTS, np.random.default_rng(0)).pick(strikes, room=1)
    later = Harvest(one, POINTS, np.random.default_rng(0))
    later.count(first)
    assert len(later.pick(strikes, room=1)) == 0
    assert max(cells(later.pick(strikes, room=2), POINTS).values()) == 1  # beside the one that was counted


def test_strikes_beyond_the_limits_are_left_out():
    weak = ArmLimits((JointLimits(torque=1e-3),) * 2)
    one = striker(weak)
    assert len(Harvest(one, POINTS, np.random.default_rng(0)).pick(random_strikes(one, 50), room=1)) == 0
