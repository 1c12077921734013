"""Unknown ropes on a robot in space, one wiggle, then one strike a goal: the units of `reproduce adapt --space`.

The owner of a rope knows what it is made of, and nothing else of it. A wiggle is chosen once for a material; what
motion capture saw of it is what a strike at each goal is planned from.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from papers.aim.robot import CONTROLLER, MODEL
from papers.unknown.rope_films import filmed
from papers.unknown.rope_swings import Passed, Swing, UnknownRope
from whiptool import Strike, Target, default_prior
from whiptool.adaptation.first_look import choose_wiggle
from whiptool.adaptation.materials import stock_of_material
from whiptool.adaptation.plan_search import Demands, Effort, Plan
from whiptool.adaptation.planner import FIRST_IN_SPACE, NEXT_IN_SPACE, RETRIES_IN_SPACE, plan, surest
from whiptool.adaptation.posterior import Learned, update
from whiptool.adaptation.prior import Belief
from whiptool.comparison.unit import Unit
from whiptool.goals.arrival_rule import ArrivalRule
from whiptool.goals.goal_region import GoalRegion
from whiptool.goals.goals import Goals
from whiptool.goals.zone import Sector
from whiptool.limits.all_limits import Limits
from whiptool.limits.arm_limits import ArmLimits
from whiptool.limits.clearance import Clearance

MATERIALS = ("cotton", "nylon", "polypropylene", "manila")  # in turn, by seed
BASE = 1.7  # [m] above the floor
BRIEF = Effort(pool=64, polished=4, steps=20, whips=4, population=4, rounds=1)
POOL = 200  # goals
_GIVEN_UP: dict[str, Any] = {"miss": None, "angle": None, "hit": False, "probability": 0.0, "mean_miss": None}
_GIVEN_UP |= {"allowed": False, "misses": (), "strike": None, "seconds": 0.0}  # of a rope that nothing was learned of
_CLEAR = 0.15  # [m] by which a goal has to be within the rope's reach


def limits() -> tuple[Limits, ...]:
    """Return what every strike has to keep."""
    return ArmLimits.of(MODEL.arm, prescribed=True), Clearance(MODEL, -BASE)


def goals() -> Goals:
    """Return the goals, those of "Point It, Strike It" (2026); see `papers.aim`."""
    sector = Sector(1.6, 2.3, 0.3 - BASE, 2.5 - BASE, math.radians(30))
    rule = ArrivalRule(angle=(-math.pi, math.pi), cone=math.radians(10), speed=1.0)
    return GoalRegion(sector, rule, 0.05).draw(POOL, np.random.default_rng(1))


@dataclass(frozen=True, kw_only=True)
class RopeStudy:
    """What all units share.

    Args:
        thorough: Look for strikes as hard as usual; False: hardly, to see that all works.
    """

    thorough: bool = True

    def prior(self, material: str) -> Belief:
        """Of every rope of a material."""
        return default_prior(MODEL, CONTROLLER, stock=stock_of_material(material))

    def rope(self, family: str, seed: int) -> UnknownRope:
        """Return an unknown rope by its seed; materials take turns."""
        return UnknownRope(family, seed, MATERIALS[seed % len(MATERIALS)])

    def within(self, rope: UnknownRope) -> list[int]:
        """Numbers of the goals that lie within a rope's reach, in a random order that differs between ropes."""
        near = np.flatnonzero(np.linalg.norm(goals().positions, axis=1) <= rope.reach - _CLEAR)
        return np.random.default_rng([1, rope.seed]).permutation(near).tolist()

    def plan(self, belief: Belief, target: Target, seed: tuple[int, ...], past: Sequence[Sequence[float]] = ()) -> Plan:
        """Return the strike that most probably hits a rope that was seen, looked for harder where it is unsure."""
        rng = np.random.default_rng(seed)
        demands, efforts = Demands(limits=limits()), (BRIEF,)
        if self.thorough:
            efforts = (NEXT_IN_SPACE, *[FIRST_IN_SPACE] * RETRIES_IN_SPACE)
        look = lambda effort: plan(belief, target, rng=rng, past=past, demands=demands, effort=effort)  # noqa: E731
        return surest(look, efforts)

    def first_plan(self, belief: Belief, target: Target, seed: tuple[int, ...]) -> Plan:
        """Return the strike that most probably hits a rope of which the material alone is known."""
        effort = FIRST_IN_SPACE if self.thorough else BRIEF
        return plan(belief, target, rng=np.random.default_rng(seed), demands=Demands(limits=limits()), effort=effort)


