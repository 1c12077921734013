"""Joint space and hand space: trials to hit with a UR5e and a Panda, whose strikes are described in different ways.

`python -m whiptool.reproduce spaces`. The paper's Sect. 4.2 names end-effector space as the next step; nothing that is
published compares with these figures.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from papers.aim.published import CONTROLLER, MODEL
from papers.context import Context
from whiptool import CompiledRollout, Controller, Objective, Target, preset, search
from whiptool.comparison import Store
from whiptool.comparison.units import Unit
from whiptool.impedance import HandControl, PositionControl
from whiptool.limits.arm_limits import ArmLimits
from whiptool.rollout.batch import TOLERANCE
from whiptool.viz.report import Section, Table, Text
from whiptool.words import counted

__all__ = ["CONTROLLER", "MODEL", "SUBTITLE", "TITLE", "SpaceStudy", "SpaceUnit", "facts", "sections"]

TITLE = "What describes a strike: the joints, or the hand"
SUBTITLE = "Trials to hit the same targets with a UR5e and a Panda, by four searches, in joint space and in hand space."
ROBOTS, METHODS = ("ur5e", "panda"), ("directl", "cmaes", "gradient", "sac")
SPACES = {"joint": None, "hand": HandControl()}
RADIUS, NEAR, FAR = 0.05, 0.9, 1.6  # [m]
TARGETS, CAP, TARGET_SEED = 10, 600, 1  # targets, trials at each, seed
QUICK_TARGETS, QUICK_CAP = 1, 80


def targets(count: int) -> np.ndarray:
    """Return random targets (count, 3) [m], uniform in the half shell before the robot and above the ground."""
    rng, found = np.random.default_rng(TARGET_SEED), []
    while len(found) < count:
        point = rng.uniform((0, -FAR, 0), FAR)
        if NEAR <= np.linalg.norm(point) <= FAR:
            found.append(point)
    return np.array(found)


@lru_cache(maxsize=8)
def simulator(robot: str, space: str, threads: int | None) -> CompiledRollout:
    """Return the rollout of a robot whose joints follow their path exactly, its strikes described in this space."""
    controller = Controller(PositionControl(), hand=SPACES[space])
    return CompiledRollout(preset(robot), controller, threads=threads)


@dataclass(frozen=True, kw_only=True)
class SpaceUnit(Unit):
    """One search of one target, until the tip comes near enough.

    Args:
        robot, space, method: What strikes, what describes its strikes, and what searches.
        target: Which.
        cap: Trials at most; a strike that is refused is one, and so is one with its derivatives.
    """

    robot: str
    space: str
    method: str
    target: int
    cap: int

    def run(self, folder: Path | None, threads: int | None) -> dict[str, Any]:
        """Search, and return whether it hit, after how many trials, how many were refused, the miss [m], the time [s],
        and the strike."""
        rollout = simulator(self.robot, self.space, threads)
        goal = Target(tuple(targets(self.target + 1)[-1].tolist()), RADIUS)
        limits = ArmLimits.of(rollout.model.arm, prescribed=True)
        objective = Objective(rollout, goal, limits=limits, max_trials=self.cap, stop_at_hit=True)
        found = search(objective, self.method, seed=self.target).uninterrupted()
        return {
            "hit": found.hit,
            "trials": found.first_hit if found.hit else found.n_trials,
            "refused": objective.n_refused,
            "miss": None if found.outcome is None else found.outcome.miss_distance,
            "wall_time": found.wall_time,
            "strike": None if found.strike is None else found.strike.vector.tolist(),
        }


@dataclass(frozen=True, eq=False)
class SpaceStudy:
    """All searches.

    Args:
        targets: Number of targets.
        cap: Trials at most at each.
        found: Results of units by key.
    """

    targets: int
    cap: int
    found: Mapping[str, Mapping[str, Any]]

    @classmethod
    def of(cls, store: Store, count: int = TARGETS, cap: int = CAP) -> SpaceStudy:
        """Return the study of so many targets, and trials at each, whose results a store has; what is missing is
        searched for."""
        each = product(range(count), ROBOTS, METHODS, SPACES)  # target after target: a part of it is a smaller study
        units = [SpaceUnit(robot=r, space=s, method=m, target=i, cap=cap) for i, r, m, s in each]
        return cls(count, cap, store.results(units, desc="spaces"))

    def of_targets(self, robot: str, space: str, method: str) -> list[Mapping[str, Any]]:
        """Return what came of one search at all targets."""
        unit = {"robot": robot, "space": space, "method": method, "cap": self.cap}
        return [self.found[SpaceUnit(**unit, target=i).key] for i in range(self.targets)]

    def hits(self, robot: str, space: str) -> np.ndarray:
        """Return which targets any of the searches hit, (targets,)."""
        return np.any([[x["hit"] for x in self.of_targets(robot, space, m)] for m in METHODS], axis=0)

    def summary(self) -> dict[str, Any]:
        """Return the figures: shares of hits, trials to hit with all of them where there was none, and so on."""
        numbers: dict[str, Any] = {"targets": self.targets, "cap": self.cap}
        for robot in ROBOTS:
            numbers[robot] = {s: {m: self._figures(robot, s, m) for m in METHODS} for s in SPACES}
            all_hit = np.all([self.hits(robot, s) for s in SPACES], axis=0)
            numbers[robot]["hit_in_all_spaces"] = int(all_hit.sum())
        numbers["hit_in_all_spaces_by_all_robots"] = int(self.hit_everywhere().sum())
        return numbers

    def hit_everywhere(self) -> np.ndarray:
        """Return which targets are hit in all spaces on all robots, (targets,)."""
        return np.all([self.hits(r, s) for r, s in product(ROBOTS, SPACES)], axis=0)

    def _figures(self, robot: str, space: str, method: str) -> dict[str, float]:
        rows = self.of_targets(robot, space, method)
        trials = [row["trials"] if row["hit"] else self.cap for row in rows]
        return {
            "hits": sum(row["hit"] for row in rows),
            "median_trials": float(np.median(trials)),
            "mean_trials": float(np.mean(trials)),
            "refused": sum(row["refused"] for row in rows) / sum(row["trials"] for row in rows),
            "median_seconds": float(np.median([row["wall_time"] for row in rows])),
        }

    def table(self) -> list[list[str]]:
        """Return the table of trials, a row for each robot and method, two columns for each space."""
        head = ["", "", *(f"{space} ({_width(ROBOTS[0], space)}, {_width(ROBOTS[1], space)}): {what}"
                          for space in SPACES for what in ("hits", "trials", "refused"))]  # fmt: skip
        rows, numbers = [head], self.summary()
        for robot, method in product(ROBOTS, METHODS):
            row = [robot, method]
            for space in SPACES:
                x = numbers[robot][space][method]
                row += [f"{x['hits']} of {self.targets}", f"{x['median_trials']:.0f} ({x['mean_trials']:.0f})",
                        f"{x['refused']:.0%}"]  # fmt: skip
            rows.append(row)
        return rows


def _width(robot: str, space: str) -> int:
    """Return how many numbers a strike of a robot has."""
    return Controller(PositionControl(), hand=SPACES[space]).strike_space(preset(robot).arm).width


def facts() -> dict[str, str]:
    """What was run, for the report's head."""
    from whiptool.runs import code_version

    return {
        "code": f"whiptool {code_version()}",
        "model": f"{' and '.join(ROBOTS)}: stick and rope of 1 m in {MODEL.whip.N} rods; joints on their reference "
        f"(position control), distances right to {1e3 * TOLERANCE:g} mm",
        "targets": f"uniform in the shell of {NEAR:g} to {FAR:g} m around the base, before it and above the "
        f"ground; hit within {100 * RADIUS:g} cm",
        "limits": "of the arm: position, velocity, torque and what else the model has",
    }


def sections(context: Context) -> list[Section]:
    """The table of trials."""
    size = (QUICK_TARGETS, QUICK_CAP) if context.quick else (TARGETS, CAP)
    study = SpaceStudy.of(context.store, *size)
    numbers = study.summary()
    about = (
        f"The same targets, searched until the tip comes within {100 * RADIUS:g} cm, or for "
        f"{counted(study.cap, 'trial')}. In joint space a strike says where the joints begin and end; in hand space "
        "where the hand does, on a straight line between; the duration is the last number of both. Each search has the "
        "space's usual bounds. Trials are those to the first hit, median (mean), all of them where there was none; a "
        "strike that is refused is a trial, and one with its derivatives is one. Refused: the share of trials that the "
        f"arm cannot make or that go beyond its limits. Of {counted(study.targets, 'target')} "
        f"{numbers['hit_in_all_spaces_by_all_robots']} are hit in both spaces by both robots."
    )
    caption = "In brackets how many numbers a strike has, of the UR5e and of the Panda."
    return [Section("Trials to hit in joint space and in hand space", [Text(about), Table(study.table(), caption)])]
