"""How many trials does DIRECT-L need? 300 random targets in the paper's circle (Fig. 5), each searched from scratch.

Random search, with the same budget, stands beside it.

    python benchmarks/directl.py [--quick] [--json]
"""

from __future__ import annotations

import argparse
import json

import numpy as np
from tqdm import tqdm

from whiptool.impedance import Controller, oiac_preset
from whiptool.models import CompiledRollout, preset
from whiptool.objective import TARGET, Objective, Target
from whiptool.optimizers import Status, search

RADIUS = 0.1  # [m], of the target zone (Sect. 3.1.1)
BUDGET = 600


def targets(count: int, rng: np.random.Generator) -> np.ndarray:
    """Uniform points in the circle around the default target [m], (count, 2)."""
    angle, radius = rng.uniform(0, 2 * np.pi, count), RADIUS * np.sqrt(rng.uniform(0, 1, count))
    return np.array(TARGET) + np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)


def main() -> None:
    """Search and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="20 targets")
    parser.add_argument("--json", action="store_true", help="one JSON object instead of a table")
    arguments = parser.parse_args()
    points = targets(20 if arguments.quick else 300, np.random.default_rng(0))
    rollout = CompiledRollout(preset("lemon2024"), Controller(oiac_preset("table4")))
    report = {}
    for method in ("directl", "random"):
        trials, hits = [], 0
        for i, point in enumerate(tqdm(points, desc=method, leave=False)):
            objective = Objective(rollout, Target(tuple(point)), max_trials=BUDGET, stop_at_hit=True)
            result = search(objective, method, seed=i)
            trials.append(result.n_trials)
            hits += result.status is Status.HIT
        report[method] = {
            "mean": float(np.mean(trials)),
            "median": float(np.median(trials)),
            "largest": int(np.max(trials)),
            "share_hit": hits / len(points),
        }
    if arguments.json:
        print(json.dumps({"targets": len(points), "budget": BUDGET, **report}))
        return
    print(f"trials to the first hit, {len(points)} targets within {RADIUS} m of {TARGET} m, at most {BUDGET}")
    for method, r in report.items():
        print(
            f"  {method:8s} mean {r['mean']:.2f}   median {r['median']:g}   largest {r['largest']}   "
            f"hit {100 * r['share_hit']:.1f} %"
        )


if __name__ == "__main__":
    main()
