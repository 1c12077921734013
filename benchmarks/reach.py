"""How often and how soon do robots reach a target? Random targets in space, to 1 mm, within the arm's limits.

Targets of the UR5e and the Panda with stick and rope are uniform in the shell of 0.9 to 1.6 m around the base, above
the ground and in front of the robot. The joints follow their reference exactly (position control); limits of position,
velocity and torque are kept. Each target is searched until the tip comes within 0.9 mm, at the default accuracy. The
strike is played again at a hundredth of the tolerance, and is a hit if it is within 1 mm there; within the limits, if
it is so there. One target after another, each on all cores.

    python benchmarks/reach.py [--quick] [--json] [--folder FOLDER]

With --folder, what is found stands there, and an interrupted run continues.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))  # where the folder `papers` is

from papers.aim.spaces import targets
from whiptool.comparison import Store
from whiptool.comparison.units import Unit
from whiptool.goals.target import Target
from whiptool.impedance import Controller, PositionControl
from whiptool.limits.arm_limits import ArmLimits
from whiptool.models import Model, preset
from whiptool.models.strike import Strike
from whiptool.objective import Objective
from whiptool.optimizers import search
from whiptool.rollout import CompiledRollout
from whiptool.rollout.resolution import TOLERANCE

MODELS = ("ur5e", "panda")
RADIUS = 1e-3  # [m]
SEARCHED = 0.9 * RADIUS  # what the integration errs by is left free
FINER = 1e-2  # of the rollout that judges, in units of the tolerance
LONGEST = 120.0  # [s] a target
METHOD = "gradient"
_WARM: set[str] = set()  # models that have searched before


def reached(model: Model, target: np.ndarray, seed: int) -> dict:
    """What the search of one target came to."""
    controller, limits = Controller(PositionControl()), ArmLimits.of(model.arm)
    goal = Target(tuple(target.tolist()), SEARCHED)
    rollout = CompiledRollout(model, controller)
    objective = Objective(rollout, goal, limits=limits, max_time=LONGEST, stop_at_hit=True)
    result = search(objective, METHOD, seed=seed)
    assert result.strike is not None
    assert result.outcome is not None
    exact = CompiledRollout(model, controller, tolerance=FINER * TOLERANCE)
    again = exact.approach(result.strike, target)
    return {
        "miss": result.outcome.miss_distance,
        "hit": result.outcome.hit and bool(again.distance[0] <= RADIUS),
        "finer_miss": float(again.distance[0]),
        "usage": 1.0 + float(limits.violation_of_peaks(again)[0]),
        "trials": result.n_trials,
        "seconds": result.wall_time,
        "tip_speed": result.outcome.tip_speed,
    }


def warm_up(model: Model) -> None:
    """Compile and import before the clock starts."""
    rollout = CompiledRollout(model, Controller(PositionControl()))
    middle = np.array([np.mean([s.limits.position for s in model.arm.links], axis=1)])
    strike = Strike.from_vector(np.r_[middle[0], middle[0] + 0.1, 0.5])
    rollout.gradient(strike, np.array([1.0, 0.0, 0.5]))
    limits = ArmLimits.of(model.arm)
    search(Objective(rollout, Target((1.0, 0.0, 0.5), SEARCHED), limits=limits, max_trials=70), METHOD, seed=0)


@dataclass(frozen=True, kw_only=True)
class ReachUnit(Unit):
    """The search of one target by one robot."""

    model: str
    target: int

    def run(self, folder: Path | None, threads: int | None) -> dict:
        """Search, when all that the search needs is compiled and imported."""
        model = preset(self.model)
        if self.model not in _WARM:
            warm_up(model)
            _WARM.add(self.model)
        return reached(model, targets(self.target + 1)[-1], seed=self.target)


def report_of(rows: list[dict]) -> dict:
    """Shares and medians over targets."""
    change = [abs(row["finer_miss"] - row["miss"]) for row in rows if row["hit"]]
    seconds = [row["seconds"] for row in rows]
    return {
        "targets": len(rows),
        "share_within_1_mm": float(np.mean([row["hit"] for row in rows])),
        "share_within_limits": float(np.mean([row["usage"] <= 1.0 for row in rows if row["hit"]] or [0.0])),
        "median_seconds": float(np.median(seconds)),
        "p95_seconds": float(np.percentile(seconds, 95)),
        "largest_seconds": max(seconds),
        "median_trials": float(np.median([row["trials"] for row in rows])),
        "median_tip_speed": float(np.median([row["tip_speed"] for row in rows])),
        "largest_miss": max(row["miss"] for row in rows),
        "median_change": float(np.median(change)) if change else None,
        "largest_change": max(change, default=None),
    }


def main() -> None:
    """Search and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="5 targets a robot")
    parser.add_argument("--json", action="store_true", help="one JSON object instead of a table")
    parser.add_argument("--folder", type=Path, help="of what is found, to go on from")
    arguments = parser.parse_args()
    count = 5 if arguments.quick else 100
    units = {name: [ReachUnit(model=name, target=i) for i in range(count)] for name in MODELS}
    with tempfile.TemporaryDirectory() as passing:
        folder = arguments.folder or Path(passing)
        folder.mkdir(parents=True, exist_ok=True)
        store, report = Store(folder), {}
        for name, of_model in units.items():
            found = store.results(of_model, desc=name)
            report[name] = report_of([found[unit.key] for unit in of_model])
    if arguments.json:
        print(json.dumps({"radius": RADIUS, "tolerance": TOLERANCE, "method": METHOD, **report}))
        return
    for name, r in report.items():
        print(
            f"{name:6s} {r['targets']} targets: {100 * r['share_within_1_mm']:.0f} % within 1 mm, "
            f"{100 * r['share_within_limits']:.0f} % of them within all limits when rolled out finer; time median "
            f"{r['median_seconds']:.2f}, 95 % {r['p95_seconds']:.2f}, largest {r['largest_seconds']:.2f} s; trials "
            f"median {r['median_trials']:g}; that changes the miss by {1e3 * (r['median_change'] or 0):.3f} mm"
        )


if __name__ == "__main__":
    main()
