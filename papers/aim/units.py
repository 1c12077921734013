"""Units of work: goals struck at from a map, missed ones given to other searches, strikes replayed in MuJoCo."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from zlib import crc32

import numpy as np

from papers.aim.task import AimTask
from whiptool import Objective, ReferenceRollout, Target, search
from whiptool.comparison.units import Unit
from whiptool.goals.goals import Goals
from whiptool.limits.clearance import Clearance
from whiptool.rl.trained import one_torch_thread
from whiptool.strike_map.map_files import opened
from whiptool.strike_map.strike_map import SHORTLIST, TRIED, StrikeMap
from whiptool.strike_map.striker import Landings, Striker, refine

SEARCHES = {"gradient": 3000, "cmaes": 10_000}  # what goals are given to that refinement missed, with its rollouts
_TOGETHER = 8  # candidates that are struck at once
MUJOCO_STEP = 5e-4  # [s], of fourth order


@dataclass(frozen=True)
class KeptMap:
    """A map in its folder: results are those of the map, wherever the folder is.

    Args:
        folder: Folder of the map.
        label: Label of the map, different for different ones.
    """

    folder: Path = field(compare=False)
    label: str

    @classmethod
    def of(cls, strike_map: StrikeMap, folder: Path) -> KeptMap:
        """Return a map that is kept in a folder; its label is another one for other answers or another gate."""
        gate = b"" if strike_map.gate is None else strike_map.gate.mean.tobytes()
        return cls(folder.resolve(), f"{crc32(gate, crc32(strike_map.answers.strikes.tobytes())):08x}")


@dataclass(frozen=True, kw_only=True)
class MapUnit(Unit):
    """What a unit of a map knows.

    Args:
        task: What strikes, and at what.
        kept: The map.
    """

    task: AimTask
    kept: KeptMap

    def opened(self, threads: int | None) -> StrikeMap:
        """Return the map."""
        return opened(self.task.striker(threads), self.task.region, self.kept.folder)


@dataclass(frozen=True, kw_only=True)
class GoalsUnit(MapUnit):
    """Some of the goals, struck at in one shot, and after refinement.

    Args:
        first, last: Which of them.
    """

    first: int
    last: int

    def run(self, folder: Path | None, threads: int | None) -> dict[str, Any]:
        """Strike at them all together; of those that are missed in one shot, count the strikes to the first hit."""
        goals = self.task.goals().rows(np.arange(self.first, self.last))
        angles = None if goals.directions is None else self.task.region.angles(goals.positions, goals.directions)
        strike_map = self.opened(threads)
        with one_torch_thread():
            strike_map.striker.strike(strike_map.strikes(goals.rows(np.arange(1))), goals.rows(np.arange(1)))  # warm
            times = [_clocks()]
            chosen = strike_map.kept(goals)
            shot = strike_map.striker.strike(chosen, goals)
            times.append(_clocks())
            refined = strike_map.refined(goals)
            times.append(_clocks())
            best = strike_map.strikes(goals)
            by_joints = strike_map.striker.land(best, goals).hit
            missed = [goals.rows(np.array([i])) for i in np.flatnonzero(~shot.hit)]
            followed = {"candidates": [by_candidates(strike_map, goal) for goal in missed]}
            if self.task.corrected:
                followed["refinement"] = [by_refinement(strike_map, goal) for goal in missed]
        return {
            "positions": goals.positions.tolist(),
            "angles": None if angles is None else angles.tolist(),
            "one_shot": plain(shot),
            "one_shot_unchecked": (shot.hit & (chosen == best).all(axis=1)).tolist(),
            "one_shot_by_joints": by_joints.tolist(),
            "refined": plain(refined.struck),
            "strikes": refined.strikes.tolist(),
            "rollouts": refined.rollouts,
            "derivatives": refined.derivatives,
            "followed": followed,
            "seconds": np.diff(times, axis=0)[:, 0].tolist(),
            "processor_seconds": np.diff(times, axis=0)[:, 1].tolist(),
        }


@dataclass(frozen=True, kw_only=True)
class AloneUnit(MapUnit):
    """How long refined strikes take, one goal after the other.

    Args:
        count: Count of the first goals.
    """

    count: int

    def run(self, folder: Path | None, threads: int | None) -> dict[str, Any]:
        """Time each of them [s], by the clock and of processors."""
        goals, times = self.task.goals(), []
        strike_map = self.opened(threads)
        with one_torch_thread():
            strike_map.refined(goals.rows(np.array([0])))  # what is only done once
            for i in range(self.count):
                start = _clocks()
                strike_map.refined(goals.rows(np.array([i])))
                times.append(_clocks() - start)
        seconds, processors = np.transpose(times).tolist()
        return {"seconds": seconds, "processor_seconds": processors}


@dataclass(frozen=True, kw_only=True)
class MissedUnit(MapUnit):
    """A goal that refinement missed, given to other searches until one of them hits.

    Args:
        goal: Which.
        brief: Whether searches have a hundredth of the rollouts, and only the usual candidates are refined.
    """

    goal: int
    brief: bool = False

    def run(self, folder: Path | None, threads: int | None) -> dict[str, Any]:
        """Refine all candidates of the map, then search with gradients, then with CMA-ES."""
        goals, found = self.task.goals().rows(np.array([self.goal])), []
        strike_map = self.opened(threads)
        with one_torch_thread():
            refined = strike_map.refined(goals, tried=TRIED if self.brief else SHORTLIST)
            found.append(Found.of("candidates", refined.strikes, refined.struck))
            striker, target = strike_map.striker, Target.of(goals, 0)
            for method, cap in SEARCHES.items():
                if found[-1].hit:
                    break
                objective = Objective(
                    striker.rollout,
                    target,
                    t_stay=striker.t_stay,
                    bounds=striker.bounds,
                    limits=striker.limits.members,
                    max_trials=cap // 100 if self.brief else cap,
                    stop_at_hit=True,
                )
                result = search(objective, method, seed=self.goal).uninterrupted()
                strikes = np.array([result.strike.vector]) if result.strike else refined.strikes
                found.append(Found.of(method, strikes, striker.strike(strikes, goals)))
        return {"found": [vars(x) for x in found]}


@dataclass(frozen=True)
class Found:
    """What a search came to.

    Args:
        search: Name of the search.
        hit: Whether it hits.
        miss: [m]; None if it diverged.
        angle: [rad]; None if it diverged, or where none is asked for.
        within: Whether it keeps the limits.
        strike: Strike vector.
    """

    search: str
    hit: bool
    miss: float | None
    angle: float | None
    within: bool
    strike: list[float]

    @classmethod
    def of(cls, name: str, strikes: np.ndarray, struck: Landings) -> Found:
        """Return it of one strike (1, m)."""
        table = {key: value[0] for key, value in plain(struck).items()}
        return cls(name, **table, strike=strikes[0].tolist())


@dataclass(frozen=True, kw_only=True)
class ReplayUnit(Unit):
    """A strike in MuJoCo.

    Args:
        task: Which it is of.
        goal: Which of its goals.
        strike: Strike vector.
    """

    task: AimTask
    goal: int
    strike: tuple[float, ...]

    def run(self, folder: Path | None, threads: int | None) -> dict[str, Any]:
        """Play it, and say whether it hits there."""
        goals, task = self.task.goals().rows(np.array([self.goal])), self.task
        rollout = ReferenceRollout(task.model, task.controller, timestep=MUJOCO_STEP)
        path = rollout.trajectory(np.array(self.strike), t_stay=task.t_stay)
        if path.diverged:
            return {"hit": False, "miss": None, "angle": None}
        near = path.approach(goals.positions[0])
        hit = bool(goals.hit_by(near)[0])
        angle = None if goals.directions is None else float(goals.angle(near.velocity)[0])
        return {"hit": hit, "miss": float(near.distance[0]), "angle": angle}


@dataclass(frozen=True, kw_only=True)
class ClearanceUnit(ReplayUnit):
    """What arm and whip touch in a strike."""

    def run(self, folder: Path | None, threads: int | None) -> dict[str, Any]:
        """Say whether arm and whip keep clear of each other, and of the floor, too."""
        task = self.task
        path = task.striker(threads).rollout.trajectory(np.array(self.strike), t_stay=task.t_stay)
        floors = {"arm": None} | ({} if task.floor is None else {"floor": task.floor})
        return {name: Clearance(task.model, floor).violation(path) <= 0 for name, floor in floors.items()}


class Counting(Striker):
    """Counts strikes to the first hit; a derivative counts as a strike for each of the numbers it is taken by."""

    def __init__(self, striker: Striker) -> None:
        super().__init__(striker.rollout, bounds=striker.bounds, limits=striker.limits.members, t_stay=striker.t_stay)
        self.count, self.hit = 0, False

    def land(self, strikes: np.ndarray, goals: Goals) -> Landings:
        """Return what one strike comes to."""
        landed = super().land(strikes, goals)
        self.count += not self.hit
        self.hit = self.hit or bool(self.judged(strikes, landed).hit[0])
        return landed

    def derivatives(self, strikes: np.ndarray, goals: Goals) -> np.ndarray:
        """Return the exact derivatives of the residuals of one strike."""
        self.count += 0 if self.hit else strikes.shape[1]
        return super().derivatives(strikes, goals)


def _clocks() -> np.ndarray:
    """Return the time by the clock and of this process's processors [s], (2,)."""
    return np.array([time.monotonic(), time.process_time()])


