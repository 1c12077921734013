"""How often does a throw land in a box, and what does an error of the release time do to it?

Random boxes with an opening 0.2 m wide, a ball of 20 g and 40 mm at the tip of the whip, default options. Each box is
searched twice: for a nominal release, and for a release whose time has a standard deviation of 5 ms. Of both plans
1,000 noisy releases are drawn; a released thing counts as in the box by `Goals.hit`. Two judges that share no formula
with the package look at the whole ball: flights by SciPy whose centre has to stay a radius from the rim, for all
releases, and a sphere in MuJoCo that must not touch a rim of capsules, for the planned release. `--replays` plans of
each robot are repeated in MuJoCo, where the ball is a body that an equality holds until the release.

    python benchmarks/throws.py [--quick] [--json] [--folder FOLDER] [--methods gradient directl sac] [--replays 10]

With --folder, what is found is kept there, and an interrupted run continues.
"""

from __future__ import annotations

import argparse
import json
import math
import tempfile
import time
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp

import whiptool as wt
from whiptool.comparison import Store
from whiptool.comparison.units import Unit
from whiptool.models.strike import T_STAY
from whiptool.throws.box import Box
from whiptool.throws.flight import Thing
from whiptool.throws.rollout import ThrowRollout

MODELS = ("lemon2024", "fr3")
WIDTH, THING = 0.2, Thing.of_ball(0.02, 0.04)  # [m] of the openings
NOISE, DRAWS, TRIALS = 5e-3, 1000, 600  # [s]
STAY = T_STAY + 0.05  # [s], for releases that are later than the end of the strike
GRAVITY = 9.81  # [m/s^2]
# boxes [m]: in the plane x and y about the shoulder; in space distance from the base, azimuth [rad] and height
LOW = {"lemon2024": (1.0, -1.2), "fr3": (0.8, -1.0, 0.0)}
HIGH = {"lemon2024": (3.0, 0.2), "fr3": (2.5, 1.0, 0.6)}


def boxes(name: str, count: int) -> list[Box]:
    """Return the first of the random boxes of a model."""
    low, high = np.array(LOW[name]), np.array(HIGH[name])
    places = low + np.random.default_rng(0).random((count, len(low))) * (high - low)
    if len(low) == 3:
        far, angle, height = places.T
        places = np.stack([far * np.cos(angle), far * np.sin(angle), height], axis=1)
    return [Box(tuple(map(float, x)), hit_radius=WIDTH / 2 - THING.radius) for x in places]


@cache
def simulator(name: str, noise: float) -> ThrowRollout:
    """Return the simulator of throws of a model, whose box is replaced."""
    return ThrowRollout(wt.preset(name), boxes(name, 1)[0], thing=THING, release_noise=noise)


def planned(name: str, box: Box, noise: float, method: str, seed: int) -> dict:
    """Return the plan of one box, and how many of its noisy releases land in it."""
    rollout = simulator(name, noise)
    rollout.box = box
    objective = wt.Objective(rollout, box, max_trials=TRIALS, stop_at_hit=True)
    begin = time.monotonic()
    found = wt.search(objective, method, seed=seed)
    row = {"hit": found.hit, "miss": found.miss_distance, "trials": found.n_trials, "seconds": time.monotonic() - begin}
    if found.strike is None:
        return row | {"noisy_hits": 0.0, "strike": None}
    at = float(rollout.release_times(found.strike)[0])
    times = np.maximum(at + NOISE * np.random.default_rng(seed).standard_normal(DRAWS), 0.0)
    landed = rollout.landings(found.strike, times, t_stay=STAY)
    hits = box.goals.hit(np.linalg.norm(landed.offset, axis=1), landed.velocity)
    row |= {"noisy_hits": float(hits.mean()), "strike": found.strike.vector.tolist(), "release_time": at}
    return row | judged(name, box, found.strike.vector, times, at)


def judged(name: str, box: Box, strike: np.ndarray, times: np.ndarray, at: float) -> dict:
    """Return what the two independent judges say of a plan, and the angle of its entry from the normal [degrees]."""
    from whiptool.throws.release import RATE, Release

    rollout = simulator(name, 0.0)
    rollout.box = box
    paths = rollout.rollout.release_path(strike, t_stay=STAY, rate=RATE)[0]
    landed = rollout.landings(strike, [at])
    along = Release(paths, None, GRAVITY, 0.0)  # type: ignore[arg-type]  # of the path alone
    times = np.r_[at, times]
    states = along.at(np.zeros(len(times), int), times)[0]
    until = min(float(landed.time[0]) + 0.4, 6.0)
    passes = whole_balls(states, box, until)
    speed = landed.velocity[0]
    return {
        "whole": bool(passes[0]),
        "noisy_whole": float(passes[1:].mean()),
        "contact": enters_in_mujoco(states[0], box, until),
        "angle": math.degrees(math.acos(-speed @ np.array(box.normal) / np.linalg.norm(speed))),
    }


