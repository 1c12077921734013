"""How near, and how soon? Random targets in the paper's circle: the gradient search, and others with the same time.

For each target, the gradient search runs until the tip comes within 1 mm; DIRECT-L and CMA-ES then get the same wall
time, rounded up to the trial that is under way. All run on the same compiled rollout, on all cores.

    python benchmarks/gradient.py [--quick] [--json]
"""

from __future__ import annotations

import argparse
import json

import numpy as np
from tqdm import tqdm

from whiptool.goals.target import Target
from whiptool.goals.zone import Disc, sample
from whiptool.impedance import Controller, oiac_preset
from whiptool.models import preset
from whiptool.objective import Objective
from whiptool.optimizers import search
from whiptool.rollout import CompiledRollout

RADIUS = 1e-3  # [m]


def main() -> None:
    """Search and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="10 targets")
    parser.add_argument("--json", action="store_true", help="one JSON object instead of a table")
    arguments = parser.parse_args()
    points = sample(Disc(), 10 if arguments.quick else 100, np.random.default_rng(1))
    rollout = CompiledRollout(preset("lemon2024"), Controller(oiac_preset("table4")))
    for method in ("gradient", "cmaes"):  # compile and import before the clock starts
        search(Objective(rollout, Target(hit_radius=RADIUS), max_trials=100), method)
    found: dict[str, list] = {"gradient": [], "directl": [], "cmaes": []}
    for i, point in enumerate(tqdm(points, leave=False)):
        allowed = 60.0
        for method, results in found.items():
            objective = Objective(rollout, Target(tuple(point), RADIUS), max_time=allowed, stop_at_hit=True)
            results.append(search(objective, method, seed=i))
            if method == "gradient":
                allowed = results[-1].wall_time
    report = {}
    for method, results in found.items():
        miss = np.array([r.outcome.miss_distance for r in results])
        report[method] = {
            "share_within_1_mm": float(np.mean(miss <= RADIUS)),
            "median_miss": float(np.median(miss)),
            "largest_miss": float(miss.max()),
            "median_trials": float(np.median([r.n_trials for r in results])),
            "median_wall_time": float(np.median([r.wall_time for r in results])),
            "largest_wall_time": float(max(r.wall_time for r in results)),
        }
    if arguments.json:
        print(json.dumps({"targets": len(points), **report}))
        return
    print(f"{len(points)} targets; DIRECT-L and CMA-ES with the wall time of the gradient search on each")
    for method, r in report.items():
        print(
            f"  {method:8s} within 1 mm: {100 * r['share_within_1_mm']:5.1f} %   miss: median "
            f"{1e3 * r['median_miss']:.3f}, largest {1e3 * r['largest_miss']:.3f} mm   trials: median "
            f"{r['median_trials']:g}   time: median {r['median_wall_time']:.2f}, largest {r['largest_wall_time']:.2f} s"
        )


if __name__ == "__main__":
    main()
