"""How fast are strikes in space? Ours, of both kinds of whip, against MuJoCo stepped from a Python loop.

Of the person's arm of Nah et al. 2023 under its impedance, its whip of N = 12 and 25 nodes on universal joints or of
rods, and of the UR5e with a stick and 1 m of rope in 20 segments, rods or universal, its joints on their reference
(position control) or under impedance. Errors are those of miss distances against a run at a far smaller step, of the
same kind of whip. MuJoCo's loop (implicitfast, torques set once a step and held; one core, as Python is) has a median
error at its step; ours (all cores) is run at its largest step whose median error is no larger: that is the ratio
`space_over_mujoco_loop`, for the whip as published, on universal joints, N = 25. `strikes_per_second` of it,
`strikes_per_second_ur5e` of the UR5e under position control with a rope of rods, and
`strikes_per_second_ur5e_impedance` of the UR5e under impedance with universal joints, are at a 95th percentile of the
error of 0.1 mm; all random strikes are rolled out there, and `diverged` counts those that diverged.
`compile_seconds`: of a first strike with an empty cache.

    python benchmarks/space.py [--quick] [--json]
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from dataclasses import replace

import mujoco
import numpy as np
from tqdm import tqdm

from whiptool.dynamics.posture import start_posture
from whiptool.impedance import Controller, constant_preset, default_controller
from whiptool.impedance.arm import Arm
from whiptool.limits.arm_limits import ArmLimits
from whiptool.models import Model, WhipProfile, preset
from whiptool.models.presets import rope
from whiptool.models.strike import T_STAY, Strike, default_bounds
from whiptool.models.trajectory import closest_on_segments
from whiptool.rollout import CompiledRollout
from whiptool.rollout.mujoco_model import build_spec
from whiptool.rollout.native import cores

BOUND = 1e-4  # [m], 95th percentile
STEPS = (4e-3, 2.83e-3, 2e-3, 1.41e-3, 1e-3, 7.1e-4, 5e-4, 3.5e-4, 2.5e-4, 1.8e-4, 1.25e-4, 9e-5, 6.3e-5)
TRUE_STEP = 2e-5
TRUE_STEP_LED = 1e-4  # [s], of joints on their reference: steps are of fourth order
MUJOCO_STEP = 5e-5
ON_REFERENCE, UNDER_IMPEDANCE = "ur5e, rod, on reference", "ur5e, universal, under impedance"
TARGETS = {"nah2023": np.array([1.995, 0.0, 0.0]), "ur5e": np.array([1.2, 0.3, 0.5])}


def with_whip(model: Model, joints: str, N: int) -> Model:
    """The model with as long and heavy a whip of another kind, or of other nodes."""
    whip = model.whip
    if N != whip.N:
        share = whip.N / N
        profile = WhipProfile(
            length=whip.length,
            linear_density=whip.mass / whip.length,
            bending_stiffness=float(whip.per_node("k")[1] * whip.per_node("l")[1]),
            bending_damping=float(whip.per_node("b")[1] * whip.per_node("l")[1]),
        )
        inertia = share * float(whip.per_node("node_inertia")[0])
        whip = profile.lump(N, joints="universal", node_inertia=inertia)
    changes = {"joints": joints} | ({"node_inertia": 0.0} if joints == "rod" else {})
    return replace(model, whip=replace(whip, **changes), name=f"{model.name}, {joints}, N = {N}")


def strikes_of(name: str, count: int) -> np.ndarray:
    """Random strikes, of a robot no faster than its joints are."""
    arm = preset(name).arm
    strikes = default_bounds(arm).sample(np.random.default_rng(7), count)
    return ArmLimits.of(arm).command.shortened(strikes) if ArmLimits.are_in(arm) else strikes


class MuJoCoLoop:
    """MuJoCo stepped from Python, the torque set once a step and held."""

    def __init__(self, model: Model, controller: Controller, timestep: float) -> None:
        self.described, self.controller, self.arm = model, controller, Arm(model)
        self.model = build_spec(model).compile()
        self.model.opt.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        self.model.opt.timestep = timestep
        self.data = mujoco.MjData(self.model)
        self.tip = self.model.site("tip").id

    def miss(self, vector: np.ndarray, target: np.ndarray) -> float:
        """Miss distance [m], the closest approach taken on the segments between steps; infinite if it diverged."""
        model, data, strike, a = self.model, self.data, Strike.from_vector(vector), self.described.arm.n
        loop = self.controller.bind(self.arm, strike)
        mujoco.mj_resetData(model, data)
        data.qpos[:] = start_posture(self.described, np.array([strike.q_i]))[0]
        steps = round((strike.D + T_STAY) / model.opt.timestep)
        tips = np.empty((steps, 3))
        qpos, qvel, ctrl, tip = data.qpos, data.qvel, data.ctrl, data.site_xpos[self.tip]
        for i in range(steps):
            ctrl[:] = loop.torque(i * model.opt.timestep, qpos[:a], qvel[:a])
            mujoco.mj_step(model, data)
            tips[i] = tip  # of the state before the step
        if not np.isfinite(tips).all() or data.warning.number.any():
            return np.inf
        return float(closest_on_segments(tips, target).distance)


def mujoco_loop(model: Model, controller: Controller, strikes: np.ndarray, truth: np.ndarray, bar: tqdm) -> dict:
    """Median error, of the strikes that do not diverge, and speed of the Python loop."""
    loop, misses = MuJoCoLoop(model, controller, MUJOCO_STEP), []
    start = time.perf_counter()
    for i, strike in enumerate(strikes):
        bar.set_postfix_str(f"MuJoCo, strike {i + 1} of {len(strikes)}")
        misses.append(loop.miss(strike, TARGETS["nah2023"]))
    seconds = (time.perf_counter() - start) / len(strikes)
    ended = np.isfinite(misses)
    if ended.sum() < 3:
        raise SystemExit("most of MuJoCo's strikes diverged; make MUJOCO_STEP smaller")
    error = np.abs(np.array(misses) - truth)[ended]
    return {
        "timestep": MUJOCO_STEP,
        "median_error": float(np.median(error)),
        "diverged": int((~ended).sum()),
        "strikes_per_second": 1 / seconds,
    }


def ours(
    model: Model, controller: Controller, strikes: np.ndarray, checked: int, bar: tqdm, *, name: str, median: float
) -> dict:
    """The compiled rollout at its largest steps within a median error, and within `BOUND`.

    Args:
        model, controller: What is struck with.
        strikes: What is timed.
        checked: Of how many of them the errors are taken.
        bar: Says what is being done.
        name: The preset that the target is of.
        median: Median of the errors [m].
    """
    target, true_step = TARGETS[name], TRUE_STEP_LED if controller.prescribed else TRUE_STEP
    bar.set_postfix_str(f"{model.name}, truth")
    true = CompiledRollout(model, controller, timestep=true_step).approach(strikes[:checked], target)
    found: dict[str, dict] = {}
    for h in STEPS:
        bar.set_postfix_str(f"{model.name}, {1e3 * h:g} ms")
        rollout = CompiledRollout(model, controller, timestep=h)
        some = rollout.approach(strikes[:checked], target)
        error = np.where(some.diverged, 1e3, np.abs(some.distance - true.distance))
        numbers = {"median_error": float(np.median(error)), "p95_error": float(np.percentile(error, 95))}
        within = {"median": numbers["median_error"] <= median, "p95": numbers["p95_error"] <= BOUND}
        for which in (key for key, enough in within.items() if enough and key not in found):
            start = time.perf_counter()
            every = rollout.approach(strikes, target)
            speed = len(strikes) / (time.perf_counter() - start)
            diverged = int(every.diverged.sum())
            found[which] = {"timestep": h, **numbers, "strikes_per_second": speed, "diverged": diverged}
        if len(found) == 2:
            return {"engine": rollout.engine, "strikes": len(strikes), **found}
    raise SystemExit(f"no step reached the bounds for {model.name}; extend STEPS")


def cases(*, quick: bool) -> list[tuple[str, Model, Controller]]:
    """What is measured: the preset that strikes and target are of, a model with a different name, its controller."""
    nah, ur5e = preset("nah2023"), preset("ur5e")
    human, robot = (Controller(constant_preset(name)) for name in ("nah2023", "ur5e"))
    universal = replace(ur5e, whip=rope(joints="universal"), name=UNDER_IMPEDANCE)
    found = [("nah2023", nah, human), ("ur5e", universal, robot)]
    found += [("ur5e", replace(ur5e, name=ON_REFERENCE), default_controller(ur5e))]
    if quick:
        return found
    found += [("ur5e", replace(universal, name="ur5e, universal, on reference"), default_controller(ur5e))]
    found += [("ur5e", replace(ur5e, name="ur5e, rod, under impedance"), robot)]
    others = (("universal", 12), ("rod", 12), ("rod", 25))
    return found + [("nah2023", with_whip(nah, joints, N), human) for joints, N in others]


def starts() -> dict:
    """Time to the outcome of a first strike after import, with an empty cache and with a full one [s]."""
    program = (
        "import numpy as np, time; from whiptool.impedance import *; from whiptool.models import *;"
        "from whiptool.rollout import *; m = preset('nah2023'); s = default_bounds(m.arm).box[0];"
        "t = time.perf_counter(); r = CompiledRollout(m, Controller(constant_preset('nah2023')));"
        "r.approach(s[None], np.array([2.0, 0.0, 0.0])); print(time.perf_counter() - t)"
    )
    with tempfile.TemporaryDirectory() as folder:
        environment, run = {**os.environ, "XDG_CACHE_HOME": folder}, [sys.executable, "-c", program]
        cold, warm = (
            float(subprocess.run(run, env=environment, capture_output=True, text=True, check=True).stdout)
            for _ in range(2)
        )
    return {"cold": cold, "warm": warm}


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="few strikes, of the headlines' models only")
    parser.add_argument("--json", action="store_true", help="one JSON object instead of a table")
    arguments = parser.parse_args()
    mujoco.set_mju_user_warning(lambda message: None)  # a shoulder's gimbal lock makes some strikes diverge
    by_loop, checked, timed = (8, 16, 64) if arguments.quick else (16, 128, 2000)
    controller = Controller(constant_preset("nah2023"))
    with tqdm(cases(quick=arguments.quick), leave=False) as bar:
        strikes, nah = strikes_of("nah2023", timed), preset("nah2023")
        exact = CompiledRollout(nah, controller, timestep=TRUE_STEP).approach(strikes[:by_loop], TARGETS["nah2023"])
        loop = mujoco_loop(nah, controller, strikes[:by_loop], exact.distance, bar)
        report = {
            model.name: ours(
                model, driven, strikes_of(name, timed), checked, bar, name=name, median=loop["median_error"]
            )
            for name, model, driven in bar
        }
    start = starts()
    headline = {
        "space_over_mujoco_loop": report["nah2023"]["median"]["strikes_per_second"] / loop["strikes_per_second"],
        "strikes_per_second": report["nah2023"]["p95"]["strikes_per_second"],
        "strikes_per_second_ur5e": report[ON_REFERENCE]["p95"]["strikes_per_second"],
        "strikes_per_second_ur5e_impedance": report[UNDER_IMPEDANCE]["p95"]["strikes_per_second"],
        "compile_seconds": start["cold"],
    }
    if arguments.json:
        extra = {"warm_seconds": start["warm"], "bound": BOUND, "cores": cores(), "mujoco_loop": loop, "models": report}
        print(json.dumps({**headline, **extra}))
        return
    seconds = f"a first strike after {start['cold']:.1f} s, later {start['warm']:.2f} s"
    print(f"{timed} random strikes on {cores()} cores; {seconds}")
    print(
        f"  MuJoCo from Python {loop['strikes_per_second']:9.3f} strikes/s   {1e3 * loop['timestep']:.3g} ms, median "
        f"of the error {1e3 * loop['median_error']:.3f} mm, {loop['diverged']} of {by_loop} diverged"
    )
    for name, entry in report.items():
        for which, error in (("median", "median_error"), ("p95", "p95_error")):
            e = entry[which]
            print(
                f"  {name:30s} {e['strikes_per_second']:9.1f} strikes/s   {1e3 * e['timestep']:.3g} ms, {which} of the "
                f"error {1e3 * e[error]:.3f} mm, {e['diverged']} of {entry['strikes']} diverged"
            )
    print(f"  over MuJoCo's loop at equal median error: {headline['space_over_mujoco_loop']:.0f}")


if __name__ == "__main__":
    main()
