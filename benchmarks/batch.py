"""How fast are many strikes? Every engine at the largest step with a 95th percentile of the error of 0.1 mm or less.

The engines: this project's SIMD, scalar and interpreted rungs; `mujoco.batch.Batch` on as many threads as there are
cores, with a controller vectorised in NumPy; MuJoCo stepped from a Python loop. The error in miss distance is taken
against the compiled rollout at 0.02 ms, which `benchmarks/accuracy.py` compares with MuJoCo's RK4 (the two differ by
far less than the bound). Also measured: scaling with cores, memory for a million strikes, and first starts. The plot
shows error against cost for all engines, integrators and steps that were tried.

    python benchmarks/batch.py [--quick] [--json] [--plot FILE.png]
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import mujoco
import mujoco.batch
import numpy as np
from rollout import CONTROLLERS, MODEL, POINT, PythonLoop
from tqdm import tqdm

from whiptool.impedance import Controller
from whiptool.models.strike import T_STAY, default_bounds
from whiptool.rollout import CompiledRollout
from whiptool.rollout.mujoco_model import build_spec
from whiptool.rollout.native import cores

BOUND = 1e-4  # [m]
STEPS = (4e-3, 2.83e-3, 2e-3, 1.41e-3, 1e-3, 7.1e-4, 5e-4, 3.5e-4, 2.5e-4, 1.8e-4, 1.25e-4)
MUJOCO_STEPS = (1e-4, 7.07e-5, 5e-5, 3.54e-5, 2.5e-5, 1.77e-5, 1.25e-5)  # as fine a search as ours
INTEGRATORS = ("Euler", "implicitfast")


def batch_miss(controller: Controller, strikes: np.ndarray, integrator: str, timestep: float) -> np.ndarray:
    """Miss distances [m], (B,), by `mujoco.batch.Batch` with a vectorised NumPy controller."""
    model = build_spec(MODEL).compile()
    model.opt.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{integrator.upper()}")
    model.opt.timestep = timestep
    B, tip = len(strikes), model.site("tip").id
    batch = mujoco.batch.Batch(model, nsim=B, nthread=cores())
    qpos, qvel, ctrl, sites = (batch.bind(name) for name in ("qpos", "qvel", "ctrl", "site_xpos"))
    q_i, q_f, D = strikes[:, :2], strikes[:, 2:4], strikes[:, 4:]
    qpos[:, :2], qpos[:, 2] = q_i, -q_i.sum(axis=1)
    arm, gravity = MODEL.arm, MODEL.gravity
    (L0, L1), (c0, c1), (m0, m1) = (arm.per_link(x) for x in ("length", "com", "mass"))
    upper, fore = gravity * (m0 * c0 + (m1 + MODEL.whip.mass) * L0), gravity * (m1 * c1 + MODEL.whip.mass * L1)
    law = controller.law
    nearest, before, end = np.full(B, np.inf), None, D[:, 0] + T_STAY
    for i in range(int(end.max() / timestep) + 2):
        s = np.minimum(i * timestep / D, 1)
        e = q_i + (q_f - q_i) * (10 * s**3 - 15 * s**4 + 6 * s**5) - qpos[:, :2]
        de = (q_f - q_i) / D * (30 * s**2 * (1 - s) ** 2) - qvel[:, :2]
        K, B_ = law.gains(e, de)
        tau = (K @ e[..., None] + B_ @ de[..., None])[..., 0]
        elbow = fore * np.sin(qpos[:, 0] + qpos[:, 1])
        tau[:, 0] += upper * np.sin(qpos[:, 0]) + elbow
        tau[:, 1] += elbow
        ctrl[:] = tau
        batch.step()
        now = sites[:, tip, ::2].copy()  # of the state before this step
        if before is not None:
            step, offset = now - before, POINT - before
            squared = np.maximum((step**2).sum(axis=1), 1e-30)
            along = np.clip((offset * step).sum(axis=1) / squared, 0, 1)[:, None]
            distance = np.sqrt(((offset - along * step) ** 2).sum(axis=1))
            nearest = np.where(i * timestep <= end + timestep / 2, np.minimum(nearest, distance), nearest)
        before = now
    return np.where(np.isfinite(qpos).all(axis=1), nearest, np.inf)


def front(name: str, steps: tuple, run: Callable, truth: np.ndarray, bar: tqdm, *, strikes: np.ndarray) -> list[dict]:
    """Error and cost at smaller and smaller steps, until the bound is reached."""
    points = []
    for h in steps:
        bar.set_postfix_str(f"{name}, {1e3 * h:g} ms")
        start = time.perf_counter()
        miss = run(strikes, h)
        seconds = time.perf_counter() - start
        error = np.abs(miss - truth[: len(strikes)])
        p95 = float(np.percentile(np.where(np.isfinite(error), error, 1e3), 95))
        points.append({"timestep": h, "p95_error": p95, "strikes_per_second": len(strikes) / seconds})
        if p95 <= BOUND:
            break
    return points


def measure(name: str, *, quick: bool, bar: tqdm) -> dict[str, list[dict]]:
    """All engines' fronts for one controller; the last point of each is the one within the bound."""
    controller = CONTROLLERS[name]
    strikes = default_bounds(MODEL.arm).sample(np.random.default_rng(7), 512 if quick else 4096)
    truth = CompiledRollout(MODEL, controller, timestep=2e-5).approach(strikes[:512], POINT, t_stay=T_STAY).distance

    def ours(engine: str) -> Callable:
        def run(some: np.ndarray, h: float) -> np.ndarray:
            near = CompiledRollout(MODEL, controller, timestep=h, engine=engine).approach(some, POINT, t_stay=T_STAY)
            return np.where(near.diverged, np.inf, near.distance)[:512]

        return run

    fronts = {}
    for engine, count in (("simd", len(strikes)), ("scalar", 512), ("interpreter", 16 if quick else 64)):
        CompiledRollout(MODEL, controller, engine=engine).approach(strikes[:8], POINT, t_stay=T_STAY)  # warm
        points = []
        for h in STEPS:
            bar.set_postfix_str(f"{engine}, {1e3 * h:g} ms")
            some, times = strikes[:count], []
            for _ in range(3 if engine == "simd" else 1):
                start = time.perf_counter()
                miss = ours(engine)(some, h)
                times.append(time.perf_counter() - start)
            error = np.abs(miss - truth[: len(miss)])
            p95 = float(np.percentile(np.where(np.isfinite(error), error, 1e3), 95))
            points.append({"timestep": h, "p95_error": p95, "strikes_per_second": count / min(times)})
            if p95 <= BOUND:
                break
        fronts[engine] = points
    few = strikes[:64] if quick else strikes[:256]
    steps = MUJOCO_STEPS[::2] if quick else MUJOCO_STEPS
    for integrator in INTEGRATORS[: 1 if quick or name != "constant" else 2]:
        fronts[f"mujoco_batch {integrator}"] = front(
            f"Batch {integrator}",
            steps,
            lambda some, h, i=integrator: batch_miss(controller, some, i, h),
            truth,
            bar,
            strikes=few,
        )
    # the same physics one strike at a time: what Batch needs, it needs
    h = fronts["mujoco_batch Euler"][-1]["timestep"]
    bar.set_postfix_str(f"Python loop, {1e3 * h:g} ms")
    loop, alone = PythonLoop(controller, "Euler", h), strikes[: 4 if quick else 12]
    start = time.perf_counter()
    for vector in alone:
        loop.miss(vector)
    seconds = (time.perf_counter() - start) / len(alone)
    p95 = fronts["mujoco_batch Euler"][-1]["p95_error"]
    fronts["python_loop Euler"] = [{"timestep": h, "p95_error": p95, "strikes_per_second": 1 / seconds}]
    return fronts


