"""Building a strike map: random strikes, then rounds of practice in which what was missed is learned."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from whiptool.errors import InputError
from whiptool.goals.arrival_rule import GoalRegion
from whiptool.models.numbers import whole
from whiptool.progress import Progress
from whiptool.strike_map.answers import Answers
from whiptool.strike_map.candidates import features
from whiptool.strike_map.gate import Gate
from whiptool.strike_map.harvest import Harvest
from whiptool.strike_map.map_files import load_gate, load_parts, save_gate, save_part
from whiptool.strike_map.strike_map import TRIED, StrikeMap
from whiptool.strike_map.striker import Striker

_AT_ONCE = 2048  # random strikes of a part


@dataclass(frozen=True)
class MapPlan:
    """Amount of simulation to build a map.

    Args:
        random_strikes: Number of random strikes; the points of the region that they pass are the first entries.
        room: Largest number of entries in each cell of the region at first; each round adds one.
        rounds: Number of rounds in which missed goals are refined and added.
        goals: Number of goals of each round.
        gate_strikes: Number of candidate strikes with which the ranking network (gate) is trained; 0: no network.
        per_goal: Number of these candidates at each goal.

    Raises:
        InputError: A number is out of range.
    """

    random_strikes: int = 8192
    room: int = 2
    rounds: int = 4
    goals: int = 1000
    gate_strikes: int = 20_000
    per_goal: int = 4

    def __post_init__(self) -> None:
        for name in ("random_strikes", "room", "goals", "per_goal"):
            whole(name, getattr(self, name))
        for name in ("rounds", "gate_strikes"):
            whole(name, getattr(self, name), low=0)

    @property
    def parts(self) -> int:
        """Number of parts: of random strikes, and then of rounds."""
        return self.random_parts + self.rounds

    @property
    def random_parts(self) -> int:
        """Number of parts of random strikes."""
        return -(-self.random_strikes // _AT_ONCE)


class Building:
    """Builds a map in parts; each part is determined by the previous parts, so that building can be resumed.

    Args:
        striker: Simulator of strikes.
        region: Region of the goals.
        plan: Amount of simulation.
        seed: Seed of all random numbers.
    """

    def __init__(self, striker: Striker, region: GoalRegion, plan: MapPlan, *, seed: int) -> None:
        self.striker, self.region, self.plan, self.seed = striker, region, plan, seed

    def part(self, before: Sequence[Answers]) -> Answers:
        """Return the entries of the next part, given those before it.

        Raises:
            InputError: No random strike passes a goal of the region.
        """
        rng = np.random.default_rng([self.seed, len(before)])
        harvest = Harvest(self.striker, self.region, rng)
        for answers in before:
            harvest.count(answers)
        practised = len(before) - self.plan.random_parts
        if practised >= 0:
            return self._practice(harvest, Answers.joined(before), rng, room=self.plan.room + practised + 1)
        count = min(_AT_ONCE, self.plan.random_strikes - len(before) * _AT_ONCE)
        drawn = self.striker.limits.random_strikes(self.striker.bounds, rng, count)
        found = harvest.pick(drawn, room=self.plan.room)
        if not before and not len(found):
            raise InputError("zone", str(self.region.zone), f"one that some of {count} random strikes pass")
        return found

    def _practice(self, harvest: Harvest, answers: Answers, rng: np.random.Generator, *, room: int) -> Answers:
        """Strike at random goals, refine what missed, and return what of it is new."""
        strike_map = StrikeMap(self.striker, self.region, answers)
        goals = self.region.draw(self.plan.goals, rng)
        missed = goals.rows(~self.striker.strike(strike_map.strikes(goals), goals).hit)
        refined = strike_map.refined(missed, tried=TRIED)
        return harvest.pick(refined.strikes[refined.struck.hit], room=room)

    def gate(self, answers: Answers, *, progress: bool = False) -> Gate:
        """Return a ranking network (gate) trained with the results of candidate strikes for random goals.

        Limits that need the whole trajectory are not checked here, because this is slow; the entries keep them, and so
        do nearly all strikes that are corrected from entries.
        """
        rng = np.random.default_rng([self.seed, self.plan.parts])
        strike_map = StrikeMap(self.striker, self.region, answers)
        goals = self.region.draw(-(-self.plan.gate_strikes // self.plan.per_goal), rng)
        seen, strikes = [], []
        for i in range(len(goals.positions)):
            goal = goals.rows(np.array([i]))
            found = strike_map.candidates(goal)
            some = found.take(rng.permutation(len(found.strikes))[: self.plan.per_goal])
            seen.append(features(self.striker, strike_map.front, goal, some))
            strikes.append(some.strikes)
        each = np.repeat(np.arange(len(strikes)), [len(x) for x in strikes])
        hit = self.striker.land(np.concatenate(strikes), goals.rows(each)).hit
        return Gate.trained(np.concatenate(seen), hit, seed=self.seed, progress=progress)


def built(building: Building, folder: Path) -> StrikeMap:
    """Build a map, and return it; parts that the folder already has are loaded, others are computed and written to
    it."""
    plan = building.plan
    parts = load_parts(folder, plan.parts)
    with Progress(total=plan.parts, initial=len(parts), unit=" parts", desc="map", file=sys.stderr, leave=False) as bar:
        while len(parts) < plan.parts:
            parts.append(building.part(parts))
            save_part(folder, len(parts) - 1, parts[-1])
            bar.set_postfix_str(f"{sum(map(len, parts))} answers", refresh=False)
            bar.update()
    answers, gate = Answers.joined(parts), load_gate(folder)
    if gate is None and plan.gate_strikes > 0:
        gate = building.gate(answers, progress=True)
        save_gate(folder, gate)
    return StrikeMap(building.striker, building.region, answers, gate)
