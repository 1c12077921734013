"""Building of a strike map: random strikes, then rounds in which missed goals are refined and added."""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from whiptool.errors import InputError, expect
from whiptool.goals.arrival_rule import GoalRegion, named_rule, named_zone, usual_region
from whiptool.goals.target import HIT_RADIUS
from whiptool.goals.zone import RADIUS
from whiptool.impedance.controller import controller_from_table
from whiptool.limits.all_limits import named_limits
from whiptool.models import Model
from whiptool.models.files import model_from_table
from whiptool.models.numbers import whole
from whiptool.models.strike import T_STAY, strike_names
from whiptool.progress import Progress
from whiptool.rollout.compiled import CompiledRollout
from whiptool.runs import config_of
from whiptool.strike_map.answers import Answers, Front, bounds_all_around
from whiptool.strike_map.map_files import load_gate, load_parts, save_gate, save_part, shipped_map
from whiptool.strike_map.strike_map import TRIED, Gate, StrikeMap, features
from whiptool.strike_map.striker import Striker

Cell: TypeAlias = tuple[int, ...]

RATE = 500.0  # [1/s] at which paths are looked at: differences between samples are velocities to a part in a thousand
_IN_MEMORY = 128  # strikes, whose derivatives along their whole paths are in memory together
_CELL = 2.0  # width of a cell, in hit radii and in cones
_WORTH = 4  # cells with room that a strike has to pass


class Harvest:
    """Counts the map entries in each cell of a region, and selects further entries for cells that are not full.

    A cell is two hit radii wide, and two cones if directions are required. Only strikes that pass several cells that
    are not full are used, because derivatives cost as much for the whole path as for one point. `rng` draws points by
    which the zone's range of directions is estimated.
    """

    def __init__(self, striker: Striker, region: GoalRegion, rng: np.random.Generator) -> None:
        self.striker, self.region = striker, region
        self.front = Front(striker.rollout.model)
        self._azimuths = self.front.azimuths(region.zone, rng)
        self._taken: Counter[Cell] = Counter()

    def count(self, answers: Answers) -> None:
        """Count entries of the map that were selected before, such as by an interrupted run, as taken cells."""
        self._taken.update(map(tuple, self._cells(answers.tips, answers.velocities)))

    def pick(self, strikes: np.ndarray, *, room: int) -> Answers:
        """Return entries of strikes (B, m) that keep the limits, at points in cells with fewer than `room` entries,
        rotated about the vertical to the front.
        """
        if not len(strikes):
            return Answers.none(strikes.shape[1], self.region.zone.dimension)
        kept, which, when = [], [], []
        for strike, cells in self._passed(strikes):
            free = {cell: at for cell, at in cells.items() if self._taken[cell] < room}
            if len(free) >= _WORTH and self.striker.keep(strike[None])[0]:
                self._taken.update(free.keys())
                which += [len(kept)] * len(free)
                when += sorted(free.values())
                kept.append(strike)
        strikes = np.reshape(kept, (len(kept), strikes.shape[1]))
        found = passages_of(self.striker, strikes, np.array(which, int), np.array(when, int))
        return self.front.answers(found, -self.front.angles(found.tips))

    def _passed(self, strikes: np.ndarray) -> Iterator[tuple[np.ndarray, dict[Cell, int]]]:
        """Yield strikes whose peaks are within the limits, and the cells that their tips pass as goals ask for it.

        With each cell stands the last sample in it.
        """
        within, paths, velocities = paths_of(self.striker, strikes)
        strikes = strikes[within]
        which, when = np.nonzero(np.isfinite(velocities).all(axis=2))
        tips, velocities = paths[which, when], velocities[which, when]
        angles = -self.front.angles(tips)
        tips, velocities = self.front.vectors(tips, angles), self.front.vectors(velocities, angles)
        wanted = self.striker.inside(self.front.strikes(strikes[which], angles)) & self._in_zone(tips)
        which, when, tips, velocities = which[wanted], when[wanted], tips[wanted], velocities[wanted]
        arrives = self.region.goals_of(tips, velocities).arrives(velocities)
        cells = self._cells(tips[arrives], velocities[arrives])
        passed: list[dict[Cell, int]] = [{} for _ in strikes]
        for strike, at, cell in zip(which[arrives], when[arrives], cells, strict=True):
            passed[strike][tuple(cell)] = int(at)
        return zip(strikes, passed, strict=True)

    def _in_zone(self, tips: np.ndarray) -> np.ndarray:
        """Return whether places that were turned to the front lie in the zone where they are turned back, (K,)."""
        contained = np.zeros(len(tips), bool)
        for azimuth in self._azimuths:
            contained |= self.region.zone.contains(self.front.vectors(tips, np.full(len(tips), azimuth)))
        return contained

    def _cells(self, tips: np.ndarray, velocities: np.ndarray) -> list[list[int]]:
        """Return in which cell of the region each passage lies."""
        columns = tips / (_CELL * self.region.hit_radius)
        angles = self.region.angles(tips, velocities)
        if angles is not None:
            columns = np.column_stack([columns, angles / (_CELL * self.region.rule.cone)])
        return np.floor(columns).astype(int).tolist()


