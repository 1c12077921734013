"""A whip that no simulator of ours made is learned from how it hangs and from two strikes at each of 12 targets.

`python benchmarks/foreign.py [--quick] [--json]`. 40 tapered capsules with MuJoCo's own fluid, dry friction and a stiff
first joint, an arm that sags under a controller in NumPy (`tests/helpers/foreign_whip.py`), the tip seen 60 times a
second with 5 mm noise. It prints the miss of every strike, how it was judged, how often hits were claimed wrongly, and
how often misses were within the predicted 50 % and 90 % quantiles.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np

import whiptool as wt
from whiptool.adaptation.adapter import Options
from whiptool.adaptation.loop import Adaptation
from whiptool.adaptation.prior import default_prior

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "helpers"))
from foreign_whip import ForeignPort, ForeignWhip

STRIKES = 2
CLEAR = 0.065  # [m] of miss, beyond which a claimed hit is a wrong one


def targets() -> np.ndarray:
    """Twelve, within the region that the arm reaches (12, 2) [m]."""
    rng = np.random.default_rng(5)
    angle, radius = rng.uniform(-0.45, 0.9, 12), rng.uniform(0.95, 1.3, 12)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)


def struck(number: int) -> list[dict[str, Any]]:
    """The strikes at one target."""
    model = wt.preset("lemon2024")
    controller = wt.Controller(wt.oiac_preset("table4")).reckoning_with(model)
    x, y = map(float, targets()[number])
    port = ForeignPort(ForeignWhip(), (x, y))
    options = Options(max_strikes=STRIKES, stop_at=0.0, seed=number)
    steps = Adaptation(default_prior(model, controller), port, wt.Target((x, y)), options).run()
    found = []
    for step in steps:
        if step.number and step.judged is not None:
            judged = {"judged": step.judged.miss, "error": step.judged.error, "probability": step.judged.probability}
            about = {"target": number, "strike": step.number, "planned": step.plan.probability}
            about["rank"] = float(np.mean([x is not None and x < step.outcome.true_miss for x in step.plan.misses]))
            found.append(about | {"miss": step.outcome.true_miss, "camera": step.outcome.seen_miss} | judged)
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="two targets")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    rows = []
    for number in range(2 if options.quick else len(targets())):
        for row in struck(number):
            rows.append(row)
            if not options.json:
                said = (
                    f"target {row['target'] + 1}, strike {row['strike']}: missed by {100 * row['miss']:.2f} cm; judged"
                )
                said += f" {100 * row['judged']:.2f} ± {100 * row['error']:.2f} cm, a hit with {row['probability']:.3f}"
                print(said, flush=True)
    hits = [[row["miss"] <= wt.Target().hit_radius for row in rows if row["strike"] == k] for k in (1, 2)]
    summary = {
        "targets": len(hits[0]),
        "first_hits": sum(hits[0]),
        "second_hits": sum(hits[1]),
        "first_within": [float(np.mean([r["rank"] <= x for r in rows if r["strike"] == 1])) for x in (0.5, 0.9)],
        "second_within": [float(np.mean([r["rank"] <= x for r in rows if r["strike"] == 2])) for x in (0.5, 0.9)],
        "claimed": sum(row["probability"] >= 0.9 for row in rows),
        "wrongly_claimed": sum(row["probability"] > 0.9 and row["miss"] > CLEAR for row in rows),
        "rows": rows,
    }
    if options.json:
        print(json.dumps(summary))
    else:
        print(", ".join(f"{name} {value}" for name, value in summary.items() if name != "rows"))


if __name__ == "__main__":
    main()
