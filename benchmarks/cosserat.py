"""Is the lumped whip true? Tips of our chains against those of a Cosserat rod, which shares no formula with them.

Random strikes that pass the target within 0.3 m, of three arms: that of the paper in the plane (`lemon2024`, hinges), a
person's in space (`nah2023`) and a robot with a rope (`ur5e`), these with rods and with universal joints; each with its
whip as a uniform profile, and tapered. The profile is lumped into N = 12, 24 and 36 nodes; the hand's path in that
strike, what the whip did to the arm included, moves the handle of a PyElastica rod of the same profile, extrapolated to
infinitely many elements, stiff and thin. In millimetres, medians over strikes:

- `tip`: distance of the two tips when ours is closest to the target; `95 %`: its 95th percentile.
- `miss`: difference of the two closest approaches; `largest`: of the two tips over the whole strike.
- `same`: like `tip`, of a rod of N elements (two strikes of each case, N = 12): no matter of how many nodes there are.
- `unspun`: likewise, of N elements that cannot turn about their own axes, which shows what that is worth.
- `oracle`: how far the extrapolation moved the rod's tip, several times its error.

    python benchmarks/cosserat.py [--quick] [--json] [--strikes 100] [--arms ARM ...] [--undamped] [--folder FOLDER]

`--strikes` in all, by turns of the cases. With `--folder` each strike is kept there, and the same command goes on.
Needs the extra `oracle`.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import replace
from functools import lru_cache
from itertools import product
from pathlib import Path
from typing import NamedTuple

import numpy as np
from tqdm import tqdm

from whiptool.goals.target import TARGET
from whiptool.impedance import Controller, constant_preset
from whiptool.limits.arm_limits import ArmLimits
from whiptool.models import WhipProfile, preset
from whiptool.models.presets import rope
from whiptool.models.strike import default_bounds
from whiptool.models.trajectory import Trajectory, closest_on_curve
from whiptool.rollout import CompiledRollout
from whiptool.rollout.cosserat import CosseratWhip, hand_path
from whiptool.runs import RunFolder, code_version
from whiptool.whole_files import write_whole

TIMESTEP = 1e-4  # [s], of ours
NODES = (12, 24, 36)
KINDS = {"lemon2024": ("hinge",), "nah2023": ("rod", "universal"), "ur5e": ("rod", "universal")}
WHIPS = ("uniform", "tapered")
TARGETS = {"lemon2024": np.array(TARGET), "nah2023": np.array([1.995, 0.0, 0.0]), "ur5e": np.array([1.2, 0.3, 0.5])}
ELEMENTS = {"lemon2024": 24, "nah2023": 36, "ur5e": 32}
NEAR = 0.3  # [m]: how near a random strike has to pass
TRACED = 2  # strikes of each case that rods of N elements follow, too
KEYS = ("tip", "miss", "largest", "same_elements", "unspun", "oracle")


class Unit(NamedTuple):
    """One strike of all chains of a case.

    Args:
        arm, whip: Which case: of KINDS and of WHIPS.
        number: Number of the strike.
        damped: Whether the whip is; otherwise its nodes have no moment of inertia, either.
    """

    arm: str
    whip: str
    number: int
    damped: bool = True

    @property
    def name(self) -> str:
        """What its file is called."""
        return "-".join(map(str, self[:3])) + ("" if self.damped else "-undamped")


def units(count: int, damped: bool, arms: list[str]) -> list[Unit]:
    """All work, by turns of the cases, so that what is done first is of all of them."""
    cases = list(product(arms, WHIPS))
    return [Unit(*cases[i % len(cases)], i // len(cases), damped) for i in range(count)]


def profile(arm: str, whip: str, damped: bool) -> WhipProfile:
    """The preset's whip as a profile, uniform or tapered, with its damping or without."""
    lumped = preset(arm).whip
    link = float(lumped.per_node("l")[1])
    uniform = WhipProfile(
        length=lumped.length,
        linear_density=lumped.mass / lumped.length,
        bending_stiffness=float(lumped.per_node("k")[1]) * link,
        bending_damping=damped * float(lumped.per_node("b")[1]) * link,
    )
    if whip == "uniform":
        return uniform
    return replace(uniform, density_taper=0.3, stiffness_taper=0.1, damping_taper=0.1)


