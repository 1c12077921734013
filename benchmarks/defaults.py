"""What a user gets who gives no options: how true, how fast, of every preset.

Random strikes, within what the joints can do (`limits`) and without (`free`), at the default tolerance with the default
controller. Errors are those of the distances against the same rollout at a tolerance a thousand times smaller; `marked`
counts strikes whose error the rollout says it does not know, `unmarked` those beyond ten times the tolerance that it
did not mark. `over_equal_steps` is how many times as fast that is as the largest of some equal steps whose 99th
percentile is no larger, of the same strikes; none where not even the smallest is as true. `command_seconds`: of the
default `optimize`, warm, to its answer and to its end. `replay`: the largest difference of misses in MuJoCo, how many
are farther apart than a confirmed strike may be, and how many diverge there at every step that is tried, as those of
nah2023 do where the shoulder passes gimbal lock; the command calls such strikes not confirmed.

    python benchmarks/defaults.py [--quick] [--json] [--replays N]
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import time

import numpy as np
from tqdm import tqdm

from whiptool.goals.target import usual_target
from whiptool.impedance.controller import default_controller
from whiptool.limits.arm_limits import ArmLimits
from whiptool.models import Model, preset
from whiptool.models.presets import PRESETS
from whiptool.models.strike import T_STAY, default_bounds
from whiptool.rollout import CompiledRollout
from whiptool.rollout.native import cores
from whiptool.rollout.reference import AGREEMENT, replay

FINER = 1e-3  # of the run that errors are taken from, in units of the tolerance
EQUAL_STEPS = (2e-3, 1e-3, 5e-4, 2.5e-4, 1.25e-4, 6.3e-5)


def strikes_of(model: Model, count: int, *, limits: bool) -> np.ndarray:
    """Random strikes of the default bounds, where asked for no faster than the joints may be commanded."""
    strikes = default_bounds(model.arm).sample(np.random.default_rng(7), count)
    return ArmLimits.of(model.arm).command.shortened(strikes) if limits else strikes


def timed(rollout: CompiledRollout, strikes: np.ndarray, target: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """Distances, estimated errors (zeros of equal steps), and strikes a second."""
    rollout.approach(strikes[:8], target)  # compiled
    start = time.perf_counter()
    near = rollout.approach(strikes, target)
    seconds = time.perf_counter() - start
    error = np.zeros(len(strikes)) if near.integration_error is None else near.integration_error
    return near.distance, np.where(near.diverged, np.inf, error), len(strikes) / seconds


def measured(model: Model, strikes: np.ndarray, target: np.ndarray) -> dict:
    """Errors and speed of one preset's strikes."""
    controller = default_controller(model)
    rollout = CompiledRollout(model, controller)
    distance, estimate, speed = timed(rollout, strikes, target)
    true = CompiledRollout(model, controller, tolerance=FINER * rollout.tolerance).approach(strikes, target)
    known = ~true.diverged & np.isfinite(true.integration_error)
    error, marked = np.abs(distance - true.distance), np.isinf(estimate)
    p50, p95, p99, largest = (float(np.percentile(error[known & ~marked], p)) for p in (50, 95, 99, 100))
    return {
        "strikes": len(strikes),
        "median_error": p50,
        "p95_error": p95,
        "p99_error": p99,
        "largest_error": largest,
        "marked": int(marked.sum()),
        "unmarked": int((known & ~marked & (error > 10 * rollout.tolerance)).sum()),
        "diverged_unmarked": int((true.diverged & ~marked).sum()),
        "unknown": int((~known).sum()),
        "error_above_estimate": float(np.mean((error > estimate)[known & ~marked])),
        "strikes_per_second": speed,
        "over_equal_steps": over_equal_steps(model, strikes, target, (true.distance, known), p99, speed),
    }


def over_equal_steps(
    model: Model, strikes: np.ndarray, target: np.ndarray, true: tuple[np.ndarray, np.ndarray], p99: float, speed: float
) -> dict | None:
    """The largest equal step that is as true, and how many times slower it is; None without such a step."""
    distance, known = true
    for step in EQUAL_STEPS:
        found, _, its = timed(CompiledRollout(model, default_controller(model), timestep=step), strikes, target)
        if np.percentile(np.abs(found - distance)[known], 99) <= p99:
            return {"timestep": step, "ratio": speed / its}
    return None


