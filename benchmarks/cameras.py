"""Which whip in space was it? Three strikes, seen by two cameras, and a fourth is predicted.

The person's arm of Nah et al. 2023 under its impedance strikes with a whip of 1 m that MuJoCo simulates, on universal
joints (k, b, m are sought) or of rods (EI, bending damping, mass per length). Two cameras see its tip 60 times a
second, each by its own clock, its rows one after the other; their frames do not fall together, and nothing is
triangulated. Errors are white, those of 5 mm at the tip. Counted is how often 95 % intervals hold the truth, over
`--sets` sets of noise; `held_out_rmse` [m] is that of the tip's path in the strike that was held out, against the
true path.

`--images`: the same whips through rendered images, whose tip is tracked; `tracking_error` [pixels] is that of the
tracks against what was really there.

    python benchmarks/cameras.py [--quick] [--sets 20] [--only universal|rod] [--images] [--json]
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import CubicSpline
from tqdm import tqdm

from whiptool.identification.fit import FitOptions, fit
from whiptool.identification.plant import Plant
from whiptool.identification.results import Fit
from whiptool.impedance import Controller, constant_preset
from whiptool.models import Model, WhipProfile, preset
from whiptool.models.strike import Strike, default_bounds
from whiptool.models.trajectory import Trajectory
from whiptool.recording.camera import Camera, looking_at
from whiptool.recording.strike_recording import StrikeRecording
from whiptool.rollout import CompiledRollout
from whiptool.rollout.reference import ReferenceRollout
from whiptool.vision.exposure import expose
from whiptool.vision.tracking import track_view

ARM, CONTROLLER = preset("nah2023"), Controller(constant_preset("nah2023"))
PROFILE = WhipProfile(length=1.0, linear_density=0.12, bending_stiffness=0.02, bending_damping=0.002)
NODES, STAY, STEP = 8, 0.3, 5e-4
NOISE = 5e-3  # [m] at the tip
OFF = 1.4  # by which the first guess of what is sought is wrong
FREE = {
    "universal": ("whip.k", "whip.b", "whip.m"),
    "rod": ("profile.bending_stiffness", "profile.bending_damping", "profile.linear_density"),
}
STRIKES = default_bounds(ARM.arm).sample(np.random.default_rng(1), 4)
LATE = {"left": 0.006, "right": -0.004}  # [s] of each camera's clock


def placed(name: str, position: tuple[float, float, float], start: float) -> tuple[Camera, float]:
    """A camera like a D435's infrared one, but with a rolling shutter, and when its first frame starts [s]."""
    K = np.array([[426.0, 0, 423.5], [0, 426.0, 239.5], [0, 0, 1]])
    turned = looking_at(position, (0.3, 0.0, -0.1))
    return Camera(name, 848, 480, K, turned, np.array(position), fps=60.0, exposure=4e-3, readout=12e-3), start


CAMERAS = (placed("left", (2.6, 3.0, 0.5), 0.002), placed("right", (1.4, -3.7, 0.1), 0.009))


@dataclass(frozen=True)
class Bench:
    """A whip, its strikes, and what is judged.

    Args:
        truth: As MuJoCo simulated it.
        paths: Paths of all strikes, the last held out.
    """

    truth: Plant
    free: tuple[str, ...]
    paths: list[Trajectory]

    @classmethod
    def make(cls, kind: str) -> Bench:
        """The whip of a kind: its strikes in MuJoCo."""
        whip = PROFILE.lump(NODES, joints="universal" if kind == "universal" else "rod")
        if kind == "universal":
            middle = {name: float(np.mean(whip.per_node(name)[1:])) for name in ("k", "b")}
            whip = replace(whip, **middle, l=1 / NODES, m=0.12 / NODES, rest_angle=0.0, drag=0.0, hinge_mass=0.0)
            whip = replace(whip, node_inertia=2e-6)
        model = replace(ARM, whip=whip)
        profile = PROFILE if kind == "rod" else None
        plant = Plant(model, CONTROLLER, profile)
        rollout = ReferenceRollout(plant.model, CONTROLLER, timestep=STEP / 2)  # within 1e-11 m of a finer one
        paths = [rollout.trajectory(Strike.from_vector(v), t_stay=STAY) for v in tqdm(STRIKES, desc=kind, leave=False)]
        return cls(plant, FREE[kind], paths)

    @property
    def true(self) -> dict[str, float]:
        """True values of what is free."""
        return {name: self.truth.values()[name] for name in self.free}

    def fit(self, films: Sequence[StrikeRecording]) -> Fit:
        """Fitted to the first strikes from a first guess that is off."""
        guess = self.truth.changed({name: OFF * x for name, x in self.true.items()})
        how = FitOptions(per_recording=("delay",), timestep=STEP)
        return fit(list(films), guess, self.free, options=how)

    def held_out(self, found: Fit) -> float:
        """RMS distance of the tip from its true path in the strike that was held out [m]."""
        strike, path = Strike.from_vector(STRIKES[-1]), self.paths[-1]
        foreseen = CompiledRollout(found.model, CONTROLLER, timestep=STEP / 2).trajectory(strike, t_stay=STAY)
        at = np.linspace(0, min(path.t[-1], foreseen.t[-1]), 500)
        missed = CubicSpline(foreseen.t, foreseen.tip)(at) - CubicSpline(path.t, path.tip)(at)
        return float(np.sqrt(np.mean(np.sum(missed**2, axis=1))))

    def judge(self, found: Fit) -> dict:
        """Values over the truth, intervals' widths, whether they hold the truth, and the held-out error."""
        numbers = {}
        for name, true in self.true.items():
            low, high = found[name].interval or (np.inf, -np.inf)
            numbers[name] = {
                "over_truth": found[name].value / true,
                "width": (high - low) / true,
                "covered": bool(low <= true <= high),
            }
        pixels = [r.pixels for r in found.recordings]
        return {"numbers": numbers, "held_out_rmse": self.held_out(found), "misfit": found.misfit, "pixels": pixels}


