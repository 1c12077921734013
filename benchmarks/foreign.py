"""A whip that no simulator of ours made is learned from how it hangs and from two strikes at each of 12 targets.

`python benchmarks/foreign.py [--quick] [--json] [--folder KEPT]`. 40 tapered capsules with MuJoCo's own fluid, dry
friction and a stiff first joint, an arm that sags under a controller in NumPy (`tests/helpers/foreign_whip.py`), the
tip seen 60 times a second with 5 mm noise. It prints the miss of every strike, how it was judged, how often hits were
claimed wrongly, and how often misses were within the predicted 50 % and 90 % quantiles. With `--folder` the strikes at
each target are kept there, and the same command goes on where it was left.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from peers.kept import kept

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
    """The strikes at one target, each with the processor's time until then [s]."""
    began = time.process_time()
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
            about["seconds"] = time.process_time() - began
            about["rank"] = float(np.mean([x is not None and x < step.outcome.true_miss for x in step.plan.misses]))
            found.append(about | {"miss": step.outcome.true_miss, "camera": step.outcome.seen_miss} | judged)
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="one target")
    parser.add_argument("--json", action="store_true", help="one JSON object instead of lines")
    parser.add_argument(
        "--folder", type=Path, help="keep the strikes at each target there, and go on where it was left"
    )
    options = parser.parse_args()
    rows = []
    for number in range(1 if options.quick else len(targets())):
        name, of = f"target {number}", (number, targets()[number].tolist(), STRIKES)
        for row in kept(options.folder, name, of, partial(struck, number)):
            rows.append(row)
            if not options.json:
                said = (
                    f"target {row['target'] + 1}, strike {row['strike']}: missed by {100 * row['miss']:.2f} cm; judged"
                )
                said += f" {100 * row['judged']:.2f} ± {100 * row['error']:.2f} cm, a hit with {row['probability']:.3f}"
                print(f"{said}; {row['seconds']:.0f} s of a processor", flush=True)
    summary = summarised(rows)
    if options.json:
        print(json.dumps(summary | {"rows": rows}))
    else:
        print(", ".join(f"{name} {value}" for name, value in summary.items()))


def summarised(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Hits, claims and coverages of all strikes."""
    first, second = ([row for row in rows if row["strike"] == k] for k in (1, 2))
    hits = [sum(row["miss"] <= wt.Target().hit_radius for row in some) for some in (first, second)]
    within = [[float(np.mean([row["rank"] <= x for row in some])) for x in (0.5, 0.9)] for some in (first, second)]
    return {
        "targets": len(first),
        "first_hits": hits[0],
        "second_hits": hits[1],
        "first_within": within[0],
        "second_within": within[1],
        "claimed": sum(row["probability"] >= 0.9 for row in rows),
        "wrongly_claimed": sum(row["probability"] > 0.9 and row["miss"] > CLEAR for row in rows),
        "seconds": float(np.median([row["seconds"] for row in second])),
    }


if __name__ == "__main__":
    main()