@dataclass(frozen=True, kw_only=True)
class WiggleUnit(Unit):
    """The slow movement that tells most, chosen once for a material."""

    study: RopeStudy
    material: str

    def run(self, folder: Path | None, threads: int | None) -> dict[str, Any]:
        """Choose it."""
        candidates = 96 if self.study.thorough else 8
        prior = self.study.prior(self.material)
        strike, gain = choose_wiggle(prior, rng=np.random.default_rng(0), keeps=limits(), candidates=candidates)
        return {"strike": strike.vector.tolist(), "told": gain}


@dataclass(frozen=True, kw_only=True)
class RopeUnit(Unit):
    """One unknown rope: its wiggle, and one strike at each of some goals.

    Args:
        study: See there.
        family, seed: Family and seed of the rope.
        wiggle: What it is known by.
        count: Number of its goals that are struck at.
        first: The first of them.
        films: Whether two cameras see the wiggle, in rendered images; else motion capture does.
    """

    study: RopeStudy
    family: str
    seed: int
    wiggle: tuple[float, ...]
    count: int
    first: int = 0
    films: bool = False

    def run(self, folder: Path | None, threads: int | None) -> dict[str, Any]:
        """Wiggle, learn, strike once at every goal."""
        rope, study = self.study.rope(self.family, self.seed), self.study
        look = Strike.from_vector(self.wiggle)
        swung = rope.swing(look)
        own = study.within(rope)[self.first : self.first + self.count]
        if swung is None:
            return {"look": None, "struck": [_GIVEN_UP | {"goal": number} for number in own]}
        seen = filmed(rope, look, 0) if self.films else rope.recorded(swung, look, 0)
        learned = update(study.prior(rope.material), [seen], seed=self.seed)
        struck = []
        for number in own:
            target = Target.of(goals(), number)
            plan = study.plan(learned.belief, target, (2, self.seed, number))
            swung = rope.swing(Strike.from_vector(plan.strike))
            struck.append({"goal": number, **_came_of(plan, swung, target)})
        return {"look": _told(learned) | {"length": rope.length}, "struck": struck}


@dataclass(frozen=True, kw_only=True)
class UnseenRopeUnit(Unit):
    """One unknown rope without a wiggle: a strike at a goal from the material alone, and what it taught, another.

    Args:
        study: See there.
        family, seed: Family and seed of the rope.
        goal: Number of the goal in its order.
    """

    study: RopeStudy
    family: str
    seed: int
    goal: int = 0

    def run(self, folder: Path | None, threads: int | None) -> dict[str, Any]:
        """Strike, learn, strike again."""
        rope, study = self.study.rope(self.family, self.seed), self.study
        number = study.within(rope)[self.goal]
        target, prior = Target.of(goals(), number), study.prior(rope.material)
        plan = study.first_plan(prior, target, (3, self.seed, number))
        strike = Strike.from_vector(plan.strike)
        swung = rope.swing(strike)
        first = {"goal": number, **_came_of(plan, swung, target)}
        if swung is None:
            return {"look": None, "first": first, "struck": [_GIVEN_UP | {"goal": number}]}
        seen = replace(rope.recorded(swung, strike, 1 + number), target=target.position)
        contacts = {} if plan.contact is None else {seen.source: plan.contact}
        learned = update(prior, [seen], contacts=contacts, seed=self.seed)
        second = study.plan(learned.belief, target, (4, self.seed, number), [plan.strike])
        came = _came_of(second, rope.swing(Strike.from_vector(second.strike)), target)
        return {"look": _told(learned), "first": first, "struck": [{"goal": number, **came}]}


def _told(learned: Learned) -> dict[str, Any]:
    """What was learned, as plain data."""
    kept = {name: getattr(learned, name) for name in ("rmse", "refused", "redundancy")}
    return kept | {"seconds": learned.wall_time}


def _came_of(plan: Plan, swung: Swing | None, target: Target) -> dict[str, Any]:
    """How a planned strike passed its target, and what was stated of it, as plain data."""
    passed = Passed(None, None, hit=False) if swung is None else swung.passed(target)
    stated = {name: getattr(plan, name) for name in ("probability", "mean_miss", "allowed", "misses", "strike")}
    return {**asdict(passed), **stated, "seconds": plan.wall_time}
