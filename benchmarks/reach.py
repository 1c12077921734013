"""How often and how soon is a robot's strike found if no options are given? Random targets in space, to 1 mm.

Each target is searched as these lines do, which are those of `python -m whiptool.optimize --model ur5e --target 1.2 0.3
0.5 --hit-radius 0.001`: position control, a rope of rods, the default accuracy, the limits of the joints, and arm, whip
and the floor at the base's mount clear of each other.

    rollout = wt.CompiledRollout(wt.preset("ur5e"))
    objective = wt.Objective(rollout, wt.Target((1.2, 0.3, 0.5), hit_radius=0.001), max_trials=600, stop_at_hit=True)
    found = wt.search(objective, seed=0)

The targets are uniform in the shell of 0.9 to 1.6 m around the base, above the floor and in front of the robot.
Everything is compiled before the clock starts. The strike that is found is played again at a hundredth of the
tolerance. It is counted as a hit if it is within 1 mm there, and as within the limits if its whole trajectory is. With
--profile, `clearance_share` is the share of processor time that the judging of distances takes; a profile makes
searches slower.

    python benchmarks/reach.py [--quick] [--json] [--folder FOLDER] [--profile]

With --folder, what is found stands there, and an interrupted run continues.
"""

from __future__ import annotations

import argparse
import cProfile
import json
import pstats
import sys
import tempfile
import time
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))  # where the folder `papers` is

import whiptool as wt
from papers.aim.spaces import targets
from whiptool.comparison import Store
from whiptool.comparison.units import Unit
from whiptool.rollout.batch import TOLERANCE
from whiptool.rollout.native import cores

MODELS = ("ur5e", "panda")
RADIUS, TRIALS = 1e-3, 600  # [m]; `optimize` has as many trials
FINER = 1e-2  # of the rollout that judges, in units of the tolerance
CLEARANCE = (  # what is called to judge distances, and to keep them beforehand
    ("clearance.py", "violation"), ("path_clearance.py", "constraints"), ("path_clearance.py", "kept"),
    ("hanging_whip.py", "constraints"), ("hanging_whip.py", "kept"),
)  # fmt: skip


def reached(model: wt.Model, target: np.ndarray, seed: int) -> dict:
    """What the search of one target came to."""
    objective = wt.Objective(wt.CompiledRollout(model), wt.Target(target, RADIUS), max_trials=TRIALS, stop_at_hit=True)
    processor = time.process_time()
    found = wt.search(objective, seed=seed)
    processor = time.process_time() - processor
    assert found.strike is not None
    assert found.outcome is not None
    exact = wt.CompiledRollout(model, tolerance=FINER * TOLERANCE)
    again = exact.approach(found.strike, target)
    return {
        "miss": found.outcome.miss_distance,
        "hit": found.outcome.hit and bool(again.distance[0] <= RADIUS),
        "finer_miss": float(again.distance[0]),
        "within_limits": objective.limits.violation(exact.trajectory(found.strike), found.strike) <= 0,
        "trials": found.n_trials,
        "seconds": found.wall_time,
        "processor_seconds": processor,
        "tip_speed": found.outcome.tip_speed,
    }


@cache
def warmed(name: str) -> wt.Model:
    """Return a robot, when all that a search needs is compiled and imported."""
    model = wt.preset(name)
    wt.search(wt.Objective(wt.CompiledRollout(model), max_trials=70), seed=1)
    return model


@dataclass(frozen=True, kw_only=True)
class ReachUnit(Unit):
    """The search of one target by one robot."""

    model: str
    target: int

    def run(self, folder: Path | None, threads: int | None) -> dict:
        """Search, when all that the search needs is compiled and imported."""
        return reached(warmed(self.model), targets(self.target + 1)[-1], seed=self.target)


def report_of(rows: list[dict]) -> dict:
    """Shares and medians over targets."""
    change = [abs(row["finer_miss"] - row["miss"]) for row in rows if row["hit"]]
    seconds, processor = ([row[name] for row in rows] for name in ("seconds", "processor_seconds"))
    return {
        "targets": len(rows),
        "share_within_1_mm": float(np.mean([row["hit"] for row in rows])),
        "share_within_limits": float(np.mean([row["within_limits"] for row in rows if row["hit"]] or [0.0])),
        "median_seconds": float(np.median(seconds)),
        "median_processor_seconds": float(np.median(processor)),
        "p95_seconds": float(np.percentile(seconds, 95)),
        "largest_seconds": max(seconds),
        "median_trials": float(np.median([row["trials"] for row in rows])),
        "median_tip_speed": float(np.median([row["tip_speed"] for row in rows])),
        "largest_miss": max(row["miss"] for row in rows),
        "median_change": float(np.median(change)) if change else None,
        "largest_change": max(change, default=None),
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
    parser.add_argument("--quick", action="store_true", help="5 targets a robot")
    parser.add_argument("--json", action="store_true", help="one JSON object instead of a table")
    parser.add_argument("--folder", type=Path, help="of what is found, to go on from")
    parser.add_argument("--profile", action="store_true", help="say how much of the time clearance takes")
    arguments = parser.parse_args()
    count = 5 if arguments.quick else 100
    units = {name: [ReachUnit(model=name, target=i) for i in range(count)] for name in MODELS}
    profile, report = cProfile.Profile(time.process_time), {}
    with tempfile.TemporaryDirectory() as passing:
        folder = arguments.folder or Path(passing)
        folder.mkdir(parents=True, exist_ok=True)
        store = Store(folder)
        for name, of_model in units.items():
            warmed(name)
            if arguments.profile:
                profile.enable()
            found = store.results(of_model, desc=name)
            profile.disable()
            report[name] = report_of([found[unit.key] for unit in of_model])
    headline = {"radius": RADIUS, "tolerance": TOLERANCE, "max_trials": TRIALS, "cores": cores()}
    if arguments.profile:
        headline["clearance_share"] = clearance_share(profile)
    if arguments.json:
        print(json.dumps({**headline, **report}))
        return
    for name, r in report.items():
        print(
            f"{name:6s} {r['targets']} targets: {100 * r['share_within_1_mm']:.0f} % within 1 mm, "
            f"{100 * r['share_within_limits']:.0f} % of them within all limits when rolled out finer; time median "
            f"{r['median_seconds']:.2f} s ({r['median_processor_seconds']:.2f} s of processors), 95 % "
            f"{r['p95_seconds']:.2f}, largest {r['largest_seconds']:.2f} s; trials median {r['median_trials']:g}; a "
            f"finer rollout changes the miss by {1e3 * (r['median_change'] or 0):.3f} mm"
        )
    if arguments.profile:
        print(f"clearance takes {headline['clearance_share']:.0%} of the processor time")


if __name__ == "__main__":
    main()
