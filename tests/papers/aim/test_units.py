"""Work units of aimed strikes: names that tell them apart, strikes counted to the first hit, MuJoCo's replay."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

pytest.importorskip("torch")

from papers.aim import units
from papers.aim.task import ur5e
from papers.aim.units import (
    Counting,
    KeptMap,
    MissedUnit,
    ReplayUnit,
    by_candidates,
    by_refinement,
    plain,
)
from whiptool.goals.goals import Goals
from whiptool.impedance import Controller, oiac_preset
from whiptool.limits.arm_limits import limits_preset
from whiptool.limits.clearance import Clearance
from whiptool.models import preset
from whiptool.rollout import CompiledRollout
from whiptool.strike_map.strike_map import Candidates
from whiptool.strike_map.striker import Landings, Striker

TASK = ur5e(quick=True)
GOAL = Goals(np.array([[0.3, 0.0]]), 0.1)


class LineStriker:
    """A strike is the place where the tip passes."""

    rollout, bounds, limits, t_stay = None, None, None, 0.3
    lower, upper, widths = np.full(2, -1.0), np.full(2, 1.0), np.full(2, 2.0)

    def judged(self, strikes: np.ndarray, landings: Landings) -> Landings:
        return landings

    def strike(self, strikes: np.ndarray, goals: Goals) -> Landings:
        return self.land(strikes, goals)

    def land(self, strikes: np.ndarray, goals: Goals) -> Landings:
        left = strikes - goals.positions
        distance = np.linalg.norm(left, axis=1)
        hit = distance <= goals.hit_radius
        return Landings(left, distance, np.full(len(strikes), np.nan), np.full(len(strikes), -1.0), hit)


def a_map(*places: float) -> Any:
    """A map whose candidates pass these places, and say that a strike moves the tip the wrong way."""
    strikes = np.array([[x, 0.0] for x in places])
    some = np.zeros(len(strikes))
    found = Candidates(strikes, np.tile(-np.eye(2), (len(strikes), 1, 1)), np.zeros((len(strikes), 3)), some)
    return SimpleNamespace(striker=LineStriker(), candidates=lambda goal: found)


def test_results_of_a_map_are_found_again_when_its_folder_was_moved():
    here = MissedUnit(task=TASK, kept=KeptMap(folder=Path("map"), label="one"), goal=8)
    assert replace(here, kept=KeptMap(folder=Path("moved"), label="one")).key == here.key
    assert replace(here, kept=KeptMap(folder=Path("map"), label="another")).key != here.key


def test_candidates_are_struck_one_after_the_other():
    assert by_candidates(a_map(0.0, 0.9, 0.35, 0.3), GOAL) == {"trials": 3, "hit": True}
    assert by_candidates(a_map(0.35), GOAL) == {"trials": 1, "hit": True}
    assert by_candidates(a_map(0.0, 0.9), GOAL) == {"trials": 2, "hit": False}
    assert by_candidates(a_map(*[0.0] * 19, 0.3, 0.35), GOAL) == {"trials": 20, "hit": True}  # more than at once


def test_a_hit_keeps_all_limits_unless_collisions_are_left_aside():
    clear, free = ur5e(), ur5e(clear=False)
    assert clear.name != free.name  # results of one are none of the other
    assert [x.judges for x in clear.striker(1).limits.members] == ["joint", "clearance"]
    assert [x.judges for x in free.striker(1).limits.members] == ["joint"]
    of_floor = clear.striker(1).limits.members[1]
    assert isinstance(of_floor, Clearance)
    assert of_floor.floor == -1.7


class CountedLine(LineStriker):
    """Counts what `Counting` counts, and derivatives are right."""

    def derivatives(self, strikes: np.ndarray, goals: Goals) -> np.ndarray:
        return np.tile(np.eye(2), (len(strikes), 1, 1))


def test_corrections_are_counted_to_the_first_hit(monkeypatch):
    """Where derivatives are wrong, strikes get worse until right ones are taken, which count two: one a number."""

    class Counted(Counting):
        def __init__(self, striker):
            self.inner, self.count, self.hit = CountedLine(), 0, False
            for name in ("lower", "upper", "widths"):
                setattr(type(self), name, getattr(self.inner, name))

        def admissible(self, strikes):
            return strikes

    monkeypatch.setattr(units, "Counting", Counted)
    monkeypatch.setattr(units.Striker, "land", lambda self, strikes, goals: self.inner.land(strikes, goals))
    monkeypatch.setattr(units.Striker, "judged", lambda self, strikes, landings: landings)
    monkeypatch.setattr(
        units.Striker, "derivatives", lambda self, strikes, goals: self.inner.derivatives(strikes, goals)
    )
    assert by_refinement(a_map(0.3), GOAL) == {"trials": 1, "hit": True}
    wrong = by_refinement(a_map(0.9), GOAL)
    assert wrong["hit"]
    assert 3 <= wrong["trials"] <= 10
    right = a_map(0.9)
    right.candidates(GOAL).slopes[:] = np.eye(2)
    assert by_refinement(right, GOAL) == {"trials": 2, "hit": True}


def test_what_strikes_came_to_is_plain_data():
    struck = Landings(
        np.zeros((2, 3)),
        np.array([0.01, np.nan]),
        np.array([0.1, np.nan]),
        np.array([-0.2, np.inf]),
        np.array([True, False]),
    )
    table = json.loads(json.dumps(plain(struck), allow_nan=False))
    assert table == {"hit": [True, False], "miss": [0.01, None], "angle": [0.1, None], "within": [True, False]}


def test_a_strike_is_where_mujoco_has_it(monkeypatch):
    """A short strike of the robot, and a goal that is where its tip passes; another angle is no hit."""
    striker = TASK.striker(1)
    strike = np.r_[0, -1.5, 1.0, 0, 0.5, 0, 0.3, -0.5, 0.5, 0.2, 0.5, 0, 0.4]
    path = striker.rollout.trajectory(strike, t_stay=0.0)
    place, velocity = path.tip[-1], path.tip_velocity[-1]
    angle = TASK.region.angles(place[None], velocity[None])
    assert angle is not None
    monkeypatch.setattr(units, "MUJOCO_STEP", 2e-3)
    for turn, hit in ((0.0, True), (1.0, False)):
        goals = TASK.region.rule.goals_at(place[None], 0.05, angle + turn)
        pretended: Any = SimpleNamespace(
            name="short", model=TASK.model, controller=TASK.controller, t_stay=0.0, goals=lambda goals=goals: goals
        )
        seen = ReplayUnit(task=pretended, goal=0, strike=tuple(strike.tolist())).run(None, None)
        assert seen["hit"] == hit
        assert seen["miss"] < 2e-3
        assert seen["angle"] == pytest.approx(turn, abs=0.02)


def test_what_refinement_missed_is_given_to_other_searches(monkeypatch):
    """Of a goal in the plane that the gradient search reaches, and of one that nothing can reach in so few rollouts."""
    model = preset("lemon2024")
    rollout = CompiledRollout(model, Controller(oiac_preset("table4")))
    striker = Striker(rollout)
    middle = np.array([(striker.lower + striker.upper) / 2])
    tried: list[int] = []

    def refined(goal: Goals, *, tried_at_most: int) -> Any:
        tried.append(tried_at_most)
        return SimpleNamespace(strikes=middle, struck=striker.strike(middle, goal))

    strike_map = SimpleNamespace(striker=striker, refined=lambda goal, tried: refined(goal, tried_at_most=tried))
    monkeypatch.setattr(MissedUnit, "opened", lambda self, threads: strike_map)
    for place, radius, hit in (((1.3, 0.0), 0.05, True), ((1.2, 0.5), 1e-9, False)):
        goals = Goals(np.array([place]), radius)
        task: Any = SimpleNamespace(name="toy", goals=lambda goals=goals: goals)
        unit = MissedUnit(task=task, kept=KeptMap(Path("map"), "one"), goal=0, brief=True)
        found = json.loads(json.dumps(unit.run(None, None), allow_nan=False))["found"]
        assert found[0]["search"] == "candidates"
        assert found[-1]["hit"] == hit
        assert not any(x["hit"] for x in found[:-1])
        if not hit:
            assert [x["search"] for x in found] == ["candidates", "gradient", "cmaes"]
        for x in found:  # what is kept is the strike that came to this
            assert striker.strike(np.array([x["strike"]]), goals).distance[0] == pytest.approx(x["miss"], abs=1e-12)
    assert tried == [8, 8]
    limited = Counting(Striker(rollout, limits=limits_preset("xm430")))
    assert [x.words for x in limited.limits.members] == [limits_preset("xm430").words]
