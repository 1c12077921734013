"""How fast is a strike? Compiled rollout, MuJoCo with a Python controller, and MuJoCo's own C loop, at equal error.

Every engine runs on one core, with the largest step at which the 95th percentile of its error in miss distance stays
within the bound (0.3 mm); the error is taken against the compiled rollout at 0.02 ms, which `benchmarks/accuracy.py`
compares with MuJoCo's RK4. The Python loop is what one writes by hand: `ctrl` set from NumPy and Pinocchio, then
`mj_step`, with whichever of MuJoCo's integrators gets there cheapest, or RK4 with the controller at every stage.
MuJoCo's C loop (`mj_step` with many steps a call) has no controller at all, hence no error; it takes the same
integrator and step as the Python loop.

    python benchmarks/rollout.py [--quick] [--json]
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable

import mujoco
import numpy as np
from tqdm import tqdm

from whiptool.goals.target import TARGET
from whiptool.impedance import OIAC_PRESETS, ConstantImpedance, Controller
from whiptool.impedance.arm import Arm
from whiptool.models import preset
from whiptool.models.strike import T_STAY, Strike, default_bounds
from whiptool.models.trajectory import Trajectory
from whiptool.rollout import CompiledRollout, ReferenceRollout
from whiptool.rollout.mujoco_model import build_spec

MODEL = preset("lemon2024")
CONTROLLERS = {"constant": Controller(ConstantImpedance())} | {
    f"oiac {name}": Controller(law) for name, law in OIAC_PRESETS.items()
}
POINT = np.array(TARGET)
BOUND = 3e-4  # [m], 95th percentile of the error in miss distance
COMPILED_STEPS = (4e-3, 2.83e-3, 2e-3, 1.41e-3, 1e-3, 7.1e-4, 5e-4, 3.5e-4, 2.5e-4, 1.8e-4, 1.25e-4)
MUJOCO_STEPS = {
    "RK4, controller per stage": (1.4e-4, 1e-4, 7e-5, 5e-5),
    "implicitfast": (4e-4, 2e-4, 1e-4, 5e-5, 2.5e-5),
    "Euler": (4e-4, 2e-4, 1e-4, 5e-5, 2.5e-5),
}


class PythonLoop:
    """MuJoCo stepped from Python, the torque set once a step and held."""

    def __init__(self, controller: Controller, integrator: str, timestep: float) -> None:
        self.controller, self.arm = controller, Arm(MODEL)
        self.model = build_spec(MODEL).compile()
        self.model.opt.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{integrator.upper()}")
        self.model.opt.timestep = timestep
        self.data = mujoco.MjData(self.model)
        self.tip = self.model.site("tip").id

    def miss(self, vector: np.ndarray) -> float:
        """Miss distance [m], the closest approach taken on the segments between steps."""
        model, data, strike = self.model, self.data, Strike.from_vector(vector)
        loop = self.controller.bind(self.arm, strike)
        mujoco.mj_resetData(model, data)
        data.qpos[:2], data.qpos[2] = strike.q_i, -sum(strike.q_i)
        steps = round((strike.D + T_STAY) / model.opt.timestep)
        tips = np.empty((steps, 2))
        qpos, qvel, ctrl, tip = data.qpos, data.qvel, data.ctrl, data.site_xpos[self.tip]
        for i in range(steps):
            ctrl[:] = loop.torque(i * model.opt.timestep, qpos[:2], qvel[:2])
            mujoco.mj_step(model, data)
            tips[i] = tip[::2]  # of the state before the step
        if data.time == 0 or not np.isfinite(tips).all() or data.warning.number.any():
            return np.inf
        none = np.zeros((steps, 2))
        path = Trajectory(np.arange(steps) * 1.0, none, none, none, none, none, none, none, tips, none)
        return float(path.approach(POINT).distance[0])


def reference_miss(controller: Controller, timestep: float) -> Callable[[np.ndarray], float]:
    """Miss distance by MuJoCo's RK4 with the controller at every stage."""
    rollout = ReferenceRollout(MODEL, controller, timestep=timestep)

    def miss(vector: np.ndarray) -> float:
        path = rollout.trajectory(Strike.from_vector(vector), t_stay=T_STAY)
        return np.inf if path.diverged else float(path.approach(POINT).distance[0])

    return miss


def timed(call: Callable[[], object], repeats: int) -> float:
    """Shortest of several times [s]."""
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        call()
        times.append(time.perf_counter() - start)
    return min(times)


def compiled_entry(controller: Controller, strikes: np.ndarray, truth: np.ndarray, *, engine: str) -> dict:
    """The compiled rollout at its largest sufficient step."""
    for h in COMPILED_STEPS:
        rollout = CompiledRollout(MODEL, controller, timestep=h)
        near = rollout.approach(strikes, POINT, t_stay=T_STAY)
        error = np.percentile(np.where(near.diverged, np.inf, np.abs(near.distance - truth)), 95)
        if error <= BOUND:
            break
    few = strikes[:8] if engine == "interpreter" else strikes
    rollout = CompiledRollout(MODEL, controller, timestep=h, engine=engine, threads=1)
    seconds = timed(lambda: rollout.approach(few, POINT, t_stay=T_STAY), 3)
    return {
        "engine": rollout.engine,
        "timestep": h,
        "p95_error": float(error),
        "strikes_per_second": len(few) / seconds,
    }


