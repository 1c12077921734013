"""How much is won by feedback within a strike, by its delay and its start? The plane (`lemon2024`) and a UR5e.

Each of ten planned strikes is disturbed 20 times by one kind of disturbance: a whip that still swings, a kick, noise of
the hand that grows with its torque, 5 % of length, mass or stiffness. The estimate expects all of them. A robot's
strikes hit while its arm moves. Miss of the tip: `without` correction; with `gains`: what corrections do is known
before the strike, and the engine says where the disturbed strike passes; with a `search` that simulates what they do,
too, from the same estimates. Medians, 90th percentiles, and the share of strikes that corrections make worse by more
than 5 % and 5 mm, of the three planned strikes by which the rules of correction were chosen and of the others apart.
`robust`: of several strikes that hit, the one whose miss the swings change least. `capsules` and `rods`: the truth is a
chain of capsules in MuJoCo with another controller, or a Cosserat rod in PyElastica (`peers/correction_twins.py`),
four times each, of strikes that were rehearsed once.

    python benchmarks/correction.py [--arms ARM ...] [--parts PART ...] [--quick] [--json] [--folder FOLDER]

With --folder each case is kept there, and the same command goes on.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

import whiptool as wt
from whiptool.correction import AnyStart, Begun, Corrector, Disturbances, LinearStrike, Paths, Sensing, Submovements
from whiptool.correction.corrector import Policy
from whiptool.correction.disturbances import (
    PULSES,
    kick_directions,
    loads,
    moved,
    pulses,
    swing_directions,
)
from whiptool.correction.linear import Estimate
from whiptool.correction.rolled import INTERVAL, NUMBERS
from whiptool.whole_files import write_whole

EACH, CANDIDATES = 20, 6
DELAYS, STARTS = (0.0, 0.03, 0.06, 0.1), (0.2, 0.4, 0.6, 0.8)
KINDS = tuple(field.name for field in fields(Disturbances))
TWINS, TWIN_STRIKES = ("capsules", "rods"), 5
PARTS = ("swing", "kinds", "search", "robust", *TWINS)
REGIONS = {"lemon2024": ((0.9, -0.3), (1.35, 0.5)), "ur5e": ((1.0, -0.4, 0.2), (1.5, 0.4, 0.9))}
EXPECTED = {"lemon2024": Disturbances(), "ur5e": Disturbances(swing=0.03, kick=0.15, hand=0.001)}
WORSE = 0.005  # [m]
CHOSEN = 3  # planned strikes by which the rules of correction were chosen; they are not mixed with the others
# the planned strikes 3 to 9, and 10 to 13 of the UR5e, showed what was wrong with rules before these
STRIKES = {"lemon2024": (*range(CHOSEN), *range(10, 17)), "ur5e": tuple(range(14, 24))}
STEPS, SIDE = 4, 1e-3  # of each search, and of its differences [rad]
EARLIEST = 0.3  # [s] of a robot's hit, which has to be while its arm moves
FINE = {"lemon2024": 2, "ur5e": 1}  # steps of the simulation in a millisecond

Truth = Callable[[Submovements], Paths]


@dataclass(frozen=True)
class Disturbed:
    """The true course of disturbed strikes by the model's own chain; a kick changes the velocities at `kick_at` [s]."""

    linear: LinearStrike
    x0: np.ndarray
    noise: Submovements
    off: np.ndarray
    kick_at: np.ndarray
    kick: np.ndarray

    def __call__(self, added: Submovements) -> Paths:
        simulator, target = self.linear.simulator, self.linear.target
        begun = Begun(self.linear.strike, self.x0, self.noise.and_(added), self.linear.lasts, off=self.off)
        first = simulator.paths(begun, target)
        if not self.kick.any():
            return first
        before = np.round(self.kick_at / INTERVAL).astype(int)
        at = simulator.rows(begun, "x")[np.arange(len(before)), before]
        change = np.einsum("bdn,bd->bn", kick_directions(simulator.model, at), self.kick)
        kicked = replace(begun, x0=moved(simulator.model, at, change), since=before * INTERVAL)
        then = simulator.paths(kicked, target)
        index, rows = np.arange(first.tip.shape[1]) - before[:, None], np.arange(len(before))[:, None]
        pairs = (first.tip, then.tip), (first.arm, then.arm)
        tip, arm = (
            np.where((index < 0)[(...,) + (None,) * (x.ndim - 2)], x, y[rows, np.maximum(index, 0)]) for x, y in pairs
        )
        until = np.where(index < 0, np.linalg.norm(first.tip - target, axis=2), np.inf).min(axis=1)
        return Paths(tip, arm, np.minimum(until, then.miss))


