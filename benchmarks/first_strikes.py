"""How soon is a robot's strike found if no options are given? Random targets, to 1 mm, as the presets are.

Each target is searched as these lines do, which are those of `python -m whiptool.optimize --model ur5e --target 1.2 0.3
0.5 --method gradient --hit-radius 0.001`: position control, a rope of rods, the limits of the joints, arm, whip and the
floor at the base's mount clear of each other.

    rollout = wt.CompiledRollout(wt.preset("ur5e"))
    objective = wt.Objective(rollout, wt.Target((1.2, 0.3, 0.5), hit_radius=0.001), stop_at_hit=True)
    found = wt.search(objective, "gradient", seed=0)

The first target is that one; the others are uniform in the shell of 0.9 to 1.6 m around the base, above the floor and
in front of the robot. Everything is compiled before the clock starts. `median_seconds` is of the UR5e's searches, and
`kept` the share of hits that, played whole, keep all limits. With --profile, `clearance_share` is the share of
processor time that the judging of distances takes; a profile makes searches slower.

    python benchmarks/first_strikes.py [--quick] [--json] [--profile]
"""

from __future__ import annotations

import argparse
import cProfile
import json
import pstats
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

sys.path.insert(0, str(Path(__file__).parents[1]))  # where the folder `papers` is

import whiptool as wt
from papers.aim.spaces import targets
from whiptool.rollout.threads import cores

ROBOTS = ("ur5e", "panda")
FIRST, RADIUS = (1.2, 0.3, 0.5), 1e-3  # [m]
LONGEST = 120.0  # [s] a target
CLEARANCE = (  # what is called to judge distances, and to keep them beforehand
    ("clearance.py", "violation"), ("path_clearance.py", "constraints"), ("path_clearance.py", "kept"),
    ("hanging_whip.py", "constraints"), ("hanging_whip.py", "kept"),
)  # fmt: skip


def searched(rollout: wt.CompiledRollout, target: np.ndarray) -> dict[str, Any]:
    """What the search of one target came to."""
    objective = wt.Objective(rollout, wt.Target(tuple(target), RADIUS), max_time=LONGEST, stop_at_hit=True)
    processor = time.process_time()
    found = wt.search(objective, "gradient", seed=0)
    processor = time.process_time() - processor
    assert found.outcome is not None
    assert found.strike is not None
    hit = found.outcome.hit
    kept = hit and objective.limits.violation(rollout.trajectory(found.strike), found.strike) <= 0
    return {
        "hit": hit,
        "kept": kept,
        "seconds": found.wall_time,
        "processor_seconds": processor,
        "trials": found.n_trials,
        "tip_speed": found.outcome.tip_speed,
    }


def warmed(name: str) -> wt.CompiledRollout:
    """Return a robot's rollout, when all that a search needs is compiled and imported."""
    rollout = wt.CompiledRollout(wt.preset(name))
    wt.search(wt.Objective(rollout, FIRST, max_trials=70), "gradient", seed=1)
    return rollout


def report_of(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Shares and medians over targets."""
    seconds, processor = ([row[name] for row in rows] for name in ("seconds", "processor_seconds"))
    return {
        "targets": len(rows),
        "share_hit": float(np.mean([row["hit"] for row in rows])),
        "kept": float(np.mean([row["kept"] for row in rows if row["hit"]] or [0.0])),
        "median_seconds": float(np.median(seconds)),
        "largest_seconds": max(seconds),
        "median_processor_seconds": float(np.median(processor)),
        "median_trials": float(np.median([row["trials"] for row in rows])),
        "median_tip_speed": float(np.median([row["tip_speed"] for row in rows])),
    }


def clearance_share(profile: cProfile.Profile) -> float:
    """Return the share of a profile's time that goes into clearance."""
    stats: dict[tuple[str, int, str], tuple] = pstats.Stats(profile).stats  # type: ignore[attr-defined]
    whole = sum(x[2] for x in stats.values())
    spent = sum(x[3] for (path, _, name), x in stats.items() if (path.rsplit("/")[-1], name) in CLEARANCE)
    return spent / whole


def main() -> None:
    """Search and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="3 targets of the UR5e alone")
    parser.add_argument("--json", action="store_true", help="one JSON object instead of lines")
    parser.add_argument("--profile", action="store_true", help="say how much of the time clearance takes")
    arguments = parser.parse_args()
    count, robots = (3, ROBOTS[:1]) if arguments.quick else (20, ROBOTS)
    profile, report = cProfile.Profile(time.process_time), {}
    for name in robots:
        rollout, rows = warmed(name), []
        for target in tqdm([FIRST, *targets(count - 1)], desc=name, leave=False):
            if arguments.profile:
                profile.enable()
            rows.append(searched(rollout, np.array(target)))
            profile.disable()
        report[name] = report_of(rows)
    headline = {"median_seconds": report["ur5e"]["median_seconds"], "cores": cores(), "radius": RADIUS}
    if arguments.profile:
        headline["clearance_share"] = clearance_share(profile)
    if arguments.json:
        print(json.dumps({**headline, **report}))
        return
    for name, r in report.items():
        print(
            f"{name:6s} {r['targets']} targets: {r['share_hit']:.0%} hit, {r['kept']:.0%} of these keep all limits; "
            f"median {r['median_seconds']:.2f} s ({r['median_processor_seconds']:.2f} s of processors), largest "
            f"{r['largest_seconds']:.1f} s; trials median {r['median_trials']:g}"
        )
    if arguments.profile:
        print(f"clearance takes {headline['clearance_share']:.0%} of the processor time")


if __name__ == "__main__":
    main()
