"""Joint space beside hand space: units, the table, and one target that both robots hit in both spaces."""

from __future__ import annotations

from itertools import product
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

pytest.importorskip("torch")

from papers.aim import spaces
from papers.aim.spaces import (
    METHODS,
    RADIUS,
    ROBOTS,
    SPACES,
    SpaceStudy,
    SpaceUnit,
    targets,
)
from whiptool.impedance import Controller, PositionControl
from whiptool.limits.arm_limits import ArmLimits
from whiptool.models import preset
from whiptool.rollout import CompiledRollout, ReferenceRollout

STRIKES = {  # at the second target, as the search with gradients found them
    ("ur5e", "joint"): [3.0697, 1.6028, -0.8739, 0.8932, -0.7503, -0.7446,
                        1.6213, 0.1131, -0.0736, 2.3637, -1.3242, 0.7417, 0.8891],
    ("ur5e", "hand"): [0.4954, 0.9438, 0.8821, 0.8863, -0.4129, 0.7301, 0.6399],
    ("panda", "joint"): [2.4537, -1.1684, -0.8761, -2.3269, -0.433, 3.5674, 1.2017,
                         1.9287, -1.1221, -0.774, -1.5408, 0.6255, 2.469, 0.1795, 0.8113],
    ("panda", "hand"): [0.9432, 0.052, 0.9003, 0.6172, 0.7389, 1.0896, 0.5965],
}  # fmt: skip


class Answers:
    """A store whose units found what is made up: the hand needs half the trials, SAC hits the first target alone."""

    def results(self, units, *, desc: str = "") -> dict[str, dict[str, Any]]:
        found = {}
        for unit in units:
            hit = unit.method != "sac" or unit.target == 0
            trials = (20 if unit.space == "joint" else 10) + 2 * unit.target if hit else unit.cap
            found[unit.key] = {"hit": hit, "trials": trials, "refused": trials // 2, "wall_time": 1.0}
        return found


def study(count: int = 3) -> SpaceStudy:
    return SpaceStudy.of(cast(Any, Answers()), count, 40)


def test_targets_are_in_the_shell_and_the_first_ones_the_same_however_many_there_are():
    points = targets(50)
    distance = np.linalg.norm(points, axis=1)
    assert ((distance >= 0.9) & (distance <= 1.6) & (points[:, 0] >= 0) & (points[:, 2] >= 0)).all()
    np.testing.assert_array_equal(points[:7], targets(7))


def test_the_summary_counts_what_units_found():
    numbers = study().summary()
    of_hand = numbers["panda"]["hand"]["directl"]
    assert of_hand == {"hits": 3, "median_trials": 12, "mean_trials": 12, "refused": 0.5, "median_seconds": 1.0}
    of_sac = numbers["ur5e"]["joint"]["sac"]
    assert (of_sac["hits"], of_sac["median_trials"], of_sac["mean_trials"]) == (1, 40, pytest.approx(100 / 3))
    assert numbers["ur5e"]["hit_in_all_spaces"] == numbers["hit_in_all_spaces_by_all_robots"] == 3


def test_a_target_that_one_robot_misses_in_one_space_is_not_hit_everywhere():
    found = study()
    for method in METHODS:
        unit = SpaceUnit(robot="panda", space="hand", method=method, target=1, cap=40)
        found.found[unit.key]["hit"] = False
    assert found.hit_everywhere().tolist() == [True, False, True]
    assert found.summary()["panda"]["hit_in_all_spaces"] == 2
    assert found.summary()["ur5e"]["hit_in_all_spaces"] == 3


def test_the_table_has_a_row_for_each_robot_and_search_and_tells_how_many_numbers_a_strike_has():
    head, *rows = study().table()
    assert [row[:2] for row in rows] == [list(x) for x in product(ROBOTS, METHODS)]
    assert head[2].startswith("joint (13, 15)")
    assert head[5].startswith("hand (7, 7)")
    assert rows[0][2:] == ["3 of 3", "22 (22)", "50%", "3 of 3", "12 (12)", "50%"]


def test_the_report_says_how_many_targets_are_hit_in_both_spaces(monkeypatch):
    monkeypatch.setattr(spaces, "QUICK_TARGETS", 3)
    section = spaces.sections(cast(Any, SimpleNamespace(store=Answers(), quick=True)))[0]
    assert "Of 3 targets 3 are hit" in section.parts[0].text


@pytest.mark.parametrize(("robot", "space"), STRIKES)
def test_the_same_target_is_hit_in_both_spaces_by_both_robots_within_their_limits(robot, space):
    model, strike, target = preset(robot), np.array(STRIKES[robot, space]), targets(2)[1]
    controller = Controller(PositionControl(), hand=SPACES[space])
    near = CompiledRollout(model, controller, timestep=1.5e-3, engine="interpreter").approach(strike, target)
    assert near.distance[0] <= RADIUS
    assert ArmLimits.of(model.arm, prescribed=True).violation_of_peaks(near)[0] <= 0
    if (robot, space) == ("panda", "hand"):
        path = ReferenceRollout(model, controller, timestep=1e-3).trajectory(strike)
        assert path.approach(target).distance[0] == pytest.approx(near.distance[0], abs=1e-5)
