"""Which whip was it? The same filmed strikes, fitted by mujoco.sysid and by whiptool, in one run.

Strikes of the preset `lemon2024` under the constant controller are seen at the tip, 60 times a second with 5 mm noise;
k, b and m are sought from one start. Both fits know the commands and have the controller in their loop, both minimise
the same residuals from the same start. For mujoco.sysid the controller is written in MuJoCo's own elements, so that
nothing in Python runs within its rollouts: K and B as springs and dampers of the joints and of a tendon that couples
them, K q_d + B dq_d as the motors' torque, gravity compensation (Eq. 3) as `gravcomp` of the links and of a grain at
the hand. It steps with `implicitfast` at 0.25 ms and differentiates by differences.

Each set of recordings comes with its mirror image: the same noise with the other sign. Both fits are least squares, so
that noise moves both alike, and what sets them apart is where they end without noise: `implicitfast` is of first order
(RK4 at 0.25 ms diverges), which takes k some 4 % too high. Over a few independent sets the noise can happen to point
against that error, and the worse simulator then scores better; over sets and their mirror images it cannot. All
figures are root mean squares over the sets; those of recordings without noise are listed next to them.

The second table counts how often 95 % intervals cover the truth, with five kinds of errors.
Needs `pip install "mujoco[sysid]"`.

    python benchmarks/identify.py [--quick] [--pairs 10] [--fits 400] [--only peer|coverage] [--folder FOLDER] [--json]

With `--folder` each fit of the first table is kept, and the same command goes on; times are those of when it was done.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import logging
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import mujoco
import numpy as np
from mujoco import sysid
from scipy.interpolate import CubicSpline
from scipy.signal import lfilter
from scipy.stats import t as student
from tqdm import tqdm

from whiptool.dynamics.posture import start_posture
from whiptool.identification.fit import FitOptions, fit
from whiptool.identification.plant import Plant
from whiptool.impedance import ConstantImpedance, Controller
from whiptool.models import Model, preset
from whiptool.models.strike import Strike, default_bounds
from whiptool.models.trajectory import Trajectory
from whiptool.recording.strike_recording import StrikeRecording
from whiptool.rollout import CompiledRollout
from whiptool.rollout.mujoco_model import build_spec
from whiptool.whole_files import write_whole

FREE = ("whip.k", "whip.b", "whip.m")
START = {"whip.k": 0.35, "whip.b": 0.06, "whip.m": 0.018}
SIGMA, RATE, STEP = 5e-3, 60.0, 2.5e-4
GRAIN = 1e-6  # [kg]
METHODS = ("whiptool", "mujoco.sysid")
Fitted = tuple[dict[str, float], float]  # values, and the seconds that the fit took


def record(path: Trajectory, strike: Strike) -> StrikeRecording:
    """The tip of a strike as a camera without errors sees it."""
    t = np.arange(1 / RATE, path.t[-1], 1 / RATE)
    points = CubicSpline(path.t, path.tip)(t)
    return StrikeRecording(t=t, points=points[:, None], markers=("tip",), sigma=np.array(SIGMA), strike=strike)


def mirrored(films: Sequence[StrikeRecording], rng: np.random.Generator) -> tuple[list[StrikeRecording], ...]:
    """The recordings with noise, and with the same noise turned round."""
    errors = [SIGMA * rng.standard_normal(f.points.shape) for f in films]
    return tuple(
        [replace(f, points=f.points + sign * e) for f, e in zip(films, errors, strict=True)] for sign in (1, -1)
    )


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
        with contextlib.redirect_stdout(sys.stderr):  # where it reports its iterations
            found, _ = sysid.optimize(
                initial_params=self.parameters(), residual_fn=function, optimizer="mujoco", verbose=False
            )
        return {name: float(START[name] * found[name].value[0]) for name in FREE}


@dataclass(frozen=True)
class Bench:
    """The whip, its recordings without noise, and what a fit of them is judged by.

    Args:
        model, controller: The truth.
        fitted, held_out: Recordings without noise.
    """

    model: Model
    controller: Controller
    fitted: list[StrikeRecording]
    held_out: list[StrikeRecording]

    @classmethod
    def make(cls) -> Bench:
        """Eight random strikes, four of them to fit."""
        model, controller = preset("lemon2024"), Controller(ConstantImpedance())
        vectors = default_bounds(model.arm).sample(np.random.default_rng(0), 8)
        paths = CompiledRollout(model, controller, timestep=1e-4).trajectories(vectors, t_stay=0.3)
        films = [record(path, Strike.from_vector(v)) for path, v in zip(paths, vectors, strict=True)]
        return cls(model, controller, films[:4], films[4:])

    @property
    def true(self) -> dict[str, float]:
        """True values of what is free."""
        return {name: self.model.parameters()[name] for name in FREE}

    def fit(self, method: str, films: list[StrikeRecording]) -> Fitted:
        """Fitted values, and the seconds it took."""
        began = time.perf_counter()
        first = self.model.with_parameters(START)
        if method == "mujoco.sysid":
            values = Peer(first, ConstantImpedance(), films).fit()
        else:
            found = fit(films, Plant(first, self.controller), FREE, options=FitOptions(loss=None))
            values = {name: found[name].value for name in FREE}
        return values, time.perf_counter() - began

    def errors(self, values: dict[str, float]) -> tuple[float, float]:
        """RMS of the logarithms of k, b, m over the truth, and of the distance between held-out tips [m]."""
        off = [np.log(values[name] / x) for name, x in self.true.items()]
        rollout = CompiledRollout(self.model.with_parameters(values), self.controller)
        squares = []
        for film in self.held_out:
            path = rollout.trajectory(film.strike, t_stay=0.3)
            missed = CubicSpline(path.t, path.tip)(film.t) - film.points[:, 0]
            squares.append(np.mean(np.sum(missed**2, axis=1)))
        return float(np.sqrt(np.mean(np.square(off)))), float(np.sqrt(np.mean(squares)))


def kept_fit(bench: Bench, method: str, films: list[StrikeRecording], kept: Path | None) -> Fitted:
    """The fit of a file if there is one; else it is made, and written there if a file is named."""
    if kept is not None and kept.exists():
        values, seconds = json.loads(kept.read_text())
        return values, seconds
    found = bench.fit(method, films)
    if kept is not None:
        kept.parent.mkdir(parents=True, exist_ok=True)
        write_whole(kept, json.dumps(found))
    return found


def compare(bench: Bench, pairs: int, folder: Path | None) -> dict:
    """Both methods on the same recordings: `pairs` sets and their mirror images, and recordings without noise."""
    report = {}
    bench.fit("whiptool", bench.fitted)  # compiles before the clock starts
    sets = {"exact": bench.fitted}
    for seed in range(pairs):
        noisy, mirror = mirrored(bench.fitted, np.random.default_rng(seed))
        sets |= {f"{seed}": noisy, f"{seed}-mirrored": mirror}
    squares = {}
    for method in METHODS:
        fits = [
            kept_fit(bench, method, films, folder / f"{method}-{name}.json" if folder else None)
            for name, films in tqdm(sets.items(), desc=method, leave=False)
        ]
        errors = np.array([bench.errors(values) for values, _ in fits])
        parameter, held_out = np.sqrt(np.mean(errors[1:] ** 2, axis=0)).tolist()
        squares[method] = np.mean(errors[1:, 1].reshape(pairs, 2) ** 2, axis=1)  # of each pair
        report[method] = {
            "wall_time": float(np.median([wall for _, wall in fits[1:]])),
            "parameter_error": parameter,
            "held_out_rmse": held_out,
            "parameter_error_without_noise": float(errors[0, 0]),
            "held_out_rmse_without_noise": float(errors[0, 1]),
        }
    ours, peer = (report[method] for method in METHODS)
    return report | {
        "speed_over_mujoco_sysid": peer["wall_time"] / ours["wall_time"],
        "error_over_mujoco_sysid": ours["parameter_error"] / peer["parameter_error"],
        "held_out_over_mujoco_sysid": ours["held_out_rmse"] / peer["held_out_rmse"],
        "held_out_over_mujoco_sysid_interval": _ratio_interval(*(squares[method] for method in METHODS)),
    }


def _ratio_interval(ours: np.ndarray, peer: np.ndarray) -> tuple[float, float] | None:
    """95 % interval of the ratio of root mean squares, by the jackknife over pairs; None of fewer than three."""
    n = len(ours)
    if n < 3:
        return None
    whole = np.log(ours.sum() / peer.sum()) / 2
    left = np.log((ours.sum() - ours) / (peer.sum() - peer)) / 2
    error = np.sqrt((n - 1) / n * np.sum((left - left.mean()) ** 2))
    half = student.ppf(0.975, n - 1) * error
    return float(np.exp(whole - half)), float(np.exp(whole + half))


def independent(rng: np.random.Generator, shape: tuple[int, ...]) -> np.ndarray:
    """Errors of 5 mm, each on its own."""
    return SIGMA * rng.standard_normal(shape)


def tracked(rng: np.random.Generator, shape: tuple[int, ...], sigma: float = 3e-4) -> np.ndarray:
    """Errors of `sigma` [m] as a tracker makes them: correlated by 0.5 from frame to frame, by 0.25 two frames on."""
    warmed_up = rng.standard_normal((50 + shape[0], *shape[1:]))
    return sigma * lfilter([np.sqrt(0.75)], [1, -0.5], warmed_up, axis=0)[50:]


def smoothed(rng: np.random.Generator, shape: tuple[int, ...]) -> np.ndarray:
    """Errors of 0.3 mm that are means over five frames, as a smoothing window leaves them."""
    fresh = rng.standard_normal((4 + shape[0], *shape[1:]))
    return 3e-4 / np.sqrt(5) * lfilter(np.ones(5), 1, fresh, axis=0)[4:]


ERRORS: dict[str, Callable[[np.random.Generator, tuple[int, ...]], np.ndarray]] = {
    "independent": independent,
    "tracker 0.2 mm": partial(tracked, sigma=2e-4),
    "tracker": tracked,
    "tracker 0.5 mm": partial(tracked, sigma=5e-4),
    "smoothed": smoothed,
}


def coverage(bench: Bench, seeds: int) -> dict[str, dict[str, float]]:
    """By kind of errors and number: in what share of the fits the 95 % interval covers the truth."""
    plant, found = Plant(bench.model, bench.controller), {}
    for kind, errors in ERRORS.items():
        covered = dict.fromkeys(FREE, 0)
        for seed in tqdm(range(seeds), desc=kind, leave=False):
            rng = np.random.default_rng(seed)
            films = [replace(f, points=f.points + errors(rng, f.points.shape)) for f in bench.fitted]
            fitted = fit(films, plant, FREE)
            for name, true in bench.true.items():
                low, high = fitted[name].interval or (np.inf, -np.inf)
                covered[name] += low <= true <= high
        found[kind] = {name: count / seeds for name, count in covered.items()}
    return found


def main() -> None:
    """Fit and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="one set and its mirror image; 10 fits a kind of errors")
    parser.add_argument("--pairs", type=int, default=10, help="sets of recordings, each with its mirror image")
    parser.add_argument("--fits", type=int, default=400, help="fits whose intervals are counted, a kind of errors")
    parser.add_argument("--only", choices=("peer", "coverage"), help="one of the two tables")
    parser.add_argument("--folder", type=Path, help="keep each fit of the first table there, to go on from")
    parser.add_argument("--json", action="store_true", help="one JSON object instead of a table")
    arguments = parser.parse_args()
    logging.getLogger("absl").setLevel(logging.ERROR)
    pairs, seeds = (1, 10) if arguments.quick else (arguments.pairs, arguments.fits)
    if min(pairs, seeds) < 1:
        parser.error("--pairs and --fits are whole numbers >= 1")
    bench = Bench.make()
    report: dict = {}
    if arguments.only != "coverage":
        report |= {"sets": 2 * pairs, **compare(bench, pairs, arguments.folder)}
    if arguments.only != "peer":
        report |= {"coverage_fits": seeds, "coverage": coverage(bench, seeds)}
    if arguments.json:
        print(json.dumps(report))
        return
    if "sets" in report:
        print_comparison(report)
    if "coverage" in report:
        print_coverage(report)


