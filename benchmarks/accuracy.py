"""How far is the compiled rollout from MuJoCo? Miss distances of random strikes, both simulators, each controller.

The reference is MuJoCo with RK4 at 0.05 ms, the controller acting at every stage; its own convergence is shown on the
first strikes by halving and doubling that step. The compiled rollout runs at its default step and around it.

    python benchmarks/accuracy.py [--quick] [--json] [--workers N]
"""

from __future__ import annotations

import argparse
import json
from itertools import repeat

import numpy as np
from loky import get_reusable_executor

from whiptool.goals.target import TARGET
from whiptool.impedance import OIAC_PRESETS, ConstantImpedance, Controller
from whiptool.models import preset
from whiptool.models.strike import T_STAY, Strike, default_bounds
from whiptool.rollout import CompiledRollout, ReferenceRollout
from whiptool.rollout.compiled import TIMESTEP

CONTROLLERS = {"constant": Controller(ConstantImpedance())} | {
    f"oiac {name}": Controller(law) for name, law in OIAC_PRESETS.items()
}
REFERENCE_STEP = 5e-5


def reference_miss(name: str, strikes: np.ndarray, timestep: float) -> np.ndarray:
    """Miss distances in MuJoCo [m]; infinite where it diverged."""
    rollout = ReferenceRollout(preset("lemon2024"), CONTROLLERS[name], timestep=timestep)
    paths = (rollout.trajectory(Strike.from_vector(s), t_stay=T_STAY) for s in strikes)
    return np.array([np.inf if p.diverged else p.approach(np.array(TARGET)).distance[0] for p in paths])


def main() -> None:
    """Print the differences."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="8 strikes, the reference at 0.1 ms")
    parser.add_argument("--json", action="store_true", help="one JSON object instead of a table")
    parser.add_argument("--workers", type=int, help="processes; default: one per core")
    arguments = parser.parse_args()
    count, h = (8, 2 * REFERENCE_STEP) if arguments.quick else (200, REFERENCE_STEP)
    model = preset("lemon2024")
    strikes = default_bounds(model.arm).sample(np.random.default_rng(2024), count)
    report = {}
    pool = get_reusable_executor(arguments.workers)
    for name, controller in CONTROLLERS.items():
        parts = np.array_split(strikes, max(1, count // 4))
        truth = np.concatenate(list(pool.map(reference_miss, repeat(name), parts, repeat(h))))
        double, half = pool.map(reference_miss, repeat(name), repeat(strikes[:4]), (2 * h, h / 2))
        report[name] = {
            "reference_timestep": h,
            "reference_diverged": int(np.isinf(truth).sum()),
            "reference_change_when_doubled": float(np.abs(double - truth[:4]).max()),
            "reference_change_when_halved": float(np.abs(half - truth[:4]).max()),
            "compiled": [],
        }
        for timestep in (4 * TIMESTEP, 2 * TIMESTEP, TIMESTEP, TIMESTEP / 2):
            near = CompiledRollout(model, controller, timestep=timestep).approach(
                strikes, np.array(TARGET), t_stay=T_STAY
            )
            error = np.abs(near.distance - truth)[~near.diverged & np.isfinite(truth)]
            quantiles = [float(np.percentile(error, p)) for p in (50, 95, 100)]
            report[name]["compiled"].append(
                {
                    "timestep": timestep,
                    "median": quantiles[0],
                    "p95": quantiles[1],
                    "max": quantiles[2],
                    "diverged": int(near.diverged.sum()),
                }
            )
    if arguments.json:
        print(json.dumps({"strikes": count, "default_timestep": TIMESTEP, "controllers": report}))
        return
    print(f"{count} random strikes; differences in miss distance, compiled against MuJoCo (RK4, {1e3 * h:g} ms)")
    for name, entry in report.items():
        print(
            f"{name}: reference changes by {1e3 * entry['reference_change_when_halved']:.1e} mm at half its step, "
            f"{1e3 * entry['reference_change_when_doubled']:.1e} mm at twice; {entry['reference_diverged']} diverged"
        )
        for row in entry["compiled"]:
            mark = "  <- default" if row["timestep"] == TIMESTEP else ""
            print(
                f"  {1e3 * row['timestep']:5.3g} ms   median {1e3 * row['median']:.4f}   95th percentile "
                f"{1e3 * row['p95']:.4f}   largest {1e3 * row['max']:.4f} mm   {row['diverged']} diverged{mark}"
            )


if __name__ == "__main__":
    main()
