"""Which a of Eq. 10 brings OIAC's tracking errors nearest to Table 4? The sweep that chose the preset `table4`.

For random strikes of the default bounds, the largest (and the mean) absolute tracking error of shoulder and elbow,
in position and velocity, under OIAC and under constant impedance (Eq. 22); printed are the ratios of their means over
the strikes, next to those of Table 4, and the distance of the four ratios from the paper's (RMS of the logarithms).

    python benchmarks/table4_sweep.py [--quick] [--json]
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

import numpy as np
from scipy.optimize import minimize_scalar

sys.path.insert(0, str(Path(__file__).parents[1]))  # where the folder `papers` is

from papers.lemon2024.table4 import COARSE, NAMES, TABLE4_CONSTANT, TABLE4_OIAC, tracking_errors
from whiptool.impedance import OIAC, ConstantImpedance, Controller
from whiptool.models import preset
from whiptool.models.strike import default_bounds


def main() -> None:
    """Print the sweep."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="20 strikes and a coarse grid")
    parser.add_argument("--json", action="store_true", help="one JSON object instead of a table")
    arguments = parser.parse_args()
    count, per_decade = (20, 2) if arguments.quick else (200, 5)
    model = preset("lemon2024")
    strikes = default_bounds(model.arm).sample(np.random.default_rng(0), count)
    constant = tracking_errors(model, Controller(ConstantImpedance()), strikes, timestep=COARSE)
    largest_c, mean_c, paper = constant.largest, constant.mean, TABLE4_OIAC / TABLE4_CONSTANT
    rows = []
    for a in [*np.logspace(-5, -1, 4 * per_decade + 1), 0.2]:
        errors = tracking_errors(model, Controller(OIAC(a=float(a))), strikes)
        largest, mean = errors.largest, errors.mean
        rows.append(
            {
                "a": float(a),
                "largest": largest.tolist(),
                "mean": mean.tolist(),
                "ratios_largest": (largest / largest_c).tolist(),
                "ratios_mean": (mean / mean_c).tolist(),
                "misfit": float(np.sqrt(np.mean(np.log(largest / largest_c / paper) ** 2))),
                "misfit_mean": float(np.sqrt(np.mean(np.log(mean / mean_c / paper) ** 2))),
                "misfit_absolute_mean": float(np.sqrt(np.mean(np.log(mean / TABLE4_OIAC) ** 2))),
            }
        )
    nearest = min(rows, key=lambda row: row["misfit"])["a"]

    def misfit(log_a: float) -> float:
        largest = tracking_errors(model, Controller(OIAC(a=10**log_a)), strikes).largest
        return float(np.sqrt(np.mean(np.log(largest / largest_c / paper) ** 2)))

    step = 1 / per_decade
    around = np.log10(nearest)
    refined = minimize_scalar(misfit, bounds=(around - step, around + step), method="bounded", options={"xatol": 0.01})
    best = {"a": float(f"{10**refined.x:.2g}"), "misfit": float(refined.fun)}
    if arguments.json:
        stiff = {"largest": largest_c.tolist(), "mean": mean_c.tolist()}
        print(json.dumps({"strikes": count, "paper_ratios": paper.tolist(), "constant": stiff, "rows": rows,
                          "best_a": best["a"], "best_misfit": best["misfit"]}))  # fmt: skip
        return
    print(f"{count} random strikes; columns: {', '.join(NAMES)}")
    print(f"{'constant, largest':28s}", *(f"{x:8.4f}" for x in largest_c), "  mean", *(f"{x:8.4f}" for x in mean_c))
    print(f"{'Table 4, ratios':28s}", *(f"{x:8.3f}" for x in paper))
    for row in rows:
        print(
            f"a = {row['a']:<9.3g} ratios of largest",
            *(f"{x:8.3f}" for x in row["ratios_largest"]),
            f"  misfit {row['misfit']:.3f}   of means",
            *(f"{x:8.3f}" for x in row["ratios_mean"]),
            f"  misfit {row['misfit_mean']:.3f}   means to Table 4's OIAC {row['misfit_absolute_mean']:.3f}",
        )
    print(f"nearest to Table 4's four ratios: a = {best['a']:.2g} (misfit {best['misfit']:.3f})")


if __name__ == "__main__":
    main()
