"""Unknown whips, struck as `python -m whiptool.adapt` strikes them: one unit of work for one whip and a few goals.

What strikes, learns and plans is the `Adapter` that the command makes of its options. The study draws whips and
goals, and looks at how the true whip passed. Some ropes are Cosserat rods in PyElastica, which share no formula with
what is fitted: they stretch, shear and twist, the air drags them, and a knot hangs at their end.
"""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from whiptool import Adaptation, CompiledRollout, Controller, Model, Strike, Target, WhipProfile, draw_twin
from whiptool.adaptation.adapter import PLAN, NoPlan
from whiptool.adaptation.materials import USUAL, stock_of_material
from whiptool.adaptation.plan_search import PlanningEffort
from whiptool.adaptation.ports import TipPort
from whiptool.adaptation.steps import Port, Seen
from whiptool.adaptation.twins import FAMILIES, Twin
from whiptool.commands.adapt import prepare
from whiptool.commands.options.rig_options import AdaptOptions
from whiptool.comparison.units import Unit
from whiptool.errors import WhiptoolError
from whiptool.given_files import read_json
from whiptool.goals.arrival_rule import GoalRegion, usual_region
from whiptool.goals.goals import Goals, arrival_angles
from whiptool.goals.zone import Disc
from whiptool.models import preset
from whiptool.models.trajectory import Approach, closest_on_curve
from whiptool.rig.stops import StrikeStopped
from whiptool.rollout.cosserat import CosseratWhip, TipPaths, hand_path

ROPE = "rope"
ELEMENTS = 24
WAVES, RADIUS = 200.0, 0.016  # [m/s], [m]: of its stretching waves, and of its sections' inertia
KNOT = (0.001, 0.004)  # [kg]
TAPER = 0.15  # largest share of its thickness that a rope loses to its end
CLOCK = 0.004  # [s] that the camera's clock is off by, at most
NOISE = 0.005  # [m], as of every twin's camera
FINE = 1000.0  # [1/s] of a tip's path


def drawn_profile(seed: int, material: str) -> WhipProfile:
    """Return the rope of a material that a seed draws."""
    rng = np.random.default_rng([17, seed])
    numbers = stock_of_material(material).draw(rng)
    thin = 1 - rng.uniform(0, TAPER)
    return WhipProfile(
        length=numbers["length"],
        linear_density=numbers["linear_density"],
        bending_stiffness=numbers["bending_stiffness"],
        bending_damping=numbers["bending_damping"],
        density_taper=thin**2,
        stiffness_taper=thin**4,
        damping_taper=thin**4,
        drag=numbers["drag"],
        tip_mass=float(rng.uniform(*KNOT)),
    )


def drawn_rope(seed: int, material: str, model: Model, controller: Controller) -> Twin:
    """Return what a seed draws as a twin; its model has the rope's length, but moves as a chain."""
    whip = drawn_profile(seed, material).lump(ELEMENTS, joints="rod")
    clock = float(np.random.default_rng([18, seed]).uniform(-CLOCK, CLOCK))
    return Twin(ROPE, seed, replace(model, whip=whip), controller, 0.0, clock, NOISE)