def by_candidates(strike_map: StrikeMap, goal: Goals) -> dict[str, Any]:
    """Return how many strikes the first hit of one goal takes if each miss is followed by the next candidate."""
    strikes = strike_map.candidates(goal).strikes
    for first in range(0, len(strikes), _TOGETHER):
        some = strikes[first : first + _TOGETHER]
        hit = strike_map.striker.strike(some, goal.rows(np.zeros(len(some), int))).hit
        if hit.any():
            return {"trials": first + int(hit.argmax()) + 1, "hit": True}
    return {"trials": len(strikes), "hit": False}


def by_refinement(strike_map: StrikeMap, goal: Goals) -> dict[str, Any]:
    """Return how many strikes the first hit of one goal takes if each miss is followed by a correction."""
    counting, found = Counting(strike_map.striker), strike_map.candidates(goal).take(slice(TRIED))
    for i in range(len(found.strikes)):
        refine(counting, goal, found.strikes[i : i + 1], found.slopes[i : i + 1])
        if counting.hit:
            break
    return {"trials": counting.count, "hit": counting.hit}


def plain(struck: Landings) -> dict[str, list]:
    """Return what strikes came to as plain data: hit, miss [m], angle [rad], and whether within the limits.

    None: it diverged, or no angle is asked for.
    """
    miss, angle = ([float(x) if np.isfinite(x) else None for x in y] for y in (struck.distance, struck.angle))
    return {"hit": struck.hit.tolist(), "miss": miss, "angle": angle, "within": (struck.beyond <= 0).tolist()}