def drawn(linear: LinearStrike, by: Disturbances, count: int, rng: np.random.Generator) -> Truth:
    """Disturbed strikes of a planned one."""
    simulator, model = linear.simulator, linear.simulator.model
    swings = swing_directions(model, linear.strike)
    x0 = moved(
        model, np.repeat(linear.states[:1], count, axis=0), by.swing * rng.normal(size=(count, len(swings))) @ swings
    )
    sizes = by.hand * loads(simulator, linear.strike, linear.hit_at) * rng.normal(size=(count, PULSES, model.arm.n))
    off = rng.normal(size=(count, len(NUMBERS))) * [getattr(by, name) for name in NUMBERS]
    kick_at = linear.hit_at * rng.uniform(0.1, 0.9, count)
    return Disturbed(
        linear, x0, pulses(sizes, linear.hit_at), off, kick_at, by.kick * rng.normal(size=(count, model.dimension))
    )


def searching(corrector: Corrector) -> Policy:
    """Simulate each strike as it is estimated, with what corrections do to it, and improve them until it hits."""
    linear, window = corrector.linear, corrector.window

    def policy(k: int, estimate: Estimate, sizes: np.ndarray) -> np.ndarray:
        B, _, a = sizes.shape
        J = len(corrector.decisions) - k
        by, sides = np.zeros((B, J, a)), np.concatenate([np.zeros((1, J * a)), SIDE * np.eye(J * a)])
        for _ in range(STEPS):
            every = (by + sides.reshape(-1, 1, J, a)).reshape(-1, J, a)
            z, before = (np.concatenate([x] * len(sides)) for x in (estimate.z, sizes))
            added = corrector.added(np.concatenate([before, every], axis=1))
            tips = linear.paths(z, added, (window.stop - 1) * INTERVAL).tip[:, window]
            tips = np.nan_to_num(tips)  # what diverges is not improved
            tips = tips.reshape(len(sides), B, *tips.shape[1:])
            effects = np.moveaxis((tips[1:] - tips[0]) / SIDE, 0, -1)
            by = corrector.solved(k, tips[0], effects.reshape(*tips[0].shape, J, a), by, estimate)
        return corrector.tried(k, by, estimate, sizes)

    return policy


@lru_cache
def hits(arm: str, number: int) -> tuple[np.ndarray, list[wt.Strike]]:
    """A random target, and strikes that hit it within the arm's limits, of several searches."""
    model, planar = wt.preset(arm), arm == "lemon2024"
    rng, stay = np.random.default_rng([len(arm), number]), {} if planar else {"t_stay": 0.0}
    rollout, found = wt.CompiledRollout(model), []
    while not found:
        target = rng.uniform(*REGIONS[arm])
        for seed in range(CANDIDATES):
            objective = wt.Objective(rollout, wt.Target(tuple(target)), max_trials=400, limits="default", **stay)
            result = wt.search(objective, "gradient", seed=seed)
            hit = result.outcome is not None and result.outcome.hit and result.outcome.miss_distance < 1e-3
            if hit and (planar or EARLIEST < result.outcome.time < result.strike.D):
                found.append(result.strike)
            if found and not planar:
                break
    return target, found


@lru_cache(maxsize=1)
def linear_of(arm: str, number: int, robust: bool = False) -> LinearStrike:
    """A planned strike, linearised; `robust`: that whose miss the swings change least."""
    target, strikes = hits(arm, number)
    simulator = AnyStart(wt.preset(arm), steps=FINE[arm])
    if not robust:
        return LinearStrike(simulator, strikes[0], target, EXPECTED[arm])
    return min((LinearStrike(simulator, strike, target, EXPECTED[arm]) for strike in strikes), key=_sensitivity)


def _sensitivity(linear: LinearStrike) -> float:
    """Root mean square of the linear miss across the tip's velocity by swings [m]."""
    hit = round(linear.hit_at / INTERVAL)
    swings = len(swing_directions(linear.simulator.model, linear.strike))
    return float(np.linalg.norm(linear.across @ linear.tip[hit][:, :swings]))


def misses(corrector: Corrector, truth: Truth, count: int, seed: int, searched: bool = False) -> dict[str, list[float]]:
    """Misses of strikes without and with correction, from the same readings [m]."""
    planned, sensing, rng = corrector.linear.planned, corrector.sensing, np.random.default_rng([9, seed])
    scales = (sensing.tip_noise, planned.tip), (sensing.joint_noise, planned.arm)
    noise = tuple(scale * rng.normal(size=(count, *x.shape[1:])) for scale, x in scales)
    a = planned.arm.shape[2]
    found = {"without": truth(Submovements.none(count, a)).miss, "gains": corrector.struck(truth, noise)[0].miss}
    if searched:
        found["search"] = corrector.struck(truth, noise, searching(corrector))[0].miss
    return {name: x.tolist() for name, x in found.items()}