def fastest(fronts: dict[str, list[dict]], prefix: str) -> dict:
    """The fastest point within the bound of the engines whose names begin so; the most accurate if none is."""
    last = [{"name": name, **points[-1]} for name, points in fronts.items() if name.startswith(prefix)]
    within = [point for point in last if point["p95_error"] <= BOUND]
    return max(within, key=lambda p: p["strikes_per_second"]) if within else min(last, key=lambda p: p["p95_error"])


def scaling(name: str, timestep: float) -> float:
    """Speed of all cores over that of one, per core."""
    strikes = default_bounds(MODEL.arm).sample(np.random.default_rng(1), 4096)
    speeds = []
    for threads in (1, cores()):
        rollout = CompiledRollout(MODEL, CONTROLLERS[name], timestep=timestep, threads=threads)
        times = []
        for _ in range(3):
            start = time.perf_counter()
            rollout.approach(strikes, POINT, t_stay=T_STAY)
            times.append(time.perf_counter() - start)
        speeds.append(len(strikes) / min(times))
    return speeds[1] / speeds[0] / cores()


def memory(count: int, timestep: float) -> dict:
    """Peak memory and time of a process that runs many strikes."""
    program = (
        "import resource, time, numpy as np; from whiptool.impedance import *; from whiptool.models import *;"
        "from whiptool.rollout import *;"
        "from whiptool.models.strike import default_bounds; m = preset('lemon2024');"
        f"s = default_bounds(m.arm).sample(np.random.default_rng(0), {count});"
        f"r = CompiledRollout(m, Controller(ConstantImpedance()), timestep={timestep}); t = time.perf_counter();"
        "r.approach(s, np.array([1.3, 0.0]), t_stay=0.3, progress=True);"
        "print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20, time.perf_counter() - t)"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    gib, seconds = map(float, done.stdout.split())
    return {"strikes": count, "peak_gib": gib, "seconds": seconds}


def starts() -> dict:
    """Time to the outcome of a first strike after import, with an empty cache and with a full one [s]."""
    program = (
        "import numpy as np, time; from whiptool.impedance import *; from whiptool.models import *;"
        "from whiptool.rollout import *;"
        "t = time.perf_counter(); r = CompiledRollout(preset('lemon2024'), Controller(ConstantImpedance()));"
        "r.approach(np.array([[-1.2, 0.9, 1.2, 0.3, 0.7]]), np.array([1.3, 0.0]), t_stay=0.3);"
        "print(time.perf_counter() - t)"
    )
    with tempfile.TemporaryDirectory() as folder:
        environment = {**os.environ, "XDG_CACHE_HOME": folder}
        run = [sys.executable, "-c", program]
        cold, *warm = (
            float(subprocess.run(run, env=environment, capture_output=True, text=True, check=True).stdout)
            for _ in range(4)
        )
    return {"cold": cold, "warm": min(warm)}


def plot(report: dict, path: Path) -> None:
    """Error against cost, one panel per controller."""
    from matplotlib.figure import Figure

    colors = {
        "simd": "#0072B2",
        "scalar": "#56B4E9",
        "interpreter": "#009E73",
        "mujoco_batch Euler": "#D55E00",
        "mujoco_batch implicitfast": "#E69F00",
        "python_loop Euler": "#CC79A7",
    }
    figure = Figure(figsize=(5.2 * len(report), 4.8), layout="constrained")
    for ax, (name, entry) in zip(figure.subplots(1, len(report), squeeze=False)[0], report.items(), strict=True):
        for engine, points in entry["fronts"].items():
            kept = [p for p in points if p["p95_error"] < 10]
            ax.loglog(
                [1e3 / p["strikes_per_second"] for p in kept],
                [1e3 * p["p95_error"] for p in kept],
                "o-",
                color=colors[engine],
                label=engine.replace("_", " "),
            )
        ax.axhline(1e3 * BOUND, color="#666666", ls="--", lw=1)
        ax.set(title=name, xlabel="cost [ms per strike]", ylabel="95th percentile of the error in miss distance [mm]")
        ax.grid(alpha=0.3)
    handles, labels = figure.axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3 if len(report) == 1 else 6)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=150)