def passages_of(striker: Striker, strikes: np.ndarray, which: np.ndarray, when: np.ndarray) -> Answers:
    """Return K map entries: strikes (S, m) at samples of their tip paths, taken at `RATE` as in `paths_of`. `which` are
    the ascending indices of the strikes, (K,), `when` those of the samples, (K,), neither a path's first nor its last.
    """
    names, d = strike_names(striker.rollout.model.arm), striker.rollout.model.dimension
    parts = [Answers.none(strikes.shape[1], d)]
    for first in range(0, len(strikes), _IN_MEMORY):
        here = (which >= first) & (which < first + _IN_MEMORY)
        some, row, sample = strikes[first : first + _IN_MEMORY], which[here] - first, when[here]
        _, paths, slopes = striker.rollout.tip_path(some, t_stay=striker.t_stay, rate=RATE, names=names)
        before, at, after = (paths[row, sample + step] for step in (-1, 0, 1))
        velocity, acceleration = (after - before) * RATE / 2, (after - 2 * at + before) * RATE**2
        of_velocity = (slopes[row, sample + 1] - slopes[row, sample - 1]) * RATE / 2
        tip_slopes = np.concatenate([slopes[row, sample], velocity[..., None]], axis=2)
        velocity_slopes = np.concatenate([of_velocity, acceleration[..., None]], axis=2)
        parts.append(Answers(some[row], at, velocity, tip_slopes, velocity_slopes))
    return Answers.joined(parts)


