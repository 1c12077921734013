"""What do limits cost a search, and what does it help that it knows them? Random targets of the UR5e and the Panda.

Targets and robots are those of `reach.py`, searched by gradients until the tip comes within 0.9 mm, under position
control. Limits are those of the joints, a tenth of them kept free, and the distances of arm, whip and a floor 0.5 m
below the base. Searches are compared in three ways: `joints`, with the joints' limits alone; `judged`, with all limits,
of which the search knows the commanded speeds alone; `kept`, with all limits, of which it keeps beforehand what are
smooth functions of a strike. Of strikes that were found the whole trajectory is judged again, and samples at 500 Hz.

    python benchmarks/limits.py [--quick] [--json] [--out FILE.jsonl] [--targets N]

With --out, what is found stands in that file, a line a search, and an interrupted run continues.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import time
from pathlib import Path

import numpy as np
from reach import MODELS, RADIUS, targets, warmed
from tqdm import tqdm

from whiptool.goals.target import Target
from whiptool.impedance import Controller, PositionControl
from whiptool.limits.all_limits import AllLimits
from whiptool.limits.arm_limits import ArmLimits
from whiptool.limits.clearance import Clearance
from whiptool.limits.limits import CommandLimits
from whiptool.models import Model
from whiptool.models.joint_trajectory import JointTrajectory
from whiptool.objective import Objective
from whiptool.optimizers import search
from whiptool.rollout import CompiledRollout

WAYS = ("joints", "judged", "kept")
KEEP_FREE, FLOOR = 0.1, -0.5  # 1, [m]
SEARCHED = 0.9 * RADIUS  # what the integration errs by is left free
MOST = 3000  # trials a target


class Guessing(Objective):
    """An objective that tells searches of the commanded speeds alone."""

    @property
    def smooth(self) -> tuple[CommandLimits, ...]:
        """The limits of velocity."""
        return tuple(
            CommandLimits(tuple(dataclasses.replace(x, acceleration=np.inf, jerk=np.inf) for x in c.joints), c.share)
            for c in self.limits.commands
        )

    def admissible(self, strikes: np.ndarray) -> np.ndarray:
        """Strikes whose commanded speeds are within the limits."""
        for command in self.smooth:
            strikes = command.shortened(strikes)
        return np.clip(strikes, *self.bounds.box)


def searched(model: Model, way: str, target: np.ndarray, seed: int) -> dict:
    """What the search of one target came to."""
    joints = ArmLimits.of(model.arm, keep_free=KEEP_FREE, prescribed=True)
    limits = [joints] if way == "joints" else [joints, Clearance(model, FLOOR)]
    rollout = CompiledRollout(model, Controller(PositionControl()))
    goal = Target(tuple(target.tolist()), SEARCHED)
    kind = Guessing if way == "judged" else Objective
    objective = kind(rollout, goal, limits=limits, max_trials=MOST, stop_at_hit=True)
    wall, cpu = time.perf_counter(), time.process_time()
    result = search(objective, "gradient", seed=seed)
    wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    assert result.strike is not None
    assert result.outcome is not None
    path = rollout.trajectory(result.strike)
    sampled = JointTrajectory.of_strike(result.strike, model.arm.joints, limits=joints.joints, rest=0.1)
    all_of_them = AllLimits([joints, Clearance(model, FLOOR)])
    return {
        "hit": result.outcome.hit,
        "trials": result.n_trials,
        "refused": objective.n_refused,
        "seconds": wall,
        "processor_seconds": cpu,
        "within_all": all_of_them.violation(path, result.strike) <= 0,
        "samples_within": sampled.beyond(joints.joints) is None,
    }


def report_of(rows: list[dict]) -> dict:
    """Shares and medians over targets."""
    hits = [row for row in rows if row["hit"]]
    return {
        "targets": len(rows),
        "share_hit": len(hits) / len(rows),
        "share_refused": sum(row["refused"] for row in rows) / sum(row["trials"] for row in rows),
        "median_trials": float(np.median([row["trials"] for row in rows])),
        "mean_trials": float(np.mean([row["trials"] for row in rows])),
        "median_seconds": float(np.median([row["seconds"] for row in rows])),
        "median_processor_seconds": float(np.median([row["processor_seconds"] for row in rows])),
        "mean_processor_seconds": float(np.mean([row["processor_seconds"] for row in rows])),
        "share_of_hits_within_all": float(np.mean([row["within_all"] for row in hits])) if hits else None,
        "share_of_samples_within": float(np.mean([row["samples_within"] for row in hits])) if hits else None,
    }


def main() -> None:
    """Search and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="2 targets a robot")
    parser.add_argument("--json", action="store_true", help="one JSON object instead of a table")
    parser.add_argument("--out", type=Path, help="file of what is found, a line a search, to go on from")
    parser.add_argument("--targets", type=int, default=100, help="targets a robot")
    arguments = parser.parse_args()
    points = targets(2 if arguments.quick else arguments.targets)
    known = arguments.out.read_text().splitlines() if arguments.out and arguments.out.exists() else []
    done = {(row["model"], row["way"], row["target"]): row for row in map(json.loads, known)}
    todo = [(name, way, i) for i in range(len(points)) for name in MODELS for way in WAYS]
    for name, way, i in tqdm([key for key in todo if key not in done], leave=False):
        found = searched(warmed(name), way, points[i], seed=i)
        done[name, way, i] = {"model": name, "way": way, "target": i, **found}
        if arguments.out:
            with arguments.out.open("a") as file:
                file.write(json.dumps(done[name, way, i]) + "\n")
    report = {
        name: {way: report_of([done[name, way, i] for i in range(len(points))]) for way in WAYS} for name in MODELS
    }
    if arguments.json:
        print(json.dumps({"radius": SEARCHED, "keep_free": KEEP_FREE, "floor": FLOOR, **report}))
        return
    for name, ways in report.items():
        for way, r in ways.items():
            print(
                f"{name:6s} {way:7s} {r['targets']} targets, {r['share_hit']:.0%} hit; {r['share_refused']:.1%} of the "
                f"trials refused, {r['median_trials']:g} trials (median), {r['mean_trials']:.0f} (mean); "
                f"{r['median_processor_seconds']:.2f} s of processors (median), "
                f"{r['mean_processor_seconds']:.2f} s (mean)"
                + ("" if r["share_of_hits_within_all"] is None else f"; {r['share_of_hits_within_all']:.0%} within all")
            )


if __name__ == "__main__":
    main()