def whole_balls(states: np.ndarray, box: Box, until: float) -> np.ndarray:
    """Return which balls pass through a box's opening and stay a radius from its rim, (R,).

    Flights are integrated by SciPy and looked at every half of a millisecond near the plane.

    Args:
        states: Positions and velocities at release, (R, 2 d).
        box: Box, which stands.
        until: Time for which flights are looked at [s].
    """
    d, drag = states.shape[1] // 2, THING.drag / THING.mass
    normal, radius = np.array(box.normal), box.hit_radius + THING.radius

    def rates(_: float, flat: np.ndarray) -> np.ndarray:
        velocity = flat.reshape(states.shape)[:, d:]
        falls = -drag * np.linalg.norm(velocity, axis=1, keepdims=True) * velocity
        falls[:, -1] -= GRAVITY
        return np.hstack([velocity, falls]).ravel()

    flown = solve_ivp(rates, (0, until), states.ravel(), method="DOP853", rtol=1e-9, atol=1e-9, dense_output=True)
    inside, nearest, before = np.zeros(len(states), bool), np.full(len(states), np.inf), None
    for t in np.array_split(np.arange(0, until, 5e-4), 80):
        ends = flown.sol(t[[0, -1]]).reshape(*states.shape, 2)[:, :d] - np.array(box.position)[:, None]
        if before is not None and np.abs(np.einsum("rdt,d->rt", ends, normal)).min() > 3 * radius:
            continue  # nothing is near the plane, before which the flights are to one side of it for long
        place = flown.sol(t).reshape(*states.shape, len(t))[:, :d] - np.array(box.position)[:, None]
        height = np.einsum("rdt,d->rt", place, normal)
        across = np.linalg.norm(place - height[:, None] * normal[:, None], axis=1)
        nearest = np.minimum(nearest, np.hypot(across - radius, height).min(axis=1))
        if before is not None:
            height, across = np.column_stack([before[0], height]), np.column_stack([before[1], across])
        falls = (height[:, :-1] > 0) & (height[:, 1:] <= 0)
        crossed = falls.any(axis=1)
        last = falls.shape[1] - 1 - falls[:, ::-1].argmax(axis=1)
        inside[crossed] = (across[np.arange(len(states)), last] < radius)[crossed]
        before = height[:, -1], across[:, -1]
    return inside & (nearest >= THING.radius)


def enters_in_mujoco(state: np.ndarray, box: Box, until: float) -> bool:
    """Whether a sphere falls through a ring of 180 capsules, in the plane between two, without a contact."""
    import mujoco

    d, wide = len(state) // 2, box.hit_radius + THING.radius
    normal = np.insert(box.normal, 1, 0.0) if d == 2 else np.array(box.normal)
    place, velocity = (np.insert(x, 1, 0.0) if d == 2 else x for x in (state[:d] - np.array(box.position), state[d:]))
    basis = np.linalg.svd(normal[None])[2][1:]
    if d == 2:
        rim = [(side * wide * np.array([normal[2], 0, -normal[0]]), np.array([0.0, 0.1, 0.0])) for side in (1, -1)]
        ends = [(x - by, x + by) for x, by in rim]
    else:
        turns = np.linspace(0, 2 * np.pi, 181)
        ring = wide * (np.cos(turns)[:, None] * basis[0] + np.sin(turns)[:, None] * basis[1])
        ends = list(pairwise(ring))
    spec = mujoco.MjSpec()
    spec.option.timestep, spec.option.gravity = 1e-4, [0, 0, -GRAVITY]
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_RK4
    for one, other in ends:
        spec.worldbody.add_geom(
            type=mujoco.mjtGeom.mjGEOM_CAPSULE, fromto=[*one, *other], size=[1e-5, 0, 0], contype=1, conaffinity=2
        )
    ball = spec.worldbody.add_body(name="ball", pos=place)
    ball.add_freejoint()
    ball.add_geom(
        type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[THING.radius, 0, 0], mass=THING.mass, contype=2, conaffinity=1
    )
    model = spec.compile()
    data = mujoco.MjData(model)
    data.qvel[:3] = velocity
    inside, before = False, float(place @ normal)
    while data.time < until:
        speed = data.qvel[:3]
        data.xfrc_applied[1, :3] = -THING.drag * np.linalg.norm(speed) * speed
        mujoco.mj_step(model, data)
        if data.ncon:
            return False
        height = float(data.qpos[:3] @ normal)
        if before > 0 >= height:
            inside = bool(np.linalg.norm(data.qpos[:3] - height * normal) < wide)
        before = height
    return inside