@lru_cache
def rollout_of(arm: str, whip: str, damped: bool, joints: str, N: int) -> CompiledRollout:
    """Ours, of the arm with its whip lumped into N nodes."""
    base, inertia = preset(arm), 0.0
    if joints == "universal" and damped:  # the preset's, or the rope's, shared out among N
        whole = base.whip if base.whip.joints == "universal" else rope(joints="universal")
        inertia = float(whole.per_node("node_inertia").sum()) / N
    lumped = profile(arm, whip, damped).lump(N, joints=joints, node_inertia=inertia)
    controller = Controller() if arm == "lemon2024" else Controller(constant_preset(arm))
    return CompiledRollout(replace(base, whip=lumped), controller, timestep=TIMESTEP)


@lru_cache
def strikes_of(arm: str, whip: str, count: int) -> np.ndarray:
    """The first random strikes of a case that pass near its target, (count, 2 a + 1); no faster than its joints are."""
    described = preset(arm).arm
    rng, found = np.random.default_rng(WHIPS.index(whip)), np.empty((0, 2 * described.n + 1))
    rollout = rollout_of(arm, whip, True, KINDS[arm][0], 12)
    while len(found) < count:
        some = default_bounds(described).sample(rng, 200)
        if ArmLimits.are_in(described):
            some = ArmLimits.of(described).command.shortened(some)
        approach = rollout.approach(some, TARGETS[arm])
        found = np.concatenate([found, some[~approach.diverged & (approach.distance < NEAR)]])
    return found[:count]


def compared(unit: Unit, nodes: tuple[int, ...], count: int) -> dict[str, dict]:
    """How far our tips are from the rods', by chain; `count` strikes are drawn of each case."""
    arm, whip, number, damped = unit
    strike, target = strikes_of(arm, whip, count)[number], TARGETS[arm]
    chains = list(product(KINDS[arm], nodes))
    paths = {chain: rollout_of(arm, whip, damped, *chain).trajectory(strike) for chain in chains}
    ended = [chain for chain in chains if not paths[chain].diverged]
    hands = [hand_path(rollout_of(arm, whip, damped, *chain).model, paths[chain]) for chain in ended]
    rod = CosseratWhip(profile(arm, whip, damped), elements=ELEMENTS[arm], gravity=preset(arm).gravity)
    limits, finite = rod.limit(hands)
    results: dict[str, dict] = {chain_name(*chain): {"diverged": True} for chain in chains}
    for i, (joints, N) in enumerate(ended):
        path, truth = paths[joints, N], limits.curve(i)
        approach, place = path.approach(target), in_space(target)
        time = float(approach.time[0])
        nearest = closest_on_curve(truth, place, samples=len(limits.t))
        result = {
            "diverged": False,
            "time": time,
            "speed": float(approach.speed[0]),
            "tip": away(path, truth, time),
            "miss": abs(float(np.linalg.norm(truth(nearest) - place)) - float(approach.distance[0])),
            "largest": max(away(path, truth, t) for t in path.t[::10]),
            "oracle": float(np.linalg.norm(truth(time) - finite.curve(i)(time))),
        }
        if number < TRACED and min(nodes) == N:
            for key, spins in (("same_elements", True), ("unspun", False))[: 1 + (joints == "rod")]:
                same = CosseratWhip(rod.profile, elements=N, gravity=rod.gravity, spins=spins)
                result[key] = away(path, same.limit([hands[i]], elements=False)[0].curve(0), time)
        results[chain_name(joints, N)] = result
    return results


def chain_name(joints: str, N: int) -> str:
    """What a chain's results are called in a strike's file."""
    return f"{joints}-{N}"


def in_space(places: np.ndarray) -> np.ndarray:
    """Places (..., 2) of the plane in space, (..., 3); those in space as they are."""
    return places if places.shape[-1] == 3 else np.insert(places, 1, 0.0, axis=-1)


def away(path: Trajectory, truth, time: float) -> float:
    """Distance of our tip from the rod's at a time [m]."""
    tip = np.array([np.interp(time, path.t, x) for x in in_space(path.tip).T])
    return float(np.linalg.norm(tip - truth(time)))


