"""What came of the goals of a task: shares that are hit, how near, how long it took, and which were never reached."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import binomtest

from papers.aim.oracle import OracleUnit
from papers.aim.task import AimTask
from papers.aim.units import ClearanceUnit, GoalsUnit, KeptMap, MissedUnit, ReplayUnit
from whiptool.comparison import Store
from whiptool.strike_map.strike_map import StrikeMap

CHUNK = 50  # goals of a unit
TOGETHER = 5  # strikes of a unit of the Cosserat oracle


@dataclass(frozen=True, eq=False)
class Shots:
    """Strikes at B goals.

    Args:
        hit: Whether each hits, (B,).
        miss: [m], (B,); infinite if it diverged.
        angle: To the direction [rad], (B,); NaN without a direction.
        within: Whether it keeps the limits, (B,).
    """

    hit: np.ndarray
    miss: np.ndarray
    angle: np.ndarray
    within: np.ndarray

    @classmethod
    def of(cls, tables: Sequence[dict[str, list]]) -> Shots:
        """Join what units say."""
        whole = {name: [x for table in tables for x in table[name]] for name in ("hit", "miss", "angle", "within")}
        miss, angle = (np.array(whole[name], float) for name in ("miss", "angle"))  # None: NaN
        return cls(
            np.array(whole["hit"], bool), np.where(np.isnan(miss), np.inf, miss), angle, np.array(whole["within"])
        )


@dataclass(frozen=True, eq=False)
class Aimed:
    """What came of B goals.

    Args:
        positions: [m], (B, d).
        angles: Angles of arrival [rad], (B,); NaN where none is asked for.
        one_shot, refined: The best of the map's own strikes that keep the limits, and refined ones.
        one_shot_unchecked: Which of the map's best strikes hit, were they taken without a look at the limits, (B,).
        one_shot_by_joints: Which of these would hit if the limits of joints were all, (B,).
        strikes: The refined ones, (B, m).
        rollouts, derivatives: Rollouts and derivatives of refinement, in all.
        followed: Trials and hits of the goals that are missed in one shot, by what follows a miss.
        seconds, processor_seconds: Seconds and processor seconds of one shot and of refinement, in all, (2,).
        missed: What other searches came to, by the number of the goal that refinement missed.
        replayed: What came in MuJoCo, by the number of the goal.
        oracle: What came with a Cosserat rod, by the number of the goal.
        clear: Whether arm and whip keep clear of each other, and of the floor, too, by the number of the goal.
    """

    positions: np.ndarray
    angles: np.ndarray
    one_shot: Shots
    refined: Shots
    one_shot_unchecked: np.ndarray
    one_shot_by_joints: np.ndarray
    strikes: np.ndarray
    rollouts: int
    derivatives: int
    followed: dict[str, list[dict[str, Any]]]
    seconds: np.ndarray
    processor_seconds: np.ndarray
    missed: dict[int, list[dict[str, Any]]] = field(default_factory=dict)
    replayed: dict[int, dict[str, Any]] = field(default_factory=dict)
    oracle: dict[int, dict[str, Any]] = field(default_factory=dict)
    clear: dict[int, dict[str, bool]] = field(default_factory=dict)

    @classmethod
    def of(cls, results: Sequence[dict[str, Any]]) -> Aimed:
        """Join what units of goals came to, in order."""
        positions = np.concatenate([np.array(r["positions"]) for r in results])
        without = np.full(len(positions), np.nan)
        ways = results[0]["followed"]
        return cls(
            positions=positions,
            angles=without if results[0]["angles"] is None else np.concatenate([r["angles"] for r in results]),
            one_shot=Shots.of([r["one_shot"] for r in results]),
            refined=Shots.of([r["refined"] for r in results]),
            one_shot_unchecked=np.concatenate([np.array(r["one_shot_unchecked"], bool) for r in results]),
            one_shot_by_joints=np.concatenate([np.array(r["one_shot_by_joints"], bool) for r in results]),
            strikes=np.concatenate([np.array(r["strikes"]) for r in results]),
            rollouts=sum(r["rollouts"] for r in results),
            derivatives=sum(r["derivatives"] for r in results),
            followed={way: [x for r in results for x in r["followed"][way]] for way in ways},
            seconds=np.sum([r["seconds"] for r in results], axis=0),
            processor_seconds=np.sum([r["processor_seconds"] for r in results], axis=0),
        )

    def __len__(self) -> int:
        return len(self.positions)

    @property
    def reached(self) -> np.ndarray:
        """Whether any search has reached each goal, (B,)."""
        reached = self.one_shot.hit | self.refined.hit
        missed_at_first = np.flatnonzero(~self.one_shot.hit)
        for trials in self.followed.values():
            reached[missed_at_first] |= np.array([x["hit"] for x in trials], bool)
        for goal, found in self.missed.items():
            reached[goal] |= any(x["hit"] for x in found)
        return reached

    @property
    def never(self) -> list[dict[str, Any]]:
        """The goals that no search reached: where, at which angle [degrees], and the nearest hit of the place."""
        rows = []
        for i in np.flatnonzero(~self.reached):
            angle = float(np.degrees(self.angles[i]))
            rows.append({"goal": int(i), "position": self.positions[i].tolist(), "arrival_angle": angle})
        return rows

    def _elsewhere(self, played: dict[int, dict[str, Any]]) -> dict[str, Any]:
        """Return what refined strikes came to in another simulator: hits, and of some figures median and largest.

        They are the miss [m], the angle [rad] and by how much the miss differs [m], of strikes that did not diverge
        there; None without them.
        """
        ended = {i: x for i, x in played.items() if x["miss"] is not None}
        of = {
            "miss": [x["miss"] for x in ended.values()],
            "angle": [x["angle"] for x in ended.values() if x["angle"] is not None],
            "difference": [abs(x["miss"] - self.refined.miss[i]) for i, x in ended.items()],
        }
        table: dict[str, Any] = {"strikes": len(played), "hits": sum(x["hit"] for x in played.values())}
        for name, values in of.items():
            table[f"median_{name}"] = float(np.median(values)) if values else None
            table[f"largest_{name}"] = max(values, default=None)
        return table

    def mean_trials(self, way: str) -> float:
        """Return the mean number of strikes to the first hit, if what follows a miss is one of `followed`.

        Args:
            way: Which of them; goals that are never hit so count with all strikes that were tried.
        """
        hits = int(self.one_shot.hit.sum())
        return (hits + sum(x["trials"] for x in self.followed[way])) / len(self)

    def summary(self) -> dict[str, Any]:
        """Return shares, medians and times; `refined` is the share of the goals that any search has reached."""
        hit, reached = self.refined.hit, self.reached
        return {
            "goals": len(self),
            "one_shot": float(self.one_shot.hit.mean()),
            "one_shot_interval": interval(self.one_shot.hit.sum(), len(self)),
            "one_shot_unchecked": float(self.one_shot_unchecked.mean()),
            "one_shot_by_joints": float(self.one_shot_by_joints.mean()),
            "one_shot_median_miss": float(np.median(self.one_shot.miss)),
            "one_shot_within_limits": float(self.one_shot.within.mean()),
            "refined": float(hit.sum() / max(1, reached.sum())),
            "refined_interval": interval(hit.sum(), max(1, reached.sum())),
            "refined_of_all": float(hit.mean()),
            "median_miss": float(np.median(self.refined.miss)),
            "p99_miss": float(np.percentile(self.refined.miss, 99, method="higher")),
            "refined_within_limits": float(self.refined.within.mean()),
            "rollouts_per_goal": self.rollouts / len(self),
            "derivatives_per_goal": self.derivatives / len(self),
            "seconds_per_goal_together": float(self.seconds[1] / len(self)),
            "seconds_per_goal_one_shot": float(self.seconds[0] / len(self)),
            "processor_seconds_per_goal_together": float(self.processor_seconds[1] / len(self)),
            "reached_by_others": int(reached.sum() - (self.one_shot.hit | hit).sum()),
            "never_reached": float(1 - reached.mean()),
            "never": self.never,
            "mean_trials": {way: self.mean_trials(way) for way in self.followed},
            "in_mujoco": self._elsewhere(self.replayed),
            "in_cosserat": self._elsewhere(self.oracle),
            "clear": {"strikes": len(self.clear)}
            | {
                name: float(np.mean([x[name] for x in self.clear.values()]))
                for name in next(iter(self.clear.values()), {})
            },
        }


def aim(
    task: AimTask,
    strike_map: StrikeMap,
    folder: Path,
    store: Store,
    *,
    goals: int,
    replays: int = 0,
    oracle: int = 0,
    touched: int = 0,
    brief: bool = False,
) -> Aimed:
    """Return what comes of the first goals of a task; what the store has is not done again.

    Args:
        task: See there.
        strike_map: Strike map of the task.
        folder: Folder of the map.
        store: Store of the results.
        goals: Number of goals.
        replays: Strikes that are replayed in MuJoCo, the first that hit.
        oracle: Of the same, how many are played with a Cosserat rod.
        touched: How many strikes are checked for collisions if collisions are not among the task's limits.
        brief: Whether other searches, of what refinement misses, are short.
    """
    firsts = range(0, min(goals, task.drawn), CHUNK)
    of_map: dict[str, Any] = {"task": task, "kept": KeptMap.of(strike_map, folder)}
    units = [GoalsUnit(**of_map, first=i, last=min(i + CHUNK, goals, task.drawn)) for i in firsts]
    results = store.results(units, desc=f"goals of {task.name}")
    aimed = Aimed.of([results[unit.key] for unit in units])
    others = [MissedUnit(**of_map, goal=int(i), brief=brief) for i in np.flatnonzero(~aimed.refined.hit)]
    found = store.results(others, desc="goals that refinement missed")
    aimed.missed.update({unit.goal: found[unit.key]["found"] for unit in others})
    hits = np.flatnonzero(aimed.refined.hit).tolist()  # goals are drawn at random: the first are as good as any
    strikes = {i: tuple(aimed.strikes[i].tolist()) for i in hits}
    played = [ReplayUnit(task=task, goal=i, strike=strikes[i]) for i in hits[:replays]]
    looked = [ClearanceUnit(task=task, goal=i, strike=strikes[i]) for i in ([] if task.clear else hits[:touched])]
    swung = [
        OracleUnit(task=task, goals=some, strikes=tuple(strikes[i] for i in some))
        for some in (tuple(hits[first : min(first + TOGETHER, oracle)]) for first in range(0, oracle, TOGETHER))
        if some
    ]
    seen = store.results([*played, *looked, *swung], desc="other simulators")
    aimed.replayed.update({unit.goal: seen[unit.key] for unit in played})
    for unit in swung:
        aimed.oracle.update(zip(unit.goals, seen[unit.key]["played"], strict=True))
    aimed.clear.update({unit.goal: seen[unit.key] for unit in looked})
    return aimed


def interval(count: int, of: int) -> list[float]:
    """Return the 95 % interval of a share that was counted (Wilson 1927)."""
    found = binomtest(int(count), int(of)).proportion_ci(method="wilson")
    return [float(found.low), float(found.high)]