class RodPort(TipPort):
    """A rope as a Cosserat rod, on an arm that follows its commands exactly, whatever hangs on it.

    Args:
        rope: See `drawn_rope`.
        material: Its material.
        model: The arm.
        target: Target.
        t_stay: The strike is watched so long after the movement ended [s].
    """

    def __init__(self, rope: Twin, material: str, model: Model, target: Target, *, t_stay: float) -> None:
        super().__init__(rope, target, t_stay=t_stay)
        self.profile, self.model = drawn_profile(rope.seed, material), model
        self._swung: tuple[Strike, TipPaths | None] | None = None

    def swing(self, strike: Strike) -> TipPaths | None:
        """Return how the rod moves in a strike; None: it left all bounds."""
        if self._swung is None or self._swung[0] != strike:
            arm = CompiledRollout(self.model, self.twin.controller, timestep=1e-3)
            hand = hand_path(self.model, arm.trajectory(strike, t_stay=self.t_stay))
            rod = CosseratWhip(
                self.profile, elements=ELEMENTS, wave_speed=WAVES, radius=RADIUS, gravity=self.model.gravity
            )
            try:
                self._swung = strike, rod.swing([hand], rate=FINE)
            except WhiptoolError:
                self._swung = strike, None
        return self._swung[1]

    def passes(self, strike: Strike) -> Approach:
        """Return how its tip passes the target in a strike."""
        swung, place = self.swing(strike), np.array(self.target)
        nothing = np.zeros((1, self.model.arm.n))
        if swung is None:
            lost = np.full((1, 3), np.nan)
            return Approach(np.array([np.inf]), np.zeros(1), lost, lost, nothing, nothing, np.array([True]))
        curve = swung.curve(0)
        when = closest_on_curve(curve, place, samples=len(swung.t))
        miss = np.array([np.linalg.norm(curve(when) - place)])
        tip, velocity = curve(when)[None], curve(when, 1)[None]
        return Approach(miss, np.array([when]), velocity, tip, nothing, nothing, np.array([False]))

    def path(self, strike: Strike) -> tuple[np.ndarray, np.ndarray]:
        """Return times and its tip's path."""
        swung = self.swing(strike)
        assert swung is not None
        return swung.t, swung.tip[0]


WAYS = {
    "nominal": "the best strike for the whip in the middle of the material, once",
    "unseen": "no look before the first strike",
    "still": "filmed once as it hangs, before the first strike",
    "wiggle": "filmed in one slow movement instead, which the command chooses",
    "rig": "filmed as it hangs; through emulated servos, within the motors' limits, in tracked images",
}
_OPTIONS: dict[str, dict[str, Any]] = {  # of the command
    "nominal": {"still": False, "max_strikes": 1},
    "unseen": {"still": False},
    "still": {},
    "wiggle": {"wiggle": True},
    "rig": {"camera": "points"},
}
PLANE, SPACE = "lemon2024", "ur5e"
MATERIALS = {PLANE: USUAL, SPACE: ("cotton", "nylon", "polypropylene", "manila")}  # in turn, by seed
REGIONS = {PLANE: GoalRegion(Disc((1.15, 0.0), 0.1)), SPACE: usual_region(preset(SPACE), 0.05)}
CLEAR = {PLANE: 0.05, SPACE: 0.15}  # [m] by which a goal has to be within the whip's reach
POOL = 200  # goals
BRIEF = PlanningEffort(pool=64, polished=4, steps=4, whips=4, population=4, rounds=1)


def families(model: str) -> tuple[str, ...]:
    """Return the families of a preset that can be simulated here: `rope` needs PyElastica."""
    return (*FAMILIES, ROPE) if model == SPACE and find_spec("elastica") is not None else tuple(FAMILIES)


