"""Trials to hit in joint space and in hand space: UR5e and Panda, DIRECT-L, CMA-ES, gradient and SAC.

Targets of the robots with stick and rope of rods are uniform in the shell of 0.9 to 1.6 m around the base, above the
ground and in front of it, the same for all. Joints follow their reference exactly (position control), in hand space
along the hand's straight path; limits of position, velocity and torque are kept. A refused strike is a trial. Each
target is searched by each method until the tip comes within 5 cm, or 600 trials are used up; bounds are the usual ones.

    python benchmarks/spaces.py [--quick] [--json] [--out FILE.jsonl]

With --out, what is found stands in that file, a line a search, and a run that was broken off goes on where it was.
"""

from __future__ import annotations

import argparse
import itertools
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
from tqdm import tqdm

from whiptool.impedance import Controller, HandControl, PositionControl
from whiptool.models import preset
from whiptool.models.arm_limits import ArmLimits
from whiptool.objective import Objective
from whiptool.optimizers import search
from whiptool.rollout import CompiledRollout
from whiptool.target import Target

MODELS, SPACES = ("ur5e", "panda"), ("joint", "hand")
METHODS = ("directl", "cmaes", "gradient", "sac")
RADIUS, NEAR, FAR = 0.05, 0.9, 1.6  # [m]
TIMESTEP, MOST = 1.5e-3, 600  # [s], trials


def targets(count: int) -> np.ndarray:
    """Random targets (count, 3) [m], uniform in the half shell before the robot and above the ground."""
    rng, found = np.random.default_rng(1), []
    while len(found) < count:
        point = rng.uniform((0, -FAR, 0), FAR)
        if NEAR <= np.linalg.norm(point) <= FAR:
            found.append(point)
    return np.array(found)


def rollout_of(name: str, space: str) -> CompiledRollout:
    """Joints on their reference, told by the joints or by the hand."""
    model = preset(name)
    model = replace(model, whip=replace(model.whip, joints="rod", node_inertia=0.0))
    controller = Controller(PositionControl(), hand=HandControl() if space == "hand" else None)
    return CompiledRollout(model, controller, timestep=TIMESTEP)


def searched(rollout: CompiledRollout, method: str, target: np.ndarray, seed: int) -> dict:
    """What one search came to."""
    goal, limits = Target(tuple(target.tolist()), RADIUS), ArmLimits.of(rollout.model.arm)
    objective = Objective(rollout, goal, limits=limits, max_trials=MOST, stop_at_hit=True)
    result = search(objective, method, seed=seed)
    assert result.outcome is not None
    return {
        "hit": result.outcome.hit,
        "trials": result.first_hit or result.n_trials,
        "refused": objective.n_refused,
        "miss": result.outcome.miss_distance,
        "seconds": result.wall_time,
    }


def report_of(rows: list[dict]) -> dict:
    """Share of hits, and median trials, those without a hit counted as all of them."""
    return {
        "searches": len(rows),
        "share_hit": float(np.mean([row["hit"] for row in rows])),
        "median_trials": float(np.median([row["trials"] if row["hit"] else MOST for row in rows])),
        "mean_refused": float(np.mean([row["refused"] / row["trials"] for row in rows])),
        "median_seconds": float(np.median([row["seconds"] for row in rows])),
    }


def main() -> None:
    """Search and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="two targets")
    parser.add_argument("--json", action="store_true", help="one JSON object instead of a table")
    parser.add_argument("--out", type=Path, help="file of what is found, a line a search, to go on from")
    arguments = parser.parse_args()
    points = targets(2 if arguments.quick else 20)
    known = arguments.out.read_text().splitlines() if arguments.out and arguments.out.exists() else []
    done = {tuple(row["of"]): row for row in map(json.loads, known)}
    rollouts = {pair: rollout_of(*pair) for pair in itertools.product(MODELS, SPACES)}
    units = list(itertools.product(MODELS, SPACES, METHODS, range(len(points))))
    for name, space, method, i in tqdm(units, leave=False):
        if (name, space, method, i) in done:
            continue
        row = {"of": [name, space, method, i], **searched(rollouts[name, space], method, points[i], i)}
        done[name, space, method, i] = row
        if arguments.out:
            with arguments.out.open("a") as file:
                file.write(json.dumps(row) + "\n")
    report = {
        name: {
            space: {m: report_of([done[name, space, m, i] for i in range(len(points))]) for m in METHODS}
            for space in SPACES
        }
        for name in MODELS
    }
    if arguments.json:
        print(json.dumps(report))
        return
    print("| robot | space | method | hits | trials (median) | refused |\n|---|---|---|---|---|---|")
    for name, space, method in itertools.product(MODELS, SPACES, METHODS):
        r = report[name][space][method]
        print(f"| {name} | {space} | {method} | {r['share_hit']:.0%} of {r['searches']} | {r['median_trials']:.0f} | "
              f"{r['mean_refused']:.0%} |")  # fmt: skip


if __name__ == "__main__":
    main()