def print_comparison(report: dict) -> None:
    """Both methods, a line each, and their ratios."""
    print(f"4 strikes fitted, 4 held out, {report['sets']} sets of recordings; in brackets without noise")
    for method in METHODS:
        r = report[method]
        print(
            f"  {method:13s} {r['wall_time']:7.2f} s   k, b, m off by {100 * r['parameter_error']:.2f} % "
            f"({100 * r['parameter_error_without_noise']:.2f})   held-out tip RMSE {1e3 * r['held_out_rmse']:.2f} mm "
            f"({1e3 * r['held_out_rmse_without_noise']:.2f})"
        )
    interval = report["held_out_over_mujoco_sysid_interval"]
    print(
        f"  {report['speed_over_mujoco_sysid']:.1f} times faster, error times {report['error_over_mujoco_sysid']:.2f}, "
        f"held-out error times {report['held_out_over_mujoco_sysid']:.2f}"
        + (f" [{interval[0]:.2f}, {interval[1]:.2f}]" if interval else "")
    )


def print_coverage(report: dict) -> None:
    """A line for each kind of errors."""
    print(f"95 % intervals that cover the truth, {report['coverage_fits']} fits each")
    for kind, shares in report["coverage"].items():
        print(f"  {kind:14s} " + "   ".join(f"{name} {share:.3f}" for name, share in shares.items()))


if __name__ == "__main__":
    main()