def mujoco_entries(controller: Controller, strikes: np.ndarray, truth: np.ndarray, bar: tqdm) -> tuple[dict, dict]:
    """The cheapest sufficient Python loop, and the cheapest C loop among the sufficient integrators."""
    loops, bare = [], []
    for name, steps in MUJOCO_STEPS.items():
        for h in steps:
            if name.startswith("RK4"):
                integrator, miss = "RK4", reference_miss(controller, h)
            else:
                integrator, miss = name, PythonLoop(controller, name, h).miss
            bar.set_postfix_str(f"{name}, {1e3 * h:g} ms")
            first = np.array([miss(s) for s in strikes[:4]])  # do not waste minutes on a hopeless step
            if np.median(np.abs(first - truth[:4])) > BOUND:
                continue
            start = time.perf_counter()
            error = np.percentile(np.abs(np.array([miss(s) for s in strikes]) - truth), 95)
            seconds = (time.perf_counter() - start) / len(strikes)
            if error <= BOUND:
                entry = {
                    "integrator": name,
                    "timestep": h,
                    "p95_error": float(error),
                    "strikes_per_second": 1 / seconds,
                }
                loops.append(entry)
                bare.append({"integrator": integrator, "timestep": h,
                             "strikes_per_second": mujoco_c(strikes, integrator, h)})  # fmt: skip
                break
    if not loops:
        raise SystemExit("no integrator of MuJoCo reached the bound; extend MUJOCO_STEPS")
    return (max(entries, key=lambda entry: entry["strikes_per_second"]) for entries in (loops, bare))


def mujoco_c(strikes: np.ndarray, integrator: str, timestep: float) -> float:
    """Strikes per second of MuJoCo's own loop, the arm hanging loose."""
    model = build_spec(MODEL).compile()
    model.opt.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{integrator.upper()}")
    model.opt.timestep = timestep
    data = mujoco.MjData(model)
    few = strikes[:8]

    def run() -> None:
        for vector in few:
            mujoco.mj_resetData(model, data)
            data.qpos[:2], data.qpos[2] = vector[:2], -vector[:2].sum()
            mujoco.mj_step(model, data, nstep=round((vector[-1] + T_STAY) / timestep))

    return len(few) / timed(run, 3)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="16 strikes instead of 64, constant controller only")
    parser.add_argument("--json", action="store_true", help="one JSON object instead of a table")
    arguments = parser.parse_args()
    mujoco.set_mju_user_warning(lambda message: None)  # unstable steps are tried on purpose
    strikes = default_bounds(MODEL.arm).sample(np.random.default_rng(7), 16 if arguments.quick else 64)
    names = ["constant"] if arguments.quick else list(CONTROLLERS)
    report = {}
    with tqdm(names, leave=False) as bar:
        for name in bar:
            controller = CONTROLLERS[name]
            truth = CompiledRollout(MODEL, controller, timestep=2e-5).approach(strikes, POINT, t_stay=T_STAY).distance
            compiled = compiled_entry(controller, strikes, truth, engine="scalar")
            interpreted = compiled_entry(controller, strikes, truth, engine="interpreter")
            loop, bare = mujoco_entries(controller, strikes, truth, bar)
            speed = compiled["strikes_per_second"]
            report[name] = {
                "compiled": compiled, "interpreted": interpreted, "python_loop": loop, "mujoco_c": bare,
                "compiled_over_python_loop": speed / loop["strikes_per_second"],
                "compiled_over_mujoco_c": speed / bare["strikes_per_second"],
                "interpreted_over_python_loop": interpreted["strikes_per_second"] / loop["strikes_per_second"],
            }  # fmt: skip
    headline = {key: report["constant"][key] for key in ("compiled_over_python_loop", "compiled_over_mujoco_c")}
    if arguments.json:
        print(json.dumps({**headline, "strikes": len(strikes), "bound": BOUND, "controllers": report}))
        return
    print(
        f"{len(strikes)} random strikes, one core, 95th percentile of the error in miss distance <= {1e3 * BOUND:g} mm"
    )
    for name, entry in report.items():
        print(name)
        for engine in ("compiled", "interpreted", "python_loop", "mujoco_c"):
            e = entry[engine]
            how = e.get("integrator", e.get("engine"))
            error = f"error {1e3 * e['p95_error']:.3f} mm" if "p95_error" in e else "no controller"
            print(
                f"  {engine:12s} {e['strikes_per_second']:9.2f} strikes/s   {1e3 * e['timestep']:.3g} ms, "
                f"{how}, {error}"
            )
        print(
            f"  compiled over Python loop {entry['compiled_over_python_loop']:.0f}, over MuJoCo's C loop "
            f"{entry['compiled_over_mujoco_c']:.1f}; interpreted over Python loop "
            f"{entry['interpreted_over_python_loop']:.1f}"
        )


if __name__ == "__main__":
    main()