def seen(path: Trajectory, vector: np.ndarray, rng: np.random.Generator) -> list[StrikeRecording]:
    """A strike's tip as both cameras see it, with white errors."""
    films = []
    for camera, start in CAMERAS:
        starts = np.arange(start, path.t[-1] - camera.readout - camera.exposure, 1 / camera.fps)
        told = expose(camera, path.t, path.tip, starts)
        sigma = NOISE * np.array([camera.scale(place) for place in told.points])
        pixels = told.pixels + sigma[:, None] * rng.standard_normal(told.pixels.shape)
        inside = camera.sees(told.points)
        late = LATE[camera.name]
        films.append(
            StrikeRecording(
                t=starts + camera.exposure / 2 + late,
                points=np.where(inside[:, None], pixels, np.nan)[:, None],
                markers=("tip",),
                sigma=sigma[:, None],
                t_points=told.t_points[:, None] + late,
                view=camera,
                strike=Strike.from_vector(vector),
            )
        )
    return films


def filmed(model: Model, path: Trajectory, vector: np.ndarray, seed: int) -> tuple[list[StrikeRecording], list[float]]:
    """A strike's tip as it is tracked in both cameras' rendered images, and the tracks' errors [pixels]."""
    from whiptool.vision.render import VirtualCamera

    films, errors = [], []
    for camera, start in CAMERAS:
        rng = np.random.default_rng([seed, len(films)])
        virtual = VirtualCamera(camera, model, path, rng, start=start - 0.05)
        film = track_view(virtual, distance=4.0, strike=Strike.from_vector(vector))
        truth = np.array([x.pixel for x in virtual.truths])
        errors += np.abs(film.points[:, 0] - truth)[film.seen[:, 0]].ravel().tolist()
        late = LATE[camera.name]
        films.append(replace(film, t=film.t + late, t_points=film.t_points + late))
    return films, errors


def by_noise(bench: Bench, sets: int) -> dict:
    """What is found of tips with white errors: shares of sets whose intervals hold the truth."""
    found = []
    for seed in tqdm(range(sets), leave=False):
        rng = np.random.default_rng(seed)
        films = [f for path, v in zip(bench.paths[:3], STRIKES[:3], strict=True) for f in seen(path, v, rng)]
        found.append(bench.judge(bench.fit(films)))
    shares = {name: float(np.mean([one["numbers"][name]["covered"] for one in found])) for name in bench.free}
    widths = {name: float(np.median([one["numbers"][name]["width"] for one in found])) for name in bench.free}
    held_out = float(np.sqrt(np.mean([one["held_out_rmse"] ** 2 for one in found])))
    return {"sets": sets, "covered": shares, "width": widths, "held_out_rmse": held_out}


def by_images(bench: Bench) -> dict:
    """What is found of tips that were tracked in rendered images."""
    films, errors = [], []
    for i, (path, v) in enumerate(zip(bench.paths[:3], STRIKES[:3], strict=True)):
        pair, missed = filmed(bench.truth.model, path, v, i)
        films, errors = films + pair, errors + missed
    told = {"tracking_error": float(np.sqrt(np.mean(np.square(errors)))), "tracking_largest": float(np.max(errors))}
    return told | bench.judge(bench.fit(films))


def main() -> None:
    """Fit and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="one set of noise, universal joints only")
    parser.add_argument("--sets", type=int, default=20, help="of noise (default: 20)")
    parser.add_argument("--only", choices=tuple(FREE), help="one kind of whip")
    parser.add_argument("--images", action="store_true", help="through rendered images instead of white errors")
    parser.add_argument("--json", action="store_true", help="one JSON object instead of a table")
    arguments = parser.parse_args()
    sets = 1 if arguments.quick else arguments.sets
    if sets < 1:
        parser.error("--sets is a whole number >= 1")
    kinds = [arguments.only] if arguments.only else ["universal"] if arguments.quick else list(FREE)
    benches = {kind: Bench.make(kind) for kind in kinds}
    report = {kind: by_images(b) if arguments.images else by_noise(b, sets) for kind, b in benches.items()}
    if arguments.json:
        print(json.dumps(report))
        return
    for kind, of in report.items():
        if arguments.images:
            print(f"{kind}: tracked to {of['tracking_error']:.3f} pixels (at most {of['tracking_largest']:.2f})")
            for name, x in of["numbers"].items():
                said = "within" if x["covered"] else "NOT within"
                print(f"  {name:28s} {x['over_truth']:.4f} of the truth, {said} its interval of {x['width']:.2%}")
        else:
            print(f"{kind}: 95 % intervals that hold the truth, {of['sets']} sets")
            for name in of["covered"]:
                print(f"  {name:28s} {of['covered'][name]:.2f}   width {of['width'][name]:.2%} of the truth")
        print(f"  held out: the tip {1e3 * of['held_out_rmse']:.2f} mm RMS from where it was")


if __name__ == "__main__":
    main()