def main() -> None:
    """Measure, print, plot."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="constant controller only, fewer strikes")
    parser.add_argument("--json", action="store_true", help="one JSON object instead of a table")
    parser.add_argument("--plot", type=Path, default=Path("runs/accuracy-cost.png"))
    arguments = parser.parse_args()
    mujoco.set_mju_user_warning(lambda message: None)  # unstable steps are tried on purpose
    report = {}
    with tqdm(["constant"] if arguments.quick else list(CONTROLLERS), leave=False) as bar:
        for name in bar:
            fronts = measure(name, quick=arguments.quick, bar=bar)
            best = {
                key: fastest(fronts, key) for key in ("simd", "scalar", "interpreter", "mujoco_batch", "python_loop")
            }
            speed = best["simd"]["strikes_per_second"]
            report[name] = {
                "best": best,
                "fronts": fronts,
                "simd_over_mujoco_batch": speed / best["mujoco_batch"]["strikes_per_second"],
                "simd_over_python_loop": speed / best["python_loop"]["strikes_per_second"],
                "strikes_per_second": speed,
            }
    step = report["constant"]["best"]["simd"]["timestep"]
    keys = ("simd_over_mujoco_batch", "simd_over_python_loop", "strikes_per_second")
    summary = {key: report["constant"][key] for key in keys} | {
        "scaling_with_cores": scaling("constant", step),
        "memory": memory(20_000 if arguments.quick else 1_000_000, step),
        "first_strike": starts(),
    }
    plot(report, arguments.plot)
    if arguments.json:
        print(json.dumps({**summary, "bound": BOUND, "cores": cores(), "controllers": report}))
        return
    print(f"95th percentile of the error in miss distance <= {1e3 * BOUND:g} mm, {cores()} cores")
    for name, entry in report.items():
        print(name)
        for e in entry["best"].values():
            mark = "" if e["p95_error"] <= BOUND else "   (bound not reached)"
            print(
                f"  {e['name']:26s} {e['strikes_per_second']:9.2f} strikes/s at {1e3 * e['timestep']:.4g} ms, error "
                f"{1e3 * e['p95_error']:.3f} mm{mark}"
            )
        print(
            f"  SIMD over Batch {entry['simd_over_mujoco_batch']:.0f}, over the Python loop "
            f"{entry['simd_over_python_loop']:.0f}"
        )
    m, s = summary["memory"], summary["first_strike"]
    print(
        f"scaling with cores {summary['scaling_with_cores']:.2f}; {m['strikes']} strikes in {m['seconds']:.0f} s with "
        f"{m['peak_gib']:.2f} GiB; first strike {s['cold']:.2f} s cold, {s['warm']:.2f} s warm; {arguments.plot}"
    )


if __name__ == "__main__":
    main()
