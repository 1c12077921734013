"""How long `whiptool adapt` thinks between two strikes: identify from all recordings so far, plan, rehearse.

`python benchmarks/replan.py [--quick] [--json]`. Unknown whips of each family through emulated servos, the tip seen
with the error of tracked images, a slow movement first, then three strikes, whether or not they hit; in its quick form
one whip and two strikes. Beside seconds it prints how many strikes MuJoCo rolls out in that time, measured in the same
run.
"""

from __future__ import annotations

import argparse
import json
import platform
import sys
import time
from dataclasses import replace

import numpy as np

import whiptool as wt
from whiptool.adaptation.twins import FAMILIES
from whiptool.commands.adapt import AdaptOptions, prepare
from whiptool.rollout.reference import ReferenceRollout

TARGETS = ((1.1, 0.05), (1.15, 0.0), (1.15, 0.05), (1.2, -0.05))
STRIKE = wt.Strike.from_vector([-0.622, 0.221, 0.705, 2.122, 1.176])


def thoughts(family: str, seed: int, strikes: int) -> list[tuple[float, float]]:
    """Seconds to learn and to plan before each strike, the movement's own plan left out."""
    options = AdaptOptions(
        target=TARGETS[seed % len(TARGETS)], port="twin", camera="points", family=family, seed=seed, wiggle=True
    )
    adaptation = prepare(options)
    adaptation.options = replace(adaptation.options, max_strikes=strikes, stop_at=0.0)
    steps = adaptation.run()
    learned = [0.0 if step.learned is None else step.learned.wall_time for step in steps]
    return [(before, step.plan.wall_time) for before, step in zip(learned[:-1], steps[1:], strict=True)]


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
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    whips, strikes, tries, families = (1, 2, 1, FAMILIES[:1]) if options.quick else (6, 3, 3, FAMILIES)
    for family in () if options.quick else families:
        thoughts(family, whips, strikes)  # what has to be compiled is
    one, result = mujoco_strike(tries), {"machine": platform.machine(), "whips": whips}
    for family in families:
        rows = np.array([row for seed in range(whips) for row in thoughts(family, seed, strikes)])
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
    for family in families:
        r = result[family]
        seconds = "".join(f"{r[name]:7.2f} s" for name in ("learn", "plan", "both", "both_90"))
        print(f"{family:10s}{r['number']:8d}{seconds}{r['mujoco_strikes']:10.1f}")


if __name__ == "__main__":
    main()