def paths_of(striker: Striker, strikes: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the tip paths of those strikes (S, m) whose peak values keep the limits: indices of these b strikes, (b,),
    and the tips' positions [m] and velocities [m/s] at T samples, at `RATE`, (b, T, d) each, NaN outside the strike.
    """
    within, paths = striker.paths(strikes, rate=RATE)
    kept, paths = np.flatnonzero(within), paths[within]
    velocities = np.full_like(paths, np.nan)
    velocities[:, 1:-1] = (paths[:, 2:] - paths[:, :-2]) * RATE / 2
    return kept, paths, velocities


_DRAWN = 2048  # random strikes of a part


@dataclass(frozen=True)
class MapPlan:
    """Amount of simulation to build a map."""

    random_strikes: int = 8192  # the points of the region that they pass are the first entries
    room: int = 2  # largest number of entries in each cell of the region at first; each round adds one
    rounds: int = 4  # in which missed goals are refined and added
    goals: int = 1000  # in each round
    gate_strikes: int = 20_000  # candidates with which the ranking network (gate) is trained; 0: no network
    per_goal: int = 4  # number of these candidates at each goal

    def __post_init__(self) -> None:
        for name in ("random_strikes", "room", "goals", "per_goal"):
            whole(name, getattr(self, name))
        for name in ("rounds", "gate_strikes"):
            whole(name, getattr(self, name), low=0)

    @property
    def parts(self) -> int:
        """Number of parts in which a map is built: those of random strikes, then one for each round."""
        return self.random_parts + self.rounds

    @property
    def random_parts(self) -> int:
        """Number of parts of random strikes."""
        return -(-self.random_strikes // _DRAWN)


class Building:
    """Builds a map in parts; each part is determined by the previous parts, so that building can be resumed."""

    def __init__(self, striker: Striker, region: GoalRegion, plan: MapPlan, *, seed: int) -> None:
        self.striker, self.region, self.plan, self.seed = striker, region, plan, seed

    def part(self, before: Sequence[Answers]) -> Answers:
        """Return the entries of the next part, given those before it."""
        rng = np.random.default_rng([self.seed, len(before)])
        harvest = Harvest(self.striker, self.region, rng)
        for answers in before:
            harvest.count(answers)
        practised = len(before) - self.plan.random_parts
        if practised >= 0:
            return self._practice(harvest, Answers.joined(before), rng, room=self.plan.room + practised + 1)
        count = min(_DRAWN, self.plan.random_strikes - len(before) * _DRAWN)
        drawn = self.striker.limits.random_strikes(self.striker.bounds, rng, count)
        found = harvest.pick(drawn, room=self.plan.room)
        if not before and not len(found):
            rule, fix = (
                f"a zone that some of {count} random strikes pass",
                "make it larger, or take more random strikes",
            )
            raise InputError("zone", str(self.region.zone), rule, fix)
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


_ZONE = {"target": None, "zone_radius": RADIUS, "sector": None, "region": None}  # where none is named


def building_of(config: Mapping[str, Any]) -> Building:
    """Return the `Building`, before its first part, that the configuration of a run of `map build` describes."""
    options, model = config["options"], model_from_table(config["model"])
    controller = controller_from_table(config["controller"])
    controller.check_fits(model.arm)
    accuracy = {"tolerance": options.get("tolerance"), "timestep": options.get("timestep")}
    striker = Striker(
        CompiledRollout(model, controller, **accuracy),
        bounds=bounds_all_around(model.arm),
        limits=named_limits(options, model, prescribed=controller.prescribed),
        t_stay=options.get("t_stay", T_STAY),
    )
    lengths = (options[name] for name in ("random_strikes", "room", "rounds", "goals", "gate_strikes"))
    return Building(striker, _region_of(options, model), MapPlan(*lengths), seed=options["seed"])


def _region_of(options: Mapping[str, Any], model: Model) -> GoalRegion:
    """Return the region of goals that options name, or the usual one."""
    rule, hit_radius = named_rule(options), options.get("hit_radius", HIT_RADIUS)
    if any(options.get(name, usual) != usual for name, usual in _ZONE.items()):
        return GoalRegion(named_zone(options, model), rule, hit_radius)
    usual = usual_region(model, hit_radius)
    rule.check_dimension(model)
    return usual if rule.only_points else replace(usual, rule=rule)


def load_map(run_folder: str | Path) -> StrikeMap:
    """Return a strike map.

    Args:
        run_folder: Run folder of `python -m whiptool.map build`, or, if there is no such folder, the name of a preset
            whose map comes with the package.

    Raises:
        InputError: No preset has this name, the folder is of another command, or its map is not complete.
    """
    expect(str, PathLike, run_folder=run_folder)
    folder = Path(run_folder)
    if not folder.exists() and folder.name == str(run_folder):
        return shipped_map(str(run_folder))
    building = building_of(config_of(folder, "map"))
    parts, gate = load_parts(folder, building.plan.parts), load_gate(folder)
    if len(parts) < building.plan.parts or (gate is None and building.plan.gate_strikes > 0):
        rule = f"a finished map; continue with whiptool map build --resume {folder}"
        raise InputError("run_folder", str(folder), rule)
    return StrikeMap(building.striker, building.region, Answers.joined(parts), gate)
