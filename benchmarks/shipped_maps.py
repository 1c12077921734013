"""How often do the maps that come with the package hit goals of their regions, and how soon is a strike found?

For each map 1,000 goals are drawn from its region with a seed that it was not built with: points that the tip has to
pass within the hit radius, of robots in a direction that is drawn too, within 10 degrees of it and at 1 m/s along it. A
hit keeps what the preset's strikes keep by default: the limits of the joints, and arm, whip and floor clear of each
other over the whole strike. `one_shot`: the map's strike, the first of its best few that keeps the limits; `refined`:
with rollouts, as `wt.load_map(name).strike(goal)` does.
`cold_seconds` is the time of a new process of Python that imports whiptool and prints the strike at a goal, with the
model's compiled library in the cache.

    python benchmarks/shipped_maps.py [--quick] [--json] [--model NAME]
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
from typing import Any

import numpy as np
from scipy.stats import binomtest

import whiptool as wt
from whiptool.goals.goals import Goals
from whiptool.rollout.native import cores
from whiptool.strike_map.map_files import shipped_names

GOALS, QUICK_GOALS, SEED = 1000, 40, 1_000_003
COLD = """
import whiptool as wt
strike_map = wt.load_map({name!r})
print(strike_map.strike(wt.Target({position}, hit_radius={radius})))
"""


def at_once(name: str, goals: Goals) -> float:
    """Return how long a new process takes from its start to the strike at the first goal [s]."""
    position = tuple(goals.positions[0].tolist())
    program = COLD.format(name=name, position=position, radius=goals.hit_radius)
    start = time.monotonic()
    subprocess.run([sys.executable, "-c", program], check=True, capture_output=True)
    return time.monotonic() - start


def measured(name: str, count: int) -> dict[str, Any]:
    """Strike at goals of a map's region."""
    found = wt.load_map(name)
    goals = found.region.draw(count, np.random.default_rng(SEED))
    first = found.striker.strike(found.kept(goals), goals)
    start = time.monotonic()
    refined = found.refined(goals)
    seconds = time.monotonic() - start
    hits = refined.struck.hit
    report: dict[str, Any] = {"answers": len(found.answers), "goals": count, "hit_radius": found.region.hit_radius}
    for kind, hit in (("one_shot", first.hit), ("refined", hits)):
        interval = binomtest(int(hit.sum()), count).proportion_ci(method="wilson")
        report |= {kind: float(hit.mean()), f"{kind}_interval": [interval.low, interval.high]}
    return report | {
        "median_miss": float(np.median(refined.struck.distance[hits])),
        "miss_of_99_percent": float(np.percentile(refined.struck.distance[hits], 99)),
        "rollouts_per_goal": refined.rollouts / count,
        "derivatives_per_goal": refined.derivatives / count,
        "seconds_per_goal_together": seconds / count,
        "cold_seconds": at_once(name, goals),
    }


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help=f"{QUICK_GOALS} goals of each")
    parser.add_argument("--json", action="store_true", help="one JSON object instead of lines")
    parser.add_argument("--model", choices=shipped_names(), help="of one map alone")
    arguments = parser.parse_args()
    names = [arguments.model] if arguments.model else shipped_names()
    report = {name: measured(name, QUICK_GOALS if arguments.quick else GOALS) for name in names}
    if arguments.json:
        print(json.dumps({"cores": cores(), "maps": report}))
        return
    for name, r in report.items():
        hits = f"{r['one_shot']:.1%} are hit in one shot, {r['refined']:.1%} refined"
        print(
            f"{name:10s} {r['answers']} answers; of {r['goals']} goals at {1e3 * r['hit_radius']:g} mm {hits}, "
            f"median miss {1e3 * r['median_miss']:.3f} mm; {r['rollouts_per_goal']:.1f} rollouts a goal; "
            f"a new process takes {r['cold_seconds']:.1f} s"
        )


if __name__ == "__main__":
    main()
