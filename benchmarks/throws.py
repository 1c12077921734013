"""How often does a throw land in a box, and what does an error of the release time do to it?

Random boxes with an opening 0.2 m wide, a ball of 20 g and 40 mm at the tip of the whip, default options. Each box is
searched twice: for a nominal release, and for a release whose time has a standard deviation of 5 ms. Of both plans
1,000 noisy releases are drawn; a released thing counts as in the box by `Goals.hit`. `--replays` plans of each robot
are repeated in MuJoCo, where the ball is a body that an equality holds until the release.

    python benchmarks/throws.py [--quick] [--json] [--folder FOLDER] [--methods gradient directl sac] [--replays 10]

With --folder, what is found is kept there, and an interrupted run continues.
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

import whiptool as wt
from whiptool.comparison import Store
from whiptool.comparison.units import Unit
from whiptool.throws.box import Box
from whiptool.throws.flight import Thing
from whiptool.throws.rollout import ThrowRollout

MODELS = ("lemon2024", "fr3")
WIDTH, THING = 0.2, Thing.of_ball(0.02, 0.04)  # [m] of the openings
NOISE, DRAWS, TRIALS = 5e-3, 1000, 600  # [s]
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
    times = at + NOISE * np.random.default_rng(seed).standard_normal(DRAWS)
    landed = rollout.landings(found.strike, times)
    hits = box.goals.hit(np.linalg.norm(landed.offset, axis=1), landed.velocity)
    return row | {"noisy_hits": float(hits.mean()), "strike": found.strike.vector.tolist(), "release_time": at}


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


if __name__ == "__main__":
    main()
