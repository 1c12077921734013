"""Which whip was it? The same filmed strikes, fitted by mujoco.sysid and by whiptool, in one run.

Strikes of the preset `lemon2024` under the constant controller are seen at the tip, 60 times a second with 5 mm noise;
k, b and m are sought from one start. Both fits know the commands and have the controller in their loop, both minimise
the same residuals from the same start. For mujoco.sysid the controller is written in MuJoCo's own elements, so that
nothing in Python runs within its rollouts: K and B as springs and dampers of the joints and of a tendon that couples
them, K q_d + B dq_d as the motors' torque, gravity compensation (Eq. 3) as `gravcomp` of the links and of a grain at
the hand. It steps with `implicitfast` at 0.25 ms and differentiates by differences.
Needs `pip install "mujoco[sysid]"`.

    python benchmarks/identify.py [--quick] [--json]
"""

from __future__ import annotations

import argparse
import json
import logging
import time

import mujoco
import numpy as np
from mujoco import sysid
from scipy.interpolate import CubicSpline
from tqdm import tqdm

from whiptool.identification.fit import Options, fit
from whiptool.identification.plant import Plant
from whiptool.identification.recording import StrikeRecording
from whiptool.impedance import ConstantImpedance, Controller
from whiptool.models import CompiledRollout, Model, preset
from whiptool.models.mujoco_model import build_spec
from whiptool.models.posture import start_posture
from whiptool.models.trajectory import Trajectory
from whiptool.strike import Strike, default_bounds

FREE = ("whip.k", "whip.b", "whip.m")
START = {"whip.k": 0.35, "whip.b": 0.06, "whip.m": 0.018}
SIGMA, RATE, STEP = 5e-3, 60.0, 2.5e-4
GRAIN = 1e-6  # [kg]


def record(path: Trajectory, strike: Strike, rng: np.random.Generator, sigma: float = SIGMA) -> StrikeRecording:
    """The tip of a strike as a camera sees it."""
    t = np.arange(1 / RATE, path.t[-1], 1 / RATE)
    points = CubicSpline(path.t, path.tip)(t) + sigma * rng.standard_normal((len(t), 2))
    return StrikeRecording(t=t, points=points[:, None], markers=("tip",), sigma=np.array(SIGMA), strike=strike)


def put(element, field: str, value: float) -> None:
    """Set a spring or damper of a joint or tendon; MuJoCo 4 keeps polynomials, the linear term first."""
    old = np.array(getattr(element, field), float)
    setattr(element, field, value if old.ndim == 0 else np.r_[value, np.zeros(old.size - 1)])


class Peer:
    """mujoco.sysid on these recordings."""

    def __init__(self, model: Model, law: ConstantImpedance, recordings: list[StrikeRecording]) -> None:
        self.model, (K, B) = model, (np.array(law.K), np.array(law.B))
        spec = build_spec(model)
        spec.option.timestep, spec.option.integrator = STEP, mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        tip = {"objtype": mujoco.mjtObj.mjOBJ_SITE, "objname": "tip"}
        spec.add_sensor(name="tip", type=mujoco.mjtSensor.mjSENS_FRAMEPOS, **tip)
        both = spec.add_tendon(name="coupling", springlength=[0, 0])
        put(both, "stiffness", K[0, 1])
        put(both, "damping", B[0, 1])
        for i, (name, link) in enumerate(zip(model.arm.joints, model.arm.links, strict=True)):
            joint = spec.joint(name)
            both.wrap_joint(name, 1.0)
            put(joint, "stiffness", K[i, i] - K[0, 1])
            put(joint, "damping", B[i, i] - B[0, 1] + link.friction)
            spec.body(name).gravcomp = 1.0
        tiny = {"ipos": [0, 0, 0], "inertia": [1e-12] * 3, "explicitinertial": True}
        spec.body(model.arm.joints[-1]).add_body(
            name="hand",
            pos=[0, 0, -model.arm.links[-1].length],
            mass=GRAIN,
            gravcomp=1 + model.whip.mass / GRAIN,
            **tiny,
        )
        compiled = spec.compile()
        start = start_posture(model, np.array([r.strike.q_i for r in recordings]))
        self.sequences = []
        for q, recording in zip(start, recordings, strict=True):
            grid = np.arange(0, recording.t[-1] + 0.01, STEP)
            q_d, v_d, _ = recording.strike.reference(grid + STEP / 2)  # the middle of what is held over a step
            control = sysid.TimeSeries(grid, q_d @ K.T + v_d @ B.T)
            state = sysid.create_initial_state(compiled, q, 0 * q, np.zeros(0))
            tip = np.stack([recording.points[:, 0, 0], 0 * recording.t, recording.points[:, 0, 1]], axis=1)
            measured = sysid.TimeSeries.from_names(recording.t, tip, compiled)
            self.sequences.append(sysid.ModelSequences("whip", spec, "strike", state, control, measured))

    def parameters(self) -> sysid.ParameterDict:
        """k, b, m as factors of the start, and how they enter the model."""
        N = self.model.whip.N

        def joints(spec: mujoco.MjSpec, field: str, value: float) -> None:
            for i in range(2, N + 1):
                put(spec.joint(f"whip{i}"), field, value)

        def masses(spec: mujoco.MjSpec, value: float) -> None:
            for i in range(N):
                spec.body(f"whip{i + 1}").mass = value
            spec.body("hand").gravcomp = 1 + N * value / GRAIN

        change = {
            "whip.k": lambda spec, p: joints(spec, "stiffness", START["whip.k"] * p.value[0]),
            "whip.b": lambda spec, p: joints(spec, "damping", START["whip.b"] * p.value[0]),
            "whip.m": lambda spec, p: masses(spec, START["whip.m"] * p.value[0]),
        }
        parameters = sysid.ParameterDict()
        for name in FREE:
            parameters.add(sysid.Parameter(name, nominal=1.0, min_value=0.1, max_value=10.0, modifier=change[name]))
        return parameters

    def fit(self) -> dict[str, float]:
        """Fitted values."""

        def residual(params, predicted, measured, model, return_all, *, state):
            seen = predicted.resample(measured.times)
            r = (seen.data - measured.data)[:, [0, 2]] / SIGMA
            return r.ravel(), seen, seen  # it compares their signal mappings, arrays and all

        function = sysid.build_residual_fn(models_sequences=self.sequences, modify_residual=residual)
        found, _ = sysid.optimize(
            initial_params=self.parameters(), residual_fn=function, optimizer="mujoco", verbose=False
        )
        return {name: float(START[name] * found[name].value[0]) for name in FREE}


