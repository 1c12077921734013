"""Tasks of aimed strikes: what strikes, where goals are drawn, and how a map of them is built."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from papers.aim.published import CONTROLLER, MODEL
from whiptool import CompiledRollout, Controller, Model
from whiptool.comparison import TargetScene
from whiptool.goals.arrival_rule import ArrivalRule, GoalRegion
from whiptool.goals.goals import Goals
from whiptool.goals.zone import Sector
from whiptool.limits.arm_limits import ArmLimits
from whiptool.limits.clearance import Clearance
from whiptool.limits.limits import Limits
from whiptool.models.strike import T_STAY
from whiptool.strike_map.answers import bounds_all_around
from whiptool.strike_map.building import Building, MapPlan
from whiptool.strike_map.striker import Striker

IN_SPACE = MapPlan(random_strikes=4096, room=2, rounds=2, goals=800, gate_strikes=16_000)
IN_PLANE = MapPlan(random_strikes=4096, room=1, rounds=2, goals=1000, gate_strikes=8000)
QUICK = MapPlan(random_strikes=128, room=1, rounds=1, goals=8, gate_strikes=200)


@dataclass(frozen=True, kw_only=True, eq=False)
class AimTask:
    """What strikes, and at what.

    Args:
        name: Name of it, fit for a file.
        model, controller: Whip, arm, and law.
        tolerance, timestep: Tolerance and timestep of the compiled rollout, see there.
        region: Region of the goals.
        limited: Whether strikes have to keep the arm's limits.
        clear: Whether arm, whip and floor have to keep clear of each other.
        drawn: Goals that are drawn; all together, so that the first of them are the same however many are struck at.
        goal_seed: They are drawn with it.
        plan: Plan of the map.
        seed: Seed of the map.
        corrected: Whether strikes are counted where a miss is followed by corrections.
        floor: Its height [m]; None: no floor.
        t_stay: A strike is watched this long after the movement ended [s].
    """

    name: str
    model: Model
    controller: Controller
    region: GoalRegion
    limited: bool
    drawn: int
    goal_seed: int
    plan: MapPlan
    seed: int = 0
    corrected: bool = False
    clear: bool = False
    floor: float | None = None
    tolerance: float | None = None
    timestep: float | None = None
    t_stay: float = T_STAY

    def striker(self, threads: int | None = None) -> Striker:
        """Return what rolls out."""
        accuracy = {"tolerance": self.tolerance, "timestep": self.timestep}
        rollout = CompiledRollout(self.model, self.controller, **accuracy, threads=threads)
        limits: list[Limits] = []
        if self.limited:
            limits.append(ArmLimits.of(self.model.arm, prescribed=self.controller.prescribed))
        if self.clear:
            limits.append(Clearance(self.model, self.floor))
        bounds = bounds_all_around(self.model.arm)
        return Striker(rollout, bounds=bounds, limits=limits, t_stay=self.t_stay)

    def building(self) -> Building:
        """Return the building of its map, not begun."""
        return Building(self.striker(), self.region, self.plan, seed=self.seed)

    def goals(self) -> Goals:
        """Return all goals."""
        return self.region.draw(self.drawn, np.random.default_rng(self.goal_seed))


def ur5e(*, quick: bool = False, clear: bool = True) -> AimTask:
    """Return the UR5e with a stick of 0.65 m and a rope of 1 m, its base 1.7 m above the ground.

    Goals are those of "Point It, Strike It" (2026): 1.6 to 2.3 m from the base, 0.3 to 2.5 m above the ground, within
    30 degrees of forward, at any arrival angle, within 5 cm and 10 degrees, at 1 m/s along the direction. Joints keep
    all their limits.

    Args:
        quick: Whether a small map is built.
        clear: Whether arm, whip and ground have to keep clear of each other, the fall of the whip after the hit
            included; otherwise what they touch is looked at afterwards.
    """
    base = 1.7
    sector = Sector(1.6, 2.3, 0.3 - base, 2.5 - base, math.radians(30))
    return AimTask(
        name="ur5e-clear" if clear else "ur5e",
        model=MODEL,
        controller=CONTROLLER,
        region=GoalRegion(sector, ArrivalRule(angle=(-math.pi, math.pi), cone=math.radians(10), speed=1.0), 0.05),
        limited=True,
        clear=clear,
        drawn=5000,
        goal_seed=1,
        floor=-base,
        plan=QUICK if quick else IN_SPACE,
    )


def hard(scene: TargetScene, *, quick: bool = False) -> AimTask:
    """Return the planar hard task: the targets of a scene, without limits."""
    assert len(scene.radii) == 1
    return AimTask(
        name="hard",
        model=scene.model,
        controller=scene.controller,
        tolerance=scene.tolerance,
        timestep=scene.timestep,
        region=GoalRegion(scene.zone, hit_radius=scene.radii[0]),
        limited=False,
        drawn=scene.targets,
        goal_seed=scene.target_seed,
        corrected=True,
        plan=QUICK if quick else IN_PLANE,
    )
