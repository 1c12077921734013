"""How long `whiptool adapt` thinks between two strikes: identify from all recordings so far, plan, rehearse.

`python benchmarks/replan.py [--space] [--quick] [--json]`. Unknown whips of each family through emulated servos, the
tip seen with the error of tracked images, a slow movement first, then three strikes, whether or not they hit; in its
quick form one whip and one strike. With `--space` unknown ropes of each family on a UR5e, as in
`python -m whiptool.reproduce adapt --space --rows wiggle`: one wiggle, then a strike at each of three goals; in its
quick form one rope and one goal, for which hardly any search is needed. Besides seconds it prints how many strikes
MuJoCo rolls out in that time, measured in the same run with the paper's arm and whip.
"""

from __future__ import annotations

import argparse
import json
import platform
import sys
import time
from dataclasses import replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))  # where the folder `papers` is

import whiptool as wt
from papers.unknown.study import MATERIALS, SPACE, WhipUnit, families
from whiptool.adaptation.twins import FAMILIES
from whiptool.commands.adapt import prepare
from whiptool.commands.options.rig_options import AdaptOptions
from whiptool.rollout.reference import ReferenceRollout

TARGETS = ((1.1, 0.05), (1.15, 0.0), (1.15, 0.05), (1.2, -0.05))
STRIKE = wt.Strike.from_vector([-0.622, 0.221, 0.705, 2.122, 1.176])


Times = list[tuple[float, float]]  # seconds to learn and to plan, before each strike


def thoughts(family: str, seed: int, strikes: int, *, brief: bool = False) -> Times:
    """Seconds to learn and to plan before each strike of a whip in the plane, the movement's own plan left out.

    In brief the arm comes to its starts quickly, which costs the emulated servos fewer cycles.
    """
    options = AdaptOptions(
        target=TARGETS[seed % len(TARGETS)], port="twin", camera="points", family=family, seed=seed, wiggle=True
    )
    if brief:
        options = replace(options, approach_speed=1.0, settle=0.1)
    adaptation = prepare(options)
    adaptation.options = replace(adaptation.options, max_strikes=strikes, stop_at=0.0)
    steps = adaptation.run()
    learned = [0.0 if step.learned is None else step.learned.wall_time for step in steps]
    return [(before, step.plan.wall_time) for before, step in zip(learned[:-1], steps[1:], strict=True)]


def thoughts_in_space(family: str, seed: int, goals: int, *, brief: bool = False) -> Times:
    """Seconds to learn a wiggle and to plan the first strike at each of some goals with a rope in space."""
    unit, times = WhipUnit(model=SPACE, family=family, seed=seed, way="wiggle", brief=brief), []
    for number in unit.within()[:goals]:
        with TemporaryDirectory() as folder:
            adaptation = replace(unit.prepared(number), folder=Path(folder))
            adapter = adaptation.adapter()
            looked = adapter.tell(adaptation.port.strike(adapter.ask(), 0, None))
            began = time.perf_counter()
            adapter.ask()
            times.append((looked.learned.wall_time, time.perf_counter() - began))
    return times


def mujoco_strike(tries: int) -> float:
    """Seconds that the reference rollout takes for one strike, the least of so many tries."""
    rollout = ReferenceRollout(wt.preset("lemon2024"), wt.Controller(wt.oiac_preset("printed")))
    times = []
    for _ in range(tries):
        began = time.perf_counter()
        rollout.trajectory(STRIKE, t_stay=0.3)
        times.append(time.perf_counter() - began)
    return min(times)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--space", action="store_true")
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    if options.space:
        tried, think = families(SPACE), partial(thoughts_in_space, brief=options.quick)
        whips, strikes = (1, 1) if options.quick else (len(MATERIALS[SPACE]), 3)
    else:
        tried, think = tuple(FAMILIES), partial(thoughts, brief=options.quick)
        whips, strikes = (1, 1) if options.quick else (6, 3)
    if options.quick:
        tried = tried[:1]
    else:
        for family in tried:
            think(family, whips, strikes)  # what has to be compiled is
    one = mujoco_strike(1 if options.quick else 3)
    result = {"machine": platform.machine(), "whips": whips}
    for family in tried:
        rows = np.array([row for seed in range(whips) for row in think(family, seed, strikes)])
        both = rows.sum(axis=1)
        result[family] = {
            "learn": float(np.median(rows[:, 0])),
            "plan": float(np.median(rows[:, 1])),
            "both": float(np.median(both)),
            "both_90": float(np.quantile(both, 0.9)),
            "mujoco_strikes": float(np.median(both)) / one,
            "number": len(rows),
        }
        print(f"{family} done", file=sys.stderr)
    if options.json:
        print(json.dumps(result))
        return
    print(f"{'family':10s}{'strikes':>8s}{'learn':>9s}{'plan':>9s}{'both':>9s}{'90 %':>9s}   in MuJoCo strikes")
    for family in tried:
        r = result[family]
        seconds = "".join(f"{r[name]:7.2f} s" for name in ("learn", "plan", "both", "both_90"))
        print(f"{family:10s}{r['number']:8d}{seconds}{r['mujoco_strikes']:10.1f}")


if __name__ == "__main__":
    main()