def cases(arms: list[str], parts: list[str], quick: bool) -> Iterator[dict[str, Any]]:
    """All cases, those of one planned strike after the other."""
    for arm in arms:
        for number in STRIKES[arm][: 1 if quick else None]:
            usual = {"arm": arm, "number": number, "kind": "swing", "delay": 0.03, "start": 0.4, "part": "swing"}
            if "swing" in parts:
                yield from (usual | {"delay": x, "start": y} for x in DELAYS for y in STARTS)
            if "kinds" in parts:
                yield from (usual | {"part": "kinds", "kind": x, "start": y} for x in KINDS[1:] for y in (0.4, 0.8))
            if "search" in parts:
                yield from (usual | {"part": "search", "start": y} for y in (0.4, 0.8))
            if "robust" in parts and arm == "lemon2024":
                yield usual | {"part": "robust"}
            for twin in TWINS if arm == "lemon2024" and number in STRIKES[arm][CHOSEN : CHOSEN + TWIN_STRIKES] else ():
                if twin in parts:
                    yield usual | {"part": twin}


def measured(case: dict[str, Any], count: int) -> dict[str, Any]:
    """One case: a planned strike, disturbed so many times."""
    linear = linear_of(case["arm"], case["number"], case["part"] == "robust")
    rng = np.random.default_rng([case["number"], KINDS.index(case["kind"])])
    if case["part"] in TWINS:
        from peers import correction_twins

        make, count = (
            {"capsules": correction_twins.Capsules, "rods": correction_twins.Rods}[case["part"]],
            min(count, 4),
        )
        still, truth = (make(linear, size, n, rng) for size, n in ((0.0, 1), (linear.expected.swing, count)))
        rehearsed = still(Submovements.none(1, 2))
        linear = LinearStrike(linear.simulator, linear.strike, linear.target, linear.expected, rehearsed)
    else:
        truth = drawn(linear, linear.expected.only(case["kind"]), count, rng)
    corrector = Corrector(linear, sensing=Sensing(delay=case["delay"]), start=case["start"])
    return case | misses(corrector, truth, count, case["number"], case["part"] == "search")


def summary(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Medians and 90th percentiles of all cases that are alike."""
    keys, found = ("arm", "part", "kind", "delay", "start", "held_out"), {}
    for row in rows:
        apart = row | {"held_out": row["number"] >= CHOSEN}
        found.setdefault(tuple(apart[key] for key in keys), []).append(row)
    table = []
    for key, alike in found.items():
        line: dict[str, Any] = dict(zip(keys, key, strict=True))
        both = {x: np.concatenate([r[x] for r in alike]) for x in ("without", "gains", "search") if x in alike[0]}
        line["strikes"] = len(both["without"])
        for name, x in both.items():
            line[f"{name}_median"], line[f"{name}_p90"] = float(np.median(x)), float(np.quantile(x, 0.9))
            if name != "without":
                worse = (x > 1.05 * both["without"]) & (x > both["without"] + WORSE)
                line[f"{name}_worse"] = float(worse.mean())
        table.append(line)
    return table


def said(line: dict[str, Any]) -> str:
    """A case for people, in mm."""
    text = f"{line['arm']:9s} {line['part']:8s} {line['kind']:9s} {1e3 * line['delay']:3.0f} ms {line['start']:.0%}"
    text += f", {line['strikes']} strikes{'' if line['held_out'] else ' by which rules were chosen'}:"
    for name in ("without", "gains", "search"):
        if f"{name}_median" in line:
            text += f"  {name} {1e3 * line[f'{name}_median']:.1f} / {1e3 * line[f'{name}_p90']:.1f}"
            text += f" ({line[f'{name}_worse']:.1%} worse)" if f"{name}_worse" in line else ""
    return text


def main() -> None:
    """Strike, and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--arms", nargs="+", choices=list(REGIONS), default=list(REGIONS))
    parser.add_argument("--parts", nargs="+", choices=PARTS, default=list(PARTS))
    parser.add_argument("--quick", action="store_true", help="one planned strike, disturbed five times")
    parser.add_argument("--json", action="store_true", help="one JSON object instead of a table")
    parser.add_argument("--folder", type=Path, help="of what is found, to go on from")
    options = parser.parse_args()
    rows = []
    for case in cases(options.arms, options.parts, options.quick):
        name = "-".join(str(x) for x in case.values()) + ("-quick" if options.quick else "") + ".json"
        file = options.folder and options.folder / name
        if file and file.exists():
            rows.append(json.loads(file.read_text()))
            continue
        rows.append(measured(case, 5 if options.quick else EACH))
        if file:
            options.folder.mkdir(parents=True, exist_ok=True)
            write_whole(file, json.dumps(rows[-1]))
    table = summary(rows)
    print(json.dumps({"cases": table}) if options.json else "\n".join(map(said, table)))


if __name__ == "__main__":
    main()