@dataclass(frozen=True, kw_only=True)
class ThrowUnit(Unit):
    """The plan of one box by one model and method."""

    model: str
    target: int
    method: str
    noise: float

    def run(self, folder: Path | None, threads: int | None) -> dict:
        """Search."""
        return planned(self.model, boxes(self.model, self.target + 1)[-1], self.noise, self.method, self.target)


@dataclass(frozen=True, kw_only=True)
class ReplayUnit(ThrowUnit):
    """A nominal plan of one box, repeated in MuJoCo."""

    def run(self, folder: Path | None, threads: int | None) -> dict:
        """Search and repeat."""
        from whiptool.throws.mujoco_throw import replay_throw

        found = super().run(folder, threads)
        if not found["hit"]:
            return {"difference": None}
        rollout = simulator(self.model, self.noise)
        return {"difference": replay_throw(rollout, np.array(found["strike"]), t_stay=0.7).difference}


def report_of(rows: list[dict]) -> dict:
    """Shares and medians over boxes."""
    return {
        "boxes": len(rows),
        "hits": sum(row["hit"] for row in rows),
        "median_trials": float(np.median([row["trials"] for row in rows])),
        "median_seconds": float(np.median([row["seconds"] for row in rows])),
        "median_noisy_hits": float(np.median([row["noisy_hits"] for row in rows])),
        "boxes_with_90_percent": sum(row["noisy_hits"] >= 0.9 for row in rows),
        "hits_of_the_whole_ball": sum(row["hit"] and row["whole"] for row in rows if "whole" in row),
        "hits_without_contact_in_mujoco": sum(row["hit"] and row["contact"] for row in rows if "whole" in row),
        "largest_error_of_the_share": max(
            (abs(row["noisy_hits"] - row["noisy_whole"]) for row in rows if row["hit"] and "whole" in row), default=None
        ),
        "flattest_entry": max((row["angle"] for row in rows if row["hit"] and "whole" in row), default=None),
    }


def main() -> None:
    """Search and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="2 boxes a model, without replays")
    parser.add_argument("--json", action="store_true", help="one JSON object instead of a table")
    parser.add_argument("--folder", type=Path, help="of what is found, to go on from")
    parser.add_argument("--boxes", type=int, default=100, help="boxes a model")
    parser.add_argument("--models", nargs="+", default=MODELS, help="models")
    parser.add_argument("--methods", nargs="+", default=["gradient"], help="methods of search")
    parser.add_argument("--replays", type=int, default=10, help="plans a model that are repeated in MuJoCo")
    arguments = parser.parse_args()
    count, replays = (2, 0) if arguments.quick else (arguments.boxes, arguments.replays)
    report: dict = {}
    with tempfile.TemporaryDirectory() as passing:
        folder = arguments.folder or Path(passing)
        folder.mkdir(parents=True, exist_ok=True)
        store = Store(folder)
        for name in arguments.models:
            for method in arguments.methods:
                for noise in (0.0, NOISE):
                    units = [ThrowUnit(model=name, target=i, method=method, noise=noise) for i in range(count)]
                    found = store.results(units, desc=f"{name} {method}")
                    kind = "robust" if noise else "nominal"
                    report[f"{name} {method} {kind}"] = report_of([found[unit.key] for unit in units])
            units = [ReplayUnit(model=name, target=i, method="gradient", noise=0.0) for i in range(replays)]
            apart = [row["difference"] for row in store.results(units, desc=f"{name} MuJoCo").values()]
            known = [x for x in apart if x is not None]
            if apart:
                largest = max(known, default=None)
                report[f"{name} mujoco"] = {"replays": len(apart), "landed": len(known), "largest_difference": largest}
    if arguments.json:
        print(json.dumps({"width": WIDTH, "noise": NOISE, "draws": DRAWS, "max_trials": TRIALS, **report}))
        return
    for name, r in report.items():
        if "replays" in r:
            print(f"{name}: {r['landed']} of {r['replays']} replays land", end="")
            print(f", landing points differ by at most {1e3 * r['largest_difference']:.2f} mm" if r["landed"] else "")
            continue
        print(
            f"{name}: {r['hits']} of {r['boxes']} boxes; trials median {r['median_trials']:g}, time median "
            f"{r['median_seconds']:.1f} s; of noisy releases {100 * r['median_noisy_hits']:.0f} % land (median), 90 % "
            f"or more in {r['boxes_with_90_percent']} boxes"
        )
        apart = r["largest_error_of_the_share"]
        if apart is not None:
            print(
                f"  the whole ball: {r['hits_of_the_whole_ball']} of {r['hits']} pass, "
                f"{r['hits_without_contact_in_mujoco']} without contact in MuJoCo; shares of noisy releases differ by "
                f"at most {100 * apart:.1f} points; entries at most {r['flattest_entry']:.0f} degrees from the normal"
            )


if __name__ == "__main__":
    main()
