"""Unknown ropes on a robot in space, one wiggle, then one strike a goal: the units of `reproduce adapt --space`.

The owner of a rope knows what it is made of, and nothing else of it. A wiggle is chosen once for a material; what
motion capture saw of it is what a strike at each goal is planned from.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from whiptool.adaptation.aiming import FIRST, NEXT, RETRIES, aim
from whiptool.adaptation.first_look import choose_wiggle
from whiptool.adaptation.materials import stock_of_material
from whiptool.adaptation.planner import Effort, Plan, surest
from whiptool.adaptation.posterior import update
from whiptool.adaptation.prior import Belief, default_prior
from whiptool.arrival_rule import ArrivalRule
from whiptool.goals import Goals
from whiptool.limits import Limits
from whiptool.models.arm_limits import ArmLimits
from whiptool.models.clearance import Clearance
from whiptool.models.strike import Strike
from whiptool.strike_map.goal_region import GoalRegion
from whiptool.studies.reproduction.aim.robot import CONTROLLER, MODEL
from whiptool.studies.reproduction.rope_swings import Passed, UnknownRope
from whiptool.target import Target
from whiptool.zone import Sector

MATERIALS = ("cotton", "nylon", "polypropylene", "manila")  # in turn, by seed
BASE = 1.7  # [m] above the floor
BRIEF = Effort(pool=64, polished=4, whips=4, population=4, rounds=1)
POOL = 200  # goals
_CLEAR = 0.15  # [m] by which a goal has to be within the rope's reach


def limits() -> tuple[Limits, ...]:
    """Return what every strike has to keep."""
    return ArmLimits.of(MODEL.arm, prescribed=True), Clearance(MODEL, -BASE)


def goals() -> Goals:
    """Return the goals, those of "Point It, Strike It" (2026); see `whiptool.studies.reproduction.aim`."""
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

    def named(self, *parts: object) -> str:
        """Return the name of a unit from its parts."""
        return "-".join(map(str, ["adapt-space", *parts, *([] if self.thorough else ["brief"])]))

    def prior(self, material: str) -> Belief:
        """Of every rope of a material."""
        return default_prior(MODEL, CONTROLLER, stock=stock_of_material(material))

    def rope(self, family: str, seed: int) -> UnknownRope:
        """Return an unknown rope by its seed; materials take turns."""
        return UnknownRope(family, seed, MATERIALS[seed % len(MATERIALS)])

    def within(self, rope: UnknownRope) -> list[int]:
        """Numbers of the goals that lie within a rope's reach, in an order of its own."""
        near = np.flatnonzero(np.linalg.norm(goals().positions, axis=1) <= rope.reach - _CLEAR)
        return np.random.default_rng([1, rope.seed]).permutation(near).tolist()

    def plan(self, belief: Belief, target: Target, seed: tuple[int, ...]) -> Plan:
        """Return the strike that most probably hits, looked for harder where it is less than half sure."""
        rng = np.random.default_rng(seed)
        efforts = (NEXT, *[FIRST] * RETRIES) if self.thorough else (BRIEF,)
        return surest(lambda effort: aim(belief, target, rng=rng, limits=limits(), effort=effort), efforts)


@dataclass(frozen=True, kw_only=True)
class WiggleUnit:
    """The slow movement that tells most, chosen once for a material."""

    study: RopeStudy
    material: str

    @property
    def name(self) -> str:
        """Name of the unit: the material."""
        return self.study.named("wiggle", self.material)

    def run(self, folder: Path | None, threads: int | None) -> dict[str, Any]:
        """Choose it."""
        candidates = 96 if self.study.thorough else 8
        prior = self.study.prior(self.material)
        strike, told = choose_wiggle(prior, rng=np.random.default_rng(0), keeps=limits(), candidates=candidates)
        return {"strike": strike.vector.tolist(), "told": told}


@dataclass(frozen=True, kw_only=True)
class RopeUnit:
    """One unknown rope: its wiggle, and one strike at each of some goals.

    Args:
        study: See there.
        family, seed: Of the rope.
        wiggle: What it is known by.
        first: The first of its own goals that is struck at.
        count: How many are.
    """

    study: RopeStudy
    family: str
    seed: int
    wiggle: tuple[float, ...]
    count: int
    first: int = 0

    @property
    def name(self) -> str:
        """Name of the unit: rope, and which goals."""
        return self.study.named(self.family, self.seed, self.first, self.count)

    def run(self, folder: Path | None, threads: int | None) -> dict[str, Any]:
        """Wiggle, learn, strike once at every goal."""
        rope, study = self.study.rope(self.family, self.seed), self.study
        look = Strike.from_vector(self.wiggle)
        swung = rope.swing(look)
        if swung is None:
            return {"look": None, "struck": []}
        learned = update(study.prior(rope.material), [rope.recorded(swung, look, 0)], seed=self.seed)
        told = {"rmse": learned.rmse, "refused": learned.refused, "seconds": learned.wall_time}
        struck = []
        for number in study.within(rope)[self.first : self.first + self.count]:
            target = Target.of(goals(), number)
            plan = study.plan(learned.belief, target, (2, self.seed, number))
            seen = rope.swing(Strike.from_vector(plan.strike))
            passed = Passed(None, None, hit=False) if seen is None else seen.passed(target)
            stated = {name: getattr(plan, name) for name in ("probability", "mean_miss", "allowed", "misses", "strike")}
            struck.append({"goal": number, **asdict(passed), **stated, "seconds": plan.wall_time})
        return {"look": told | {"length": rope.length, "redundancy": learned.redundancy}, "struck": struck}