def main() -> None:
    """Fit and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="2 noise seeds")
    parser.add_argument("--json", action="store_true", help="one JSON object instead of a table")
    arguments = parser.parse_args()
    logging.getLogger("absl").setLevel(logging.ERROR)
    model, controller = preset("lemon2024"), Controller(ConstantImpedance())
    vectors = default_bounds(model.arm).sample(np.random.default_rng(0), 8)
    strikes = [Strike.from_vector(v) for v in vectors]
    truth = list(CompiledRollout(model, controller, timestep=1e-4).trajectories(vectors, t_stay=0.3))
    true = {name: model.parameters()[name] for name in FREE}
    clean = [record(p, s, np.random.default_rng(0), 0.0) for p, s in zip(truth[4:], strikes[4:], strict=True)]
    found: dict[str, list] = {"whiptool": [], "mujoco.sysid": []}
    for seed in tqdm(range(-1, 2 if arguments.quick else 20), leave=False):
        rng = np.random.default_rng(max(seed, 0))
        films = [record(p, s, rng) for p, s in zip(truth[:4], strikes[:4], strict=True)]
        for method, results in found.items():
            if seed < 0 and method != "whiptool":
                continue
            began = time.perf_counter()
            if method == "whiptool":
                plant = Plant(model.with_parameters(START), controller)
                ours = fit(films, plant, FREE, options=Options(loss=None, replicates=100))
                values = {name: ours[name].value for name in FREE}
            else:
                values = Peer(model.with_parameters(START), ConstantImpedance(), films).fit()
            wall = time.perf_counter() - began
            if seed < 0:  # whiptool compiles before the clock starts
                continue
            rollout = CompiledRollout(model.with_parameters(values), controller)
            errors = []
            for strike, film in zip(strikes[4:], clean, strict=True):
                path = rollout.trajectory(strike, t_stay=0.3)
                errors.append(np.mean((CubicSpline(path.t, path.tip)(film.t) - film.points[:, 0]) ** 2))
            off = np.array([np.log(values[name] / true[name]) for name in FREE])
            results.append((wall, float(np.sqrt(np.mean(off**2))), float(np.sqrt(2 * np.mean(errors)))))
    report = {
        method: dict(zip(("wall_time", "parameter_error", "held_out_rmse"), np.median(r, axis=0).tolist(), strict=True))
        for method, r in found.items()
    }
    ours, peer = report["whiptool"], report["mujoco.sysid"]
    report |= {
        "speed_over_mujoco_sysid": peer["wall_time"] / ours["wall_time"],
        "error_over_mujoco_sysid": ours["parameter_error"] / peer["parameter_error"],
        "held_out_over_mujoco_sysid": ours["held_out_rmse"] / peer["held_out_rmse"],
    }
    if arguments.json:
        print(json.dumps({"seeds": len(found["whiptool"]), **report}))
        return
    print(f"4 strikes fitted, 4 held out, {len(found['whiptool'])} noise seeds; medians")
    for method in found:
        r = report[method]
        print(
            f"  {method:13s} {r['wall_time']:7.2f} s   k, b, m off by {100 * r['parameter_error']:.2f} % (RMS of the "
            f"logarithms)   held-out tip RMSE {1e3 * r['held_out_rmse']:.2f} mm"
        )
    print(
        f"  {report['speed_over_mujoco_sysid']:.1f} times faster, error times {report['error_over_mujoco_sysid']:.2f}"
    )


if __name__ == "__main__":
    main()