def results(todo: list[Unit], nodes: tuple[int, ...], folder: Path | None) -> dict[Unit, dict[str, dict]]:
    """Every strike's results, read where they were kept."""
    found, count = {}, 1 + max(unit.number for unit in todo)
    with tqdm(todo, leave=False, unit=" strikes") as bar:
        for unit in bar:
            bar.set_postfix_str(unit.name)
            kept = folder / f"{unit.name}.json" if folder else None
            if kept is not None and kept.exists():
                found[unit] = json.loads(kept.read_text())
                continue
            found[unit] = compared(unit, nodes, count)
            if kept is not None:
                write_whole(kept, json.dumps(found[unit]))
    return found


def summary(found: dict[Unit, dict[str, dict]], nodes: tuple[int, ...]) -> list[dict]:
    """A row for each chain of each case: medians, and a 95th percentile [m]."""
    rows = []
    for arm, whip in dict.fromkeys(unit[:2] for unit in found):
        for joints, N in product(KINDS[arm], nodes):
            mine = [x[chain_name(joints, N)] for unit, x in found.items() if unit[:2] == (arm, whip)]
            ended = [x for x in mine if not x["diverged"]]
            row = {"arm": arm, "whip": whip, "joints": joints, "N": N, "strikes": len(ended)}
            row["diverged"] = len(mine) - len(ended)
            for key in (*KEYS, "speed"):
                values = [x[key] for x in ended if key in x]
                row[key] = float(np.median(values)) if values else None
            row["tip_p95"] = float(np.percentile([x["tip"] for x in ended], 95)) if ended else None
            rows.append(row)
    return rows


def uniform_tip(found: dict[Unit, dict[str, dict]], N: int) -> float:
    """Median of `tip` over uniform whips of N nodes, on hinges or of rods [m]."""
    mine = [x[chain_name(KINDS[unit.arm][0], N)] for unit, x in found.items() if unit.whip == "uniform"]
    return float(np.median([x["tip"] for x in mine if not x["diverged"]]))


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="one strike in the plane, of 12 nodes")
    parser.add_argument("--json", action="store_true", help="one JSON object instead of a table")
    parser.add_argument("--strikes", type=int, default=100, help="in all (default 100)")
    parser.add_argument(
        "--undamped", action="store_true", help="whips without damping, nodes without moment of inertia"
    )
    parser.add_argument("--arms", nargs="+", choices=list(KINDS), default=list(KINDS), help="of these only")
    parser.add_argument("--folder", type=Path, help="keep each strike there, and go on where it was left")
    arguments = parser.parse_args()
    damped = not arguments.undamped
    nodes, todo = (
        (NODES[:1], units(1, damped, list(KINDS)))
        if arguments.quick
        else (NODES, units(arguments.strikes, damped, arguments.arms))
    )
    if arguments.folder is None:
        found = results(todo, nodes, None)
    else:
        path = arguments.folder
        is_run = (path / "config.toml").exists()
        with RunFolder.open(path) if is_run else RunFolder.create(path, {"version": code_version()}) as run:
            found = results(todo, nodes, run.path)
    rows = summary(found, nodes)
    headline = {f"uniform_tip_{N}": uniform_tip(found, N) for N in nodes}
    if arguments.json:
        print(json.dumps({**headline, "strikes": len(found), "rows": rows}))
        return
    print("tips of our chains against a Cosserat rod, medians over strikes [mm]; 95 %: 95th percentile of `tip`")
    names = ("strikes", "tip", "95 %", "miss", "largest", "same", "unspun", "oracle")
    print(" " * 35 + f"{names[0]:>6s}" + "".join(f"{name:>8s}" for name in names[1:]))
    for row in rows:
        which = f"{row['arm']:10s} {row['whip']:8s} {row['joints']:10s} {row['N']:3d} {row['strikes']:5d}"
        values = (row[key] for key in ("tip", "tip_p95", "miss", "largest", "same_elements", "unspun", "oracle"))
        print(f"  {which}" + "".join("       -" if x is None else f"{1e3 * x:8.2f}" for x in values))
    for N in nodes:
        print(f"  uniform, on hinges or of rods, {N} nodes: {1e3 * headline[f'uniform_tip_{N}']:.2f} mm")


if __name__ == "__main__":
    main()
