"""A small map of the published whip: built, kept, asked; and regions, plans and strikers by their rules."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

torch = pytest.importorskip("torch")

from planar_map import AIMED, POINTS, random_strikes, striker  # noqa: E402

from whiptool.errors import InputError  # noqa: E402
from whiptool.goals.target import Target  # noqa: E402
from whiptool.goals.zone import Disc  # noqa: E402
from whiptool.limits.arm_limits import ArmLimits  # noqa: E402
from whiptool.models.spatial_arm import JointLimits  # noqa: E402
from whiptool.objective import Objective  # noqa: E402
from whiptool.strike_map import Answers, Building, GoalRegion, MapPlan, StrikeMap  # noqa: E402
from whiptool.strike_map.map_files import GATE, load_gate, load_parts, part_file, save_gate, save_part  # noqa: E402

PLAN = MapPlan(random_strikes=600, room=1, rounds=1, goals=24, gate_strikes=200)


@pytest.fixture(scope="module")
def building() -> Building:
    return Building(striker(), AIMED, PLAN, seed=0)


@pytest.fixture(scope="module")
def parts(building: Building) -> list[Answers]:
    found: list[Answers] = []
    while len(found) < PLAN.parts:
        found.append(building.part(found))
    return found


@pytest.mark.slow
def test_it_answers_goals_that_it_has_not_seen(building, parts):
    made = StrikeMap(building.striker, AIMED, Answers.joined(parts))
    goals = AIMED.draw(20, np.random.default_rng(9))
    first = building.striker.strike(made.strikes(goals), goals)
    refined = made.refined(goals)
    random = building.striker.strike(random_strikes(building.striker, 400), AIMED.draw(400, np.random.default_rng(3)))
    assert first.hit.mean() > 5 * random.hit.mean()
    assert refined.struck.hit.sum() >= first.hit.sum()
    again = building.striker.strike(refined.strikes, goals)
    np.testing.assert_array_equal(again.hit, refined.struck.hit)
    np.testing.assert_allclose(again.distance, refined.struck.distance)
    assert np.median(refined.struck.distance[refined.struck.hit]) < 1e-3


def test_a_hit_that_stalled_is_tried_from_the_next_candidate(building, parts, monkeypatch):
    """Were the first candidate not refined at all, others would come nearer than where it hits."""
    from whiptool.strike_map import strike_map as module

    made = StrikeMap(building.striker, AIMED, Answers.joined(parts))
    drawn = AIMED.draw(30, np.random.default_rng(9))
    goals = drawn.rows(np.flatnonzero(building.striker.strike(made.strikes(drawn), drawn).hit)[:4])
    plain, turns = module.refine, []

    def stalled(striker, goals, strikes, slopes):
        turns.append(len(strikes))
        return plain(striker, goals, strikes, slopes, steps=0 if len(turns) == 1 else 30)

    monkeypatch.setattr(module, "refine", stalled)
    found = made.refined(goals)
    first = building.striker.strike(made.strikes(goals), goals)
    assert first.hit.all()
    assert found.struck.hit.all()
    assert len(turns) > 1
    assert np.median(found.struck.cost) < 1e-4 < np.median(first.cost)


def test_hits_are_those_of_the_objective(building, parts):
    made = StrikeMap(building.striker, AIMED, Answers.joined(parts))
    goals = AIMED.draw(12, np.random.default_rng(4))
    struck = building.striker.strike(made.strikes(goals), goals)
    for i, strike in enumerate(made.strikes(goals)):
        target = Target.of(goals, i)
        outcome = Objective(building.striker.rollout, target)(strike)
        assert outcome.hit == struck.hit[i]
        assert outcome.miss_distance == pytest.approx(struck.distance[i])
        assert outcome.cost == pytest.approx(struck.cost[i])


@pytest.mark.slow
def test_a_part_is_the_same_whenever_it_is_made(building, parts):
    again = building.part(parts[:1])
    for name in ("strikes", "tips", "tip_slopes"):
        np.testing.assert_array_equal(getattr(again, name), getattr(parts[1], name))


def test_practice_adds_what_was_missed(building, parts):
    """Goals of the round itself are hit more often afterwards."""
    rng = np.random.default_rng([0, 1])
    from whiptool.strike_map.building import Harvest

    Harvest(building.striker, AIMED, rng)  # draws what the round draws first
    goals = AIMED.draw(PLAN.goals, rng)
    before, after = (
        building.striker.strike(StrikeMap(building.striker, AIMED, Answers.joined(some)).strikes(goals), goals).hit
        for some in (parts[:1], parts)
    )
    assert after.sum() > before.sum()


def test_no_goals_have_no_strikes(building, parts):
    made, none = StrikeMap(building.striker, AIMED, Answers.joined(parts)), AIMED.draw(0, np.random.default_rng(0))
    refined = made.refined(none)
    assert made.strikes(none).shape == made.kept(none).shape == refined.strikes.shape == (0, 5)
    assert refined.struck.hit.shape == (0,)
    assert refined.rollouts == refined.derivatives == 0


def test_practice_of_goals_that_are_all_hit_adds_nothing(parts):
    """So it is of whips and regions that are easy: `whiptool map build` of the usual one, for instance."""
    anywhere = GoalRegion(AIMED.zone, hit_radius=5.0)  # whatever is struck, the target is hit
    building = Building(striker(), anywhere, PLAN, seed=0)
    assert len(building.part(parts[:1])) == 0


def test_it_is_kept_as_arrays(building, parts, tmp_path: Path):
    for number, part in enumerate(parts):
        save_part(tmp_path, number, part)
    gate = building.gate(Answers.joined(parts))
    save_gate(tmp_path, gate)
    loaded, kept = load_parts(tmp_path, PLAN.parts), load_gate(tmp_path)
    assert kept is not None
    goals = AIMED.draw(5, np.random.default_rng(2))
    first, second = (
        StrikeMap(building.striker, AIMED, Answers.joined(some), one) for some, one in ((parts, gate), (loaded, kept))
    )
    np.testing.assert_array_equal(first.strikes(goals), second.strikes(goals))
    part_file(tmp_path, 0).write_bytes(b"no zip")
    (tmp_path / GATE).write_bytes(b"")
    with pytest.raises(InputError, match=r"answers-000\.npz: got .*whole NPZ"):
        load_parts(tmp_path, PLAN.parts)
    with pytest.raises(InputError, match=r"gate\.npz: got .*empty"):
        load_gate(tmp_path)
    assert load_gate(tmp_path / "elsewhere") is None


def test_a_gate_chooses(building, parts):
    class Contrary:
        def odds(self, seen):
            return np.arange(len(seen), dtype=float)

    goal = AIMED.draw(1, np.random.default_rng(5))
    made = StrikeMap(building.striker, AIMED, Answers.joined(parts))
    other = StrikeMap(building.striker, AIMED, Answers.joined(parts), Contrary())
    np.testing.assert_array_equal(other.candidates(goal).strikes, made.candidates(goal).strikes[::-1])


def test_targets_that_it_was_not_built_for_are_refused(building, parts):
    made = StrikeMap(building.striker, AIMED, Answers.joined(parts))
    with pytest.raises(InputError, match=r"a target in the map's region, a disc of radius 0.2 m around \(1.3, 0\) m"):
        made.strike(Target.arriving((0.2, 0.1), 0.3))
    with pytest.raises(InputError, match="2 coordinates"):
        made.strike(Target((1.3, 0.0, 0.1)))
    with pytest.warns(UserWarning, match="none of the map.s strikes hits within the limits"):
        made.strike(Target((1.3, 0.0), speed=300.0))
    strike = made.strike(Target.arriving((1.3, 0.05), 1.0, speed=1.0), refined=False)
    assert building.striker.inside(strike.vector[None]).all()


def test_a_goal_may_leave_the_direction_open(building, parts):
    """The gate, which was trained on goals with directions, is then not asked."""
    gate: Any = SimpleNamespace(odds=None)
    made = StrikeMap(building.striker, AIMED, Answers.joined(parts), gate)
    strike = made.strike((1.3, 0.0))
    assert building.striker.rollout.approach(strike.vector[None], (1.3, 0.0)).distance[0] < AIMED.hit_radius


def test_a_region_that_no_strike_passes_is_refused():
    nowhere = GoalRegion(Disc((1.5139, 0.0), 1e-4), hit_radius=1e-5)
    with pytest.raises(InputError, match="zone"):
        Building(striker(), nowhere, MapPlan(random_strikes=50), seed=0).part([])


@pytest.mark.parametrize("name", ["random_strikes", "room", "goals", "per_goal"])
def test_a_plan_has_at_least_one_of_each(name):
    with pytest.raises(InputError, match=name):
        MapPlan(**{name: 0})
    assert MapPlan(random_strikes=2049).random_parts == 2


def test_a_strike_beyond_the_limits_costs_more_and_is_no_hit():
    free = striker()
    strikes = random_strikes(free, 30)
    near = free.rollout.approach(strikes, np.array([1.3, 0.0]))
    goals = POINTS.rule.goals_at(near.tip, 0.02)
    assert free.strike(strikes, goals).hit.all()
    tight = striker(ArmLimits((JointLimits(torque=1e-3),) * 2))
    beyond = tight.strike(strikes, goals)
    assert not beyond.hit.any()
    assert (beyond.beyond > 0).all()
    np.testing.assert_allclose(beyond.cost, free.strike(strikes, goals).cost + beyond.beyond)


def test_goals_of_passages_are_reached_by_them():
    rng = np.random.default_rng(0)
    tips, velocities = AIMED.zone.place(rng.random((50, 3))), 5 * rng.normal(size=(50, 2))
    goals = AIMED.goals_of(tips, velocities)
    assert (goals.angle(velocities) < 1e-7).all()
    assert (goals.cost(np.zeros(50), velocities)[np.linalg.norm(velocities, axis=1) > 1] < 1e-9).all()
    assert POINTS.goals_of(tips, velocities).directions is None
    assert POINTS.angles(tips, velocities) is None