def command_seconds(name: str) -> dict:
    """Wall time of the default search of a preset, its libraries compiled: to its answer, and to its end [s]."""
    words = [sys.executable, "-m", "whiptool.optimize", *([] if name == "lemon2024" else ["--model", name])]
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run(words, cwd=folder, capture_output=True, check=True)
        start, answer = time.perf_counter(), None
        with subprocess.Popen(words, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as run:
            assert run.stdout is not None
            for line in run.stdout:
                if answer is None and "hit" in line.lower():
                    answer = time.perf_counter() - start
            run.wait()
        return {"answer": answer, "end": time.perf_counter() - start}


def replayed(model: Model, strikes: np.ndarray, target: np.ndarray) -> dict:
    """How strikes of the default rollout do in MuJoCo: differences of misses [m], and how many diverge there."""
    controller = default_controller(model)
    space, near = CompiledRollout(model, controller).space, CompiledRollout(model, controller).approach(strikes, target)
    differences = []
    for vector, distance in zip(tqdm(strikes, leave=False), near.distance, strict=True):
        seen = replay(model, controller, space.strike(vector), target, t_stay=T_STAY, expected=float(distance))
        differences.append(np.inf if seen.miss_distance is None else abs(seen.miss_distance - distance))
    made = np.array([x for x in differences if np.isfinite(x)])
    return {
        "strikes": len(strikes),
        "largest_difference": float(made.max(initial=0.0)),
        "apart": int((made > AGREEMENT).sum()),
        "diverged": len(differences) - len(made),
    }


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="few strikes of two presets, and no command")
    parser.add_argument("--json", action="store_true", help="one JSON object instead of a table")
    parser.add_argument("--replays", type=int, default=0, help="strikes of each preset that MuJoCo makes, too")
    arguments = parser.parse_args()
    count = 32 if arguments.quick else 1000
    report: dict = {}
    for name in ("lemon2024", "ur5e") if arguments.quick else PRESETS:
        model = preset(name)
        target = np.array(usual_target(model).position)
        kinds = {"free": False} | ({"limits": True} if ArmLimits.are_in(model.arm) else {})
        entry: dict = {
            kind: measured(model, strikes_of(model, count, limits=limits), target) for kind, limits in kinds.items()
        }
        if not arguments.quick:
            entry["command_seconds"] = command_seconds(name)
        if arguments.replays:
            strikes = strikes_of(model, arguments.replays, limits="limits" in kinds)
            entry["replay"] = replayed(model, strikes, target)
        report[name] = entry
    if arguments.json:
        print(json.dumps({"cores": cores(), "presets": report}))
        return
    print(f"{count} random strikes of each preset on {cores()} cores, no options; errors in mm")
    for name, entry in report.items():
        for kind in ("free", "limits"):
            if kind in entry:
                e = entry[kind]
                errors = ", ".join(f"{1e3 * e[x]:.4f}" for x in ("median_error", "p99_error", "largest_error"))
                ratio = "none" if e["over_equal_steps"] is None else f"{e['over_equal_steps']['ratio']:.1f} times"
                speed = f"{e['strikes_per_second']:7.0f} strikes/s"
                print(f"  {name:12s} {kind:6s} {speed}, over equal steps as true: {ratio}")
                unmarked = f"{e['unmarked']} beyond ten tolerances and {e['diverged_unmarked']} diverged unmarked"
                print(f"{22 * ' '}median, 99 %, largest error {errors}; {e['marked']} marked, {unmarked}")
        if "command_seconds" in entry:
            answer, end = entry["command_seconds"].values()
            print(f"  {name:12s} optimize: its answer after {answer or end:.1f} s, its end after {end:.1f} s")
        if "replay" in entry:
            seen = entry["replay"]
            apart = f"at most {1e3 * seen['largest_difference']:.3f} mm apart, {seen['apart']} by more than allowed"
            print(f"  {name:12s} MuJoCo: {apart}; {seen['diverged']} of {seen['strikes']} diverge there")


if __name__ == "__main__":
    main()
