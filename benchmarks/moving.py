"""Does a strike meet a moving target? A known whip, targets that are seen by a camera, three kinds of motion.

The whip is lemon2024 under OIAC (`table4`). A camera (60 frames a second, 5 mm noise in each coordinate) watches a
target for 0.5 s, then the strike is planned: what it is and when it starts. It starts no sooner than 20 ms of latency
and the time for computing (250 ms for a plan, 100 ms for a refreshed one) after the frame that it is computed from, and
the tip must meet the target within 2.5 s of the decision. The strike is rolled out on the true model at half the
planner's timestep, against the target's true motion, and counts as a hit if tip and target come within the hit radius.

Targets: `straight`, 0.5 m/s in a random direction through a random point of the disc of 0.3 m around (1.2, 0.0) m;
`ballistic`, thrown from 2.5 to 4 m away, through such a point after 1.1 to 1.6 s of flight; `pendulum`, a bob whose
lowest point is such a point, strings of 0.5 to 1.5 m, amplitudes of 0.2 to 1 rad, pivot unknown to the planner.
Targets that cannot be met in time are excluded: those that none of 4,000 other random strikes, from any
posture and started at the best time, comes within 6 cm of. Their number is printed.

Rows: `last seen`: the strike at where the target was last seen; `once`: planned at the decision; `time`: later frames
shift the start of the same strike; `aim`: later frames move the strike, too; `oracle`: the true motion is known.
`any q_i`: the arm is wherever the strike begins; `waiting`: it waits at one posture, and all strikes begin there.

With `--model` plans of one model are confirmed in MuJoCo instead, for lemon2024 or a robot within its default limits.
Half of the targets move straight on at 0.5 m/s, half are thrown; each passes, 0.8 to 1.6 s after the decision, a point
at which the tip of another strike that keeps the limits is faster than 2 m/s, and was above the floor until then. A
plan is made as in `once, any q_i`, and counts as kept if `Striker.keep` says so, and as a hit if it is kept, the tip in
MuJoCo comes within 6 cm of the target's true position, and neither the target then nor the whip ever is below the
floor. A run that is stopped continues with the same `--tracks`.

    python benchmarks/moving.py [--quick] [--json] [--targets 100] [--seeds 0]
    python benchmarks/moving.py --model ur5e [--quick] [--json] [--targets 100] [--seeds 0] [--size 100] [--tracks FILE]
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from scipy.stats import binomtest
from tqdm import tqdm

from whiptool.goals.zone import Disc, sample
from whiptool.impedance import Controller
from whiptool.interception.interceptor import HORIZON, LATENCY, PLAN_TIME, Interception, Interceptor, TargetCamera
from whiptool.interception.library import Library
from whiptool.interception.target_tracks import (
    GRAVITY,
    PendulumMotion,
    TargetMotion,
    TargetTrack,
    find_motion,
    fit_track,
)
from whiptool.models import preset
from whiptool.models.kinematics import joint_points
from whiptool.models.trajectory import closest_on_segments
from whiptool.rollout import CompiledRollout, ReferenceRollout
from whiptool.strike_map.striker import Striker

MODEL, CONTROLLER = preset("lemon2024"), Controller()
ZONE = Disc((1.2, 0.0), 0.3)
CAMERA = TargetCamera(60.0, 0.005)
SEEN = 0.5  # [s] of track before the decision
RADII = (0.06, 0.03, 0.01)  # [m]
WAITING = (-1.4, 0.1)  # [rad], of 30 postures the one from which most thrown balls could be met
OTHERS, OTHER_SEED = 4000, 99  # strikes that say what can be met
PLACES, SPEED = 30, 2.0  # points of other strikes' tips that targets pass, and the tip's least speed there [m/s]
PLANNER, TRUTH = 5e-4, 2.5e-4  # [s], timesteps
UPDATES = {"none": "once", "time": "time", "aim": "aim"}


@dataclass(frozen=True)
class MovingTarget:
    """The truth, with the decision at time 0."""

    motion: TargetMotion
    numbers: np.ndarray

    def positions(self, t: np.ndarray) -> np.ndarray:
        """[m], (T, 2)"""
        return self.motion.positions(self.numbers, t)

    def frames(self, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """Times and noisy positions of all frames."""
        t = np.arange(-round(SEEN * CAMERA.rate), round(HORIZON * CAMERA.rate)) / CAMERA.rate
        points = self.positions(t)
        return t, points + CAMERA.sigma * rng.standard_normal(points.shape)

    def reachable(self, others: Library) -> bool:
        """Whether one of the strikes, if it starts at the right time, comes within the largest hit radius."""
        t = np.arange(PLAN_TIME + LATENCY, HORIZON, 0.01)
        near = others.tree.query_ball_point(self.positions(t), RADII[0])
        return any(bool((others.tau[x] <= now - PLAN_TIME - LATENCY).any()) for now, x in zip(t, near, strict=True))


def straight(rng: np.random.Generator) -> MovingTarget:
    """0.5 m/s through the zone, 0.5 to 1.5 s after the decision."""
    angle, passes = rng.uniform(0, 2 * np.pi), rng.uniform(0.5, 1.5)
    velocity = 0.5 * np.array([np.cos(angle), np.sin(angle)])
    return MovingTarget(find_motion("straight"), np.r_[sample(ZONE, 1, rng)[0] - passes * velocity, velocity])


def ballistic(rng: np.random.Generator) -> MovingTarget:
    """Released 50 ms before the camera sees it."""
    released, flight = -SEEN - 0.05, rng.uniform(1.1, 1.6)
    hand = np.array([rng.uniform(2.5, 4.0), rng.uniform(-0.5, 0.3)])
    g = np.array([0.0, -GRAVITY])
    velocity = (sample(ZONE, 1, rng)[0] - hand) / flight - g * flight / 2
    at = hand - velocity * released + g * released**2 / 2  # at time 0
    return MovingTarget(find_motion("ballistic"), np.r_[at, velocity - g * released])


def pendulum(rng: np.random.Generator) -> MovingTarget:
    """A random instant of a swing."""
    L, amplitude, lowest = rng.uniform(0.5, 1.5), rng.uniform(0.2, 1.0), sample(ZONE, 1, rng)[0]
    theta = amplitude * np.sin(rng.uniform(-np.pi / 2, np.pi / 2))
    energy = np.sin(amplitude / 2) ** 2 - np.sin(theta / 2) ** 2
    rate = rng.choice([-1, 1]) * 2 * np.sqrt(GRAVITY / L * max(energy, 0.0))
    return MovingTarget(PendulumMotion(), np.r_[lowest + np.array([0, L]), np.log(L), theta, rate])


KINDS: dict[str, Callable[[np.random.Generator], MovingTarget]] = {
    "straight": straight, "ballistic": ballistic, "pendulum": pendulum
}  # fmt: skip


def draw(kind: str, count: int, others: Library, rng: np.random.Generator) -> tuple[list[MovingTarget], int]:
    """Reachable targets, and how many others were drawn on the way."""
    targets, excluded = [], 0
    while len(targets) < count:
        target = KINDS[kind](rng)
        if target.reachable(others):
            targets.append(target)
        else:
            excluded += 1
    return targets, excluded


@dataclass(frozen=True)
class Sent:
    """The strike as it is sent, and the times that computing took: the first plan, and each refresh [s]."""

    strike: Interception | None
    plan_time: float
    refresh_times: tuple[float, ...] = ()


def follow(library: Library, update: str, target: MovingTarget, seed: int) -> Sent:
    """Planned at the decision; what later frames change is `update`."""
    t, points = target.frames(np.random.default_rng([seed, 1]))
    rng, plans, times, began = np.random.default_rng([seed, 2]), [], [], time.perf_counter()
    following = Interceptor(library, camera=CAMERA).follow(
        zip(t, points, strict=True), decide=0.0, rng=rng, update=update
    )
    for chosen in following:
        plans.append(chosen)
        times.append(time.perf_counter() - began)
        began = time.perf_counter()
    return Sent(plans[-1], times[0], tuple(times[1:]) if plans[0] else ())


def last_seen(library: Library, target: MovingTarget, seed: int) -> Sent:
    """The strike at the last frame before the decision, which does not know that the target moves."""
    t, points = target.frames(np.random.default_rng([seed, 1]))
    frame = int(np.searchsorted(t, 0.0, side="right")) - 1
    still = fit_track(t[frame : frame + 1], points[frame : frame + 1], sigma=CAMERA.sigma, motion="still")
    return planned(still, library, seed)


def oracle(library: Library, target: MovingTarget, seed: int) -> Sent:
    """The strike with the true motion."""
    return planned(TargetTrack.known(target.motion, target.numbers), library, seed)


def planned(track: TargetTrack, library: Library, seed: int) -> Sent:
    """A plan with a given track."""
    chosen = Interceptor(library).plan(track, now=0.0, rng=np.random.default_rng([seed, 2]))
    return Sent(chosen, chosen.wall_time if chosen else 0.0)


def misses(truth: CompiledRollout, targets: list[MovingTarget], strikes: list[Interception | None]) -> np.ndarray:
    """What came of it, (B,) [m]; infinite where there was no plan."""
    out = np.full(len(targets), np.inf)
    planned = [i for i, x in enumerate(strikes) if x is not None]
    if planned:
        vectors = np.array([x.strike.vector for x in strikes if x is not None])
        t, paths, _ = truth.tip_path(vectors, t_stay=0.3, rate=1 / TRUTH)
        for i, path in zip(planned, paths, strict=True):
            chosen = strikes[i]
            assert chosen is not None
            out[i] = closest_on_segments(path - targets[i].positions(chosen.start + t), np.zeros(2)).distance
    return out


@dataclass(frozen=True)
class Robot:
    """A model whose plans are confirmed in MuJoCo.

    Args:
        library: Strikes of the model.
        references: Its simulators in MuJoCo, with ever finer steps; the first that does not diverge is taken.
        places: Points that tips of other strikes within the limits pass, (P, d) [m].
        floor: Height of the floor [m], or minus infinity.
    """

    library: Library
    references: tuple[ReferenceRollout, ...]
    places: np.ndarray
    floor: float

    @classmethod
    def named(cls, name: str, size: int) -> Robot:
        """A preset with its default limits."""
        model = preset(name)
        striker, places, rng = Striker(CompiledRollout(model)), [], np.random.default_rng(OTHER_SEED)
        while len(places) < PLACES:
            drawn = striker.limits.random_strikes(striker.bounds, rng, 256)
            possible, paths = striker.paths(drawn, rate=100.0)
            for i in np.flatnonzero(possible):
                if len(places) < PLACES and striker.keep(drawn[i : i + 1])[0]:
                    fast = np.linalg.norm(np.gradient(paths[i], 0.01, axis=0), axis=1) > SPEED
                    places += [paths[i, rng.choice(np.flatnonzero(fast))]] if fast.any() else []
        floors = [limits.floor for limits in striker.limits.members if getattr(limits, "floor", None) is not None]
        library = Library.build(striker, size=size)
        finer = (ReferenceRollout(model, timestep=h, integrator="RK4") for h in (5e-5, 2.5e-5))
        references = (ReferenceRollout(model), *finer)
        return cls(library, references, np.array(places), max(floors, default=-np.inf))

    def target(self, rng: np.random.Generator, number: int) -> MovingTarget:
        """A target that is above the floor until it passes one of the places; every other one is thrown."""
        d = self.places.shape[1]
        while True:
            place, passes = self.places[rng.integers(len(self.places))], rng.uniform(0.8, 1.6)
            if number % 2:
                released = -SEEN - 0.05
                aside = rng.uniform(-0.5, 0.5, d - 2)
                hand = np.r_[rng.uniform(2.5, 4.0), aside, rng.uniform(0.5, 1.3) + max(self.floor, -1.0)]
                g, flight = np.r_[np.zeros(d - 1), -GRAVITY], passes - released
                velocity = (place - hand) / flight - g * flight / 2
                at = hand - velocity * released + g * released**2 / 2
                motion, numbers = find_motion("ballistic", dimension=d), np.r_[at, velocity - g * released]
            else:
                way = rng.standard_normal(d)
                velocity = 0.5 * way / np.linalg.norm(way)
                motion, numbers = find_motion("straight", dimension=d), np.r_[place - passes * velocity, velocity]
            target = MovingTarget(motion, numbers)
            if (target.positions(np.linspace(-SEEN, passes, 100))[:, -1] > self.floor).all():
                return target

    def confirmed(self, target: MovingTarget, seed: int) -> dict:
        """What came of the plan for a target; lengths in metres."""
        sent, striker = follow(self.library, "none", target, seed), self.library.striker
        chosen = sent.strike
        if chosen is None:
            return {"planned": False}
        kept = bool(striker.keep(chosen.strike.vector[None])[0])
        simulators = self.references if kept else [striker.rollout]  # what is not kept cannot be a hit
        paths = (x.trajectory(chosen.strike, t_stay=striker.t_stay) for x in simulators)
        path = next(path for path in paths if not path.diverged)
        model = striker.rollout.model
        whip = joint_points(model, path.q[::5])[:, model.arm.n :]
        there = target.positions(chosen.start + path.t)
        there[there[:, -1] < self.floor] = np.nan
        tip = [np.interp(chosen.contact - chosen.start, path.t, x) for x in path.tip.T]
        return {
            "planned": True,
            "probability": chosen.probability,
            "kept": kept,
            "miss": float(closest_on_segments(path.tip - there, np.zeros(len(tip))).distance),
            "off": float(np.linalg.norm(np.array(tip) - chosen.point)),  # of the planned contact
            "height": float(whip[..., -1].min()) - self.floor,
            "underground": bool(chosen.point[-1] < self.floor),
            "plan_time": sent.plan_time,
        }


def confirm(name: str, count: int, seeds: Sequence[int], size: int, tracks: Path | None) -> dict:
    """Plans for targets of one model, confirmed in MuJoCo; a file may keep the results of single tracks."""
    began = time.perf_counter()
    robot = Robot.named(name, size)
    building = time.perf_counter() - began
    found = [json.loads(line) for line in tracks.read_text().splitlines()] if tracks and tracks.exists() else []
    known = len(found)
    for i, (seed, number) in enumerate(
        tqdm([(s, i) for s in seeds for i in range(count)], leave=False, unit=" tracks")
    ):
        if i >= known:
            target = robot.target(np.random.default_rng([seed, 7, number]), number)
            found.append(robot.confirmed(target, 1000 * seed + number))
            if tracks is not None:
                with tracks.open("a") as file:
                    file.write(json.dumps(found[-1]) + "\n")
    plans = [x for x in found if x["planned"]]
    above = [x["height"] >= 0 for x in plans]
    met = [x["miss"] <= RADII[0] for x in plans]
    return {
        "model": name,
        "strikes": len(robot.library.strikes),
        "library_seconds": building,
        "points_below_floor": float((robot.library.points[:, -1] < robot.floor).mean()),
        "tracks": len(found),
        "plans": len(plans),
        "kept": sum(x["kept"] for x in plans),
        "whip_above_floor": sum(above),
        "lowest": min((x["height"] for x in plans if np.isfinite(x["height"])), default=None),
        "contact_below_floor": sum(x["underground"] for x in plans),
        "contact_as_planned": sum(x["off"] <= RADII[0] for x in plans),
        "largest_off": max((x["off"] for x in plans), default=None),
        "met": sum(met),
        "hits": sum(a and m and x["kept"] for a, m, x in zip(above, met, plans, strict=True)),
        "believed": float(np.mean([x["probability"] for x in plans])) if plans else None,
        "plan_seconds": float(np.median([x["plan_time"] for x in plans])) if plans else None,
    }


def row(miss: np.ndarray, sent: list[Sent]) -> dict:
    """One line of the table; None where nothing was planned."""
    taken = [x.strike for x in sent if x.strike is not None]
    plan_times = [x.plan_time for x in sent if x.strike is not None]
    refreshes = [t for x in sent for t in x.refresh_times]
    hits = {}
    for radius in RADII:
        test = binomtest(int((miss <= radius).sum()), len(miss))
        interval = test.proportion_ci(method="wilson")
        hits[str(radius)] = {"share": float(test.statistic), "low": float(interval.low), "high": float(interval.high)}

    def quantile(values: Sequence[float] | np.ndarray, q: float) -> float | None:
        value = float(np.quantile(values, q, method="higher")) if len(values) else np.inf
        return value if np.isfinite(value) else None

    return {
        "hits": hits,
        "median_miss": quantile(miss, 0.5),
        "p90_miss": quantile(miss, 0.9),
        "no_plan": len(sent) - len(taken),
        "believed": float(np.mean([x.probability for x in taken])) if taken else None,
        "tip_speed": quantile([x.tip_speed for x in taken], 0.5),
        "start": quantile([x.start for x in taken], 0.5),
        "contact": quantile([x.contact for x in taken], 0.5),
        "plan_time": {
            "median": quantile(plan_times, 0.5),
            "p90": quantile(plan_times, 0.9),
        },
        "refresh_time": {"median": quantile(refreshes, 0.5), "p90": quantile(refreshes, 0.9)},
    }


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="20 targets of each kind")
    parser.add_argument("--json", action="store_true", help="one JSON object instead of a table")
    parser.add_argument("--targets", type=int, default=100, help="of each kind and seed (default: 100)")
    parser.add_argument("--seeds", type=int, nargs="+", default=[0], help="of targets and noise (default: 0)")
    parser.add_argument("--model", help="confirm the plans of this preset in MuJoCo instead")
    parser.add_argument("--size", type=int, default=100, help="strikes of its library (default: 100)")
    parser.add_argument("--tracks", type=Path, help="file of the results of single tracks, which are not repeated")
    arguments = parser.parse_args()
    count = 20 if arguments.quick else arguments.targets
    if arguments.model:
        found = confirm(
            arguments.model, count, arguments.seeds, 60 if arguments.quick else arguments.size, arguments.tracks
        )
        print(json.dumps(found) if arguments.json else "\n".join(f"{name:20s} {x}" for name, x in found.items()))
        return
    rollout = CompiledRollout(MODEL, CONTROLLER, timestep=PLANNER)
    truth, striker = CompiledRollout(MODEL, CONTROLLER, timestep=TRUTH), Striker(rollout)
    began = time.perf_counter()
    libraries = {"any q_i": Library.build(striker), "waiting": Library.build(striker, q_i=WAITING)}
    building = (time.perf_counter() - began) / len(libraries)
    others = Library.build(striker, size=OTHERS, seed=OTHER_SEED)
    ways: dict[str, Callable[[MovingTarget, int], Sent]] = {}
    for name, library in libraries.items():
        updates = UPDATES if name == "waiting" else {"none": UPDATES["none"]}
        ways[f"last seen, {name}"] = partial(last_seen, library)
        for update, word in updates.items():
            ways[f"{word}, {name}"] = partial(follow, library, update)
        ways[f"oracle, {name}"] = partial(oracle, library)
    report = {}
    with tqdm(total=len(KINDS) * len(ways) * count * len(arguments.seeds), leave=False, unit=" strikes") as bar:
        for number, kind in enumerate(KINDS):
            targets, excluded, seeds = [], 0, []
            for seed in arguments.seeds:
                drawn, unreached = draw(kind, count, others, np.random.default_rng([seed, number]))
                targets, excluded = targets + drawn, excluded + unreached
                seeds += [1000 * seed + i for i in range(count)]
            rows = {}
            for name, way in ways.items():
                sent = []
                for target, seed in zip(targets, seeds, strict=True):
                    sent.append(way(target, seed))
                    bar.update()
                rows[name] = row(misses(truth, targets, [x.strike for x in sent]), sent)
            report[kind] = {"targets": len(targets), "excluded": excluded, "rows": rows}
    headline = {kind: report[kind]["rows"]["aim, waiting"]["hits"]["0.06"]["share"] for kind in report}
    if arguments.json:
        print(json.dumps({"hits_at_0.06": headline, "library_seconds": building, "kinds": report}))
        return
    print(f"a library of {len(libraries['any q_i'].strikes)} strikes is rolled out in {building:.1f} s")
    for kind, entry in report.items():
        print(f"{kind}: {entry['targets']} targets; {entry['excluded']} that nothing could meet were not asked about")
        for name, e in entry["rows"].items():
            print("\n".join(lines(name, e)))


def lines(name: str, entry: dict) -> list[str]:
    """A row of the table, at most 120 columns wide; what there is no number for is left out."""
    hits = "  ".join(
        f"{100 * float(r):.0f} cm {h['share']:4.0%} [{h['low']:.0%}, {h['high']:.0%}]" for r, h in entry["hits"].items()
    )
    plan_time, refresh_time = entry["plan_time"], entry["refresh_time"]
    behaviour = [
        ("miss", entry["median_miss"], 1e3, "mm", entry["p90_miss"]),
        ("believed", entry["believed"], 100, "%", None),
        ("tip", entry["tip_speed"], 1, "m/s", None),
        ("starts", entry["start"], 1, "s", None),
        ("meets", entry["contact"], 1, "s", None),
    ]
    computing = [
        ("plan", plan_time["median"], 1e3, "ms", plan_time["p90"]),
        ("refresh", refresh_time["median"], 1e3, "ms", refresh_time["p90"]),
    ]
    told = [
        ", ".join(
            f"{word} {scale * value:.3g}" + (f" (90 %: {scale * p90:.3g})" if p90 is not None else "") + f" {unit}"
            for word, value, scale, unit, p90 in parts
            if value is not None
        )
        for parts in (behaviour, computing)
    ]
    return [f"  {name:20s} {hits}  no plan: {entry['no_plan']}", *(f"{'':6s}{x}" for x in told if x)]


if __name__ == "__main__":
    main()