@dataclass(frozen=True, kw_only=True)
class WhipUnit(Unit):
    """One unknown whip, struck at some goals.

    A whip is looked at once: the look does not depend on the goal, and all its runs read it.

    Args:
        model: `PLANE` or `SPACE`.
        family, seed: The whip.
        way: One of `WAYS`.
        goals: How many.
        brief: Look for strikes hardly, to see that all works.
    """

    model: str
    family: str
    seed: int
    way: str = "still"
    goals: int = 3
    brief: bool = False

    def run(self, folder: Path | None, threads: int | None) -> dict[str, Any]:
        """Strike at each goal until the whip hits, or until the command would end."""
        rows = []
        with TemporaryDirectory() as scratch:
            looked: Path | None = None
            for number in self.within()[: self.goals]:
                place = Path(scratch) / str(number)
                if looked is not None:
                    shutil.copytree(looked, place / looked.name)
                prepared = replace(self.prepared(number), folder=place)
                rows.append({"goal": number, "struck": list(struck(prepared))})
                looked = place / "strike-0000" if (place / "strike-0000").exists() else None
        return {"length": self.whip.model.whip.length, "trials": rows}

    @property
    def material(self) -> str:
        """What its owner knows of the whip."""
        names = MATERIALS[self.model]
        return names[self.seed % len(names)]

    @property
    def options(self) -> AdaptOptions:
        """Options of the command, all others as usual; a target is not among them."""
        family: Any = "kin" if self.family == ROPE else self.family
        material: Any = self.material
        usual = AdaptOptions(model=self.model, camera="tip", family=family, material=material, seed=self.seed)
        return replace(usual, **_OPTIONS[self.way])

    @property
    def whip(self) -> Twin:
        """The unknown whip."""
        o, stock = self.options, stock_of_material(self.material)
        model = stock.owned(o.build_model())
        if self.family == ROPE:
            return drawn_rope(self.seed, self.material, model, o.build_controller())
        return draw_twin(self.family, self.seed, model, o.build_controller(), stock)

    def within(self) -> list[int]:
        """Return the numbers of the goals within the whip's reach, in a random order that differs between whips.

        They are within the reach of the middle of the material, too: beyond that the command refuses them.
        """
        middle = stock_of_material(self.material).owned(self.options.build_model())
        reach = min(self.whip.model.reach, middle.reach) - CLEAR[self.model]
        near = np.flatnonzero(np.linalg.norm(pool(self.model).positions, axis=1) <= reach)
        return np.random.default_rng([1, self.seed]).permutation(near).tolist()

    def prepared(self, number: int) -> Adaptation:
        """Return what the command makes of its options with a goal of the pool."""
        goals = pool(self.model)
        aimed: dict[str, Any] = {"target": tuple(goals.positions[number].tolist()), "hit_radius": goals.hit_radius}
        if goals.directions is not None:
            (angle,) = arrival_angles(goals.positions[[number]], goals.directions[[number]])
            aimed |= {"arrival_angle": float(np.degrees(angle)), "least_speed": goals.speed}
        adaptation = prepare(replace(self.options, **aimed))
        if self.family == ROPE:
            arm, usual = preset(self.model), adaptation.options
            port = RodPort(self.whip, self.material, arm, adaptation.target, t_stay=usual.t_stay)
            adaptation = replace(adaptation, port=port)
        if self.way == "nominal":
            prior = replace(adaptation.prior, covariance=1e-8 * adaptation.prior.covariance)
            adaptation = replace(adaptation, prior=prior, options=replace(adaptation.options, adapt=False))
        if self.brief:
            brief = replace(adaptation.options, first=BRIEF, later=BRIEF, retries=0, starts=1, max_strikes=2)
            adaptation = replace(adaptation, options=brief)
        return adaptation


def pool(model: str) -> Goals:
    """Return the goals of which every whip gets some."""
    return REGIONS[model].draw(POOL, np.random.default_rng(1))


def struck(adaptation: Adaptation) -> Iterator[dict[str, Any]]:
    """Strike until the true whip hits, or until the adaptation ends by itself: it claims a hit, gives up, or finds no
    strike that may be made.

    Yields:
        What was stated of each strike, and how the true whip passed; the look before the first strike is left out.
    """
    adapter, port = adaptation.adapter(), adaptation.port
    while True:
        try:
            strike = adapter.ask()
            if strike is None:
                return
            assert adapter.place is not None
            seen = port.strike(strike, adapter.number, adapter.place, adapter.belief.at().model)
        except (NoPlan, StrikeStopped):
            return
        if adapter.number:
            plan = read_json(adapter.place / PLAN)
            stated = {name: plan[name] for name in ("strike", "probability", "misses", "mean_miss", "allowed")}
            came = came_of(port, strike, seen, adaptation.target)
            yield {**came, **stated, "seconds": plan["wall_time"]}
            if came["hit"]:
                return
        adapter.tell(seen)


def came_of(port: Port, strike: Strike, seen: Seen, target: Target) -> dict[str, Any]:
    """Return how the true whip passed the target: its distance, the angle to the direction, whether it hit."""
    if not isinstance(port, TipPort):
        miss = seen.true_miss
        return {"miss": miss, "angle": None, "hit": miss is not None and bool(target.goals.hit(np.array([miss]))[0])}
    near, goal = port.passes(strike), target.goals
    if near.diverged[0]:
        return {"miss": None, "angle": None, "hit": False}
    angle = None if goal.directions is None else float(goal.angle(near.velocity)[0])
    return {"miss": float(near.distance[0]), "angle": angle, "hit": bool(goal.hit_by(near)[0])}
