"""How often does a map of strikes hit a point at an arrival angle? A UR5e with a rope, in one shot and refined.

Goals are drawn in the region of "Point It, Strike It" (2026): 1.6 to 2.3 m from the base, 0.3 to 2.5 m above the ground
with the base at 1.7 m, up to 30 degrees to either side, at arrival angles from the full turn. A hit: the tip within
5 cm, its velocity within 10 degrees of the angle and 1 m/s along it, within all limits: those of the joints (of a
UR5e position, velocity and torque are known), and arm, whip and floor clear of each other over the whole strike, the
whip's fall included. `one_shot`: the map's strike as it is, the first of the best few that keeps the limits, which a
rollout of it says; `one_shot_unchecked`: the map's first, without any rollout; `one_shot_by_joints`: the same, were the
joints' limits all. `refined`: with rollouts, of the goals that any search of ours reached; goals that refinement misses
are given to all of the map's candidates, to the search with gradients and to CMA-ES, and those never reached are
listed. With --ignore-collisions what arm, whip and floor touch is not a part of a hit; it is looked at in some of the
strikes (`clear`). `seconds_per_goal`: from the goal to the refined strike, one goal at a time, all cores;
`processor_seconds_per_goal` likewise. Some of the strikes that hit are played again in MuJoCo and, with --oracle, with
a Cosserat rod (extra `oracle`). Published: 73.5 % in one shot, 92.1 % with the best of 64, other limits and rope.

    python benchmarks/aim.py [--quick] [--json] [--map FOLDER] [--goals N] [--replays N] [--oracle N] [--folder FOLDER]
                             [--ignore-collisions]

With --folder, what is done stands there, and an interrupted run continues. The map is built there
unless --map names the run folder of one:

    python -m whiptool.map build --model ur5e
        --sector 1.6 2.3 -1.4 0.8 30 --hit-radius 0.05 --arrival-angle -180 180 --cone 10 --least-speed 1
        --floor -1.7 --random-strikes 4096 --room 2 --rounds 2 --goals 800 --gate-strikes 16000

Goals are drawn all together: the first of them are a random sample.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import torch

sys.path.insert(0, str(Path(__file__).parents[1]))  # where the folder `papers` is

from papers.aim import published
from papers.aim.aimed import Aimed, aim
from papers.aim.report import figures
from papers.aim.task import AimTask, ur5e
from papers.aim.units import AloneUnit, KeptMap
from whiptool.comparison import Store
from whiptool.rollout.native import cores
from whiptool.strike_map import StrikeMap
from whiptool.strike_map.building import built

GOALS, REPLAYS, ALONE, TOUCHED = 5000, 100, 50, 100
QUICK_GOALS, QUICK_REPLAYS, QUICK_ALONE, QUICK_TOUCHED = 5, 1, 2, 2


def map_of(task: AimTask, given: Path | None, folder: Path) -> tuple[StrikeMap, Path]:
    """Return the map of a task, and its folder: the one that is given, or one built in the folder of results."""
    if given is None:
        place = folder / "map"
        place.mkdir(exist_ok=True)
        return built(task.building(), place), place
    from whiptool import load_map

    strike_map = load_map(given)
    check(strike_map, task)
    return strike_map, given


def check(strike_map: StrikeMap, task: AimTask) -> None:
    """Refuse a map of another robot, other goals or another accuracy."""
    theirs, ours = strike_map.striker, task.striker()
    same = {
        "model": theirs.rollout.model == task.model,
        "controller": theirs.rollout.controller == task.controller,
        "accuracy": (theirs.rollout.tolerance, theirs.rollout.timestep)
        == (ours.rollout.tolerance, ours.rollout.timestep),
        "zone": strike_map.region.zone == task.region.zone,
        "arrival": strike_map.region.rule == task.region.rule,
        "hit radius": strike_map.region.hit_radius == task.region.hit_radius,
        "limits": theirs.limits.members == ours.limits.members,
        "t_stay": theirs.t_stay == task.t_stay,
    }
    others = [name for name, alike in same.items() if not alike]
    if others:
        raise SystemExit(f"--map: of another {', '.join(others)} than this benchmark's; see --help for how to build it")


def report_of(aimed: Aimed, alone: dict[str, list[float]], answers: int) -> dict[str, Any]:
    """What is printed as JSON."""
    return {
        **aimed.summary(),
        "seconds_per_goal": float(np.median(alone["seconds"])),
        "seconds_per_goal_p95": float(np.percentile(alone["seconds"], 95)),
        "seconds_per_goal_largest": max(alone["seconds"]),
        "processor_seconds_per_goal": float(np.median(alone["processor_seconds"])),
        "processor_seconds_per_goal_p95": float(np.percentile(alone["processor_seconds"], 95)),
        "processor_seconds_per_goal_largest": max(alone["processor_seconds"]),
        "cores": cores(),
        "answers": answers,
        "published": {
            "goals": published.GOALS,
            "one_shot": published.ONE_SHOT,
            "best_of_64": published.BEST_OF_64,
        },
    }


def text_of(aimed: Aimed, report: dict[str, Any]) -> str:
    """What is printed for people."""
    rows = figures(aimed)
    rows.append(["answers of the map", "-", f"{report['answers']:,}"])
    for name, words in (
        ("", f"seconds a goal, one at a time, {report['cores']} cores"),
        ("processor_", "... of processors"),
    ):
        key = f"{name}seconds_per_goal"
        three = f"{report[key]:.3f} s, {report[f'{key}_p95']:.3f} s, {report[f'{key}_largest']:.3f} s"
        rows.append([f"{words}: median, 95 %, largest", "-", three])
    rows.append(["... all together", "-", f"{report['seconds_per_goal_together']:.3f} s"])
    for name in ("one_shot", "refined"):
        low, high = report[f"{name}_interval"]
        rows.append([f"95 % interval of `{name}`", "-", f"{low:.2%} to {high:.2%}"])
    lines = [f"{name:58s} {theirs:>9s}   {ours}" for name, theirs, ours in rows]
    for row in report["never"]:
        place = " ".join(f"{x:.3f}" for x in row["position"])
        lines.append(f"never reached: goal {row['goal']} at {place} m, {row['arrival_angle']:.1f} degrees")
    return "\n".join(lines)


def main() -> None:
    """Strike and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="a small map, and few goals")
    parser.add_argument("--json", action="store_true", help="one JSON object instead of a table")
    parser.add_argument("--map", type=Path, help="run folder of a map that was built; default: one is built")
    parser.add_argument("--goals", type=int, help=f"how many goals; default: {GOALS}, with --quick {QUICK_GOALS}")
    parser.add_argument("--replays", type=int, help=f"strikes played in MuJoCo; default: {REPLAYS}")
    parser.add_argument("--oracle", type=int, default=0, help="of these, played with a Cosserat rod; default: 0")
    parser.add_argument("--ignore-collisions", action="store_true", help="arm and whip may go through all")
    parser.add_argument("--folder", type=Path, help="of what is found, to go on from")
    arguments = parser.parse_args()
    task = ur5e(quick=arguments.quick, clear=not arguments.ignore_collisions)
    usual = (GOALS, REPLAYS, ALONE, TOUCHED)
    if arguments.quick:
        usual = (QUICK_GOALS, QUICK_REPLAYS, QUICK_ALONE, QUICK_TOUCHED)
    goals, replays = (b if a is None else a for a, b in zip((arguments.goals, arguments.replays), usual, strict=False))
    if not 1 <= goals <= task.drawn or min(replays, arguments.oracle) < 0:
        raise SystemExit(f"--goals: 1 to {task.drawn}; --replays, --oracle: 0 or more")
    torch.set_num_threads(1)  # the same result on any number of cores
    with tempfile.TemporaryDirectory() as passing:
        folder = arguments.folder or Path(passing)
        folder.mkdir(parents=True, exist_ok=True)
        store = Store(folder)
        strike_map, place = map_of(task, arguments.map, folder)
        counts = {"goals": goals, "replays": replays, "oracle": arguments.oracle, "touched": usual[3]}
        aimed = aim(task, strike_map, place, store, **counts, brief=arguments.quick)
        unit = AloneUnit(task=task, kept=KeptMap.of(strike_map, place), count=min(goals, usual[2]))
        alone = store.results([unit], desc="one at a time")[unit.key]
    report = report_of(aimed, alone, len(strike_map.answers))
    print(json.dumps(report) if arguments.json else text_of(aimed, report))


if __name__ == "__main__":
    main()
