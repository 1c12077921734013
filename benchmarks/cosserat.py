"""Is the lumped whip true? Tips of our chains against those of a Cosserat rod, which shares no formula with them.

Random strikes that pass the target within 0.3 m, of three arms: that of the paper in the plane (`lemon2024`, hinges), a
person's in space (`nah2023`) and a robot with a rope (`ur5e`), these with rods and with universal joints; each with its
whip as a uniform profile, and tapered. The profile is lumped into N = 12, 24 and
36 nodes; the hand's path in that strike, what the whip did to the arm included, moves the handle of a PyElastica rod of
the same profile, extrapolated to infinitely many elements, stiff and thin. `tip`: distance of the two tips when ours is
closest to the target. `miss`: difference of the two closest approaches. `largest`: of the two tips over the whole
strike. `same_elements`: like `tip`, of a rod of N elements (first strikes of each case): what remains is no matter of
how many nodes there are. `unspun`: likewise, of N elements that cannot turn about their own axes, as the rods of our
chains cannot. `oracle`: how far the extrapolation moved the rod's tip, several times its error.

    python benchmarks/cosserat.py [--quick] [--json] [--strikes 100] [--folder FOLDER]

`--strikes` in all, by turns of the six cases. With `--folder` each strike is kept there, and the same command goes on.
Needs the extra `oracle`.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator
from dataclasses import replace
from functools import lru_cache
from itertools import product
from pathlib import Path
from typing import NamedTuple

import numpy as np
from tqdm import tqdm

from whiptool.impedance import Controller, constant_preset
from whiptool.models import Model, WhipProfile, preset
from whiptool.models.arm_limits import ArmLimits
from whiptool.models.strike import default_bounds, shortened
from whiptool.rollout import CompiledRollout
from whiptool.rollout.closest import closest_on_curve
from whiptool.rollout.cosserat import CosseratWhip, hand_path
from whiptool.rollout.trajectory import Trajectory
from whiptool.runs import RunFolder, code_version
from whiptool.target import TARGET
from whiptool.whole_files import write_whole

TIMESTEP = 1e-4  # [s], of ours
NODES = (12, 24, 36)
KINDS = {"lemon2024": ("hinge",), "nah2023": ("rod", "universal"), "ur5e": ("rod", "universal")}
WHIPS = ("uniform", "tapered")
TARGETS = {"lemon2024": np.array(TARGET), "nah2023": np.array([1.995, 0.0, 0.0]), "ur5e": np.array([1.2, 0.3, 0.5])}
ELEMENTS = {"lemon2024": 24, "nah2023": 48, "ur5e": 48}
NEAR = 0.3  # [m]: how near a random strike has to pass
TRACED = 5  # strikes of each case that a rod of N elements follows, too


class Unit(NamedTuple):
    """One strike of one chain.

    Args:
        arm, whip: Which case: of KINDS and of WHIPS.
        number: Of the strike.
        joints, N: Of the chain.
    """

    arm: str
    whip: str
    number: int
    joints: str
    N: int

    @property
    def name(self) -> str:
        """What its file is called."""
        return "-".join(map(str, self))

    @property
    def chain(self) -> tuple[str, str, str, int]:
        """Which row of the table it belongs to."""
        return self.arm, self.whip, self.joints, self.N


def units(count: int, nodes: tuple[int, ...]) -> Iterator[Unit]:
    """All work, strike by strike, so that what is done first is of all cases."""
    cases = list(product(KINDS, WHIPS))
    for i in range(count):
        arm, whip = cases[i % len(cases)]
        for joints, N in product(KINDS[arm], nodes):
            yield Unit(arm, whip, i // len(cases), joints, N)


def profile(arm: str, whip: str) -> WhipProfile:
    """The preset's whip as a profile, uniform or tapered."""
    lumped = preset(arm).whip
    link = float(lumped.per_node("l")[1])
    uniform = WhipProfile(
        length=lumped.length,
        linear_density=lumped.mass / lumped.length,
        bending_stiffness=float(lumped.per_node("k")[1]) * link,
        bending_damping=float(lumped.per_node("b")[1]) * link,
    )
    if whip == "uniform":
        return uniform
    return replace(uniform, density_taper=0.3, stiffness_taper=0.1, damping_taper=0.1)


def model_of(unit: Unit) -> Model:
    """The arm with its whip lumped into N nodes."""
    base, whip = preset(unit.arm), profile(unit.arm, unit.whip)
    inertia = 0.0
    if unit.joints == "universal":  # the preset's, shared out among N
        inertia = float(base.whip.per_node("node_inertia").sum()) / unit.N
    return replace(base, whip=whip.lump(unit.N, joints=unit.joints, node_inertia=inertia))  # type: ignore[arg-type]


@lru_cache
def rollout_of(unit: Unit) -> CompiledRollout:
    """Ours; `unit` is the first of its chain."""
    controller = Controller() if unit.arm == "lemon2024" else Controller(constant_preset(unit.arm))
    return CompiledRollout(model_of(unit), controller, timestep=TIMESTEP)


@lru_cache
def strikes_of(arm: str, whip: str, count: int) -> np.ndarray:
    """The first random strikes of a case that pass near its target, (count, 2 a + 1); no faster than its joints are."""
    described = preset(arm).arm
    rng, found = np.random.default_rng(WHIPS.index(whip)), np.empty((0, 2 * described.n + 1))
    rollout = rollout_of(Unit(arm, whip, 0, KINDS[arm][0], 12))
    while len(found) < count:
        some = default_bounds(described).sample(rng, 200)
        if ArmLimits.are_in(described):
            some = shortened(some, ArmLimits.of(described).speeds)
        approach = rollout.approach(some, TARGETS[arm])
        found = np.concatenate([found, some[~approach.diverged & (approach.distance < NEAR)]])
    return found[:count]


def compared(unit: Unit, count: int) -> dict:
    """How far our tip is from the rod's, or that our strike diverged; `count` strikes are drawn of each case."""
    rollout = rollout_of(unit._replace(number=0))
    strike, target = strikes_of(unit.arm, unit.whip, count)[unit.number], TARGETS[unit.arm]
    path = rollout.trajectory(strike)
    if path.diverged:
        return {"diverged": True}
    approach = path.approach(target)
    time, hand = float(approach.time[0]), hand_path(rollout.model, path)
    rod = CosseratWhip(profile(unit.arm, unit.whip), elements=ELEMENTS[unit.arm], gravity=rollout.model.gravity)
    limits, finite = rod.limit([hand])
    truth = limits.curve(0)
    place = in_space(target)
    nearest = closest_on_curve(truth, place, samples=len(limits.t))
    result = {
        "diverged": False,
        "time": time,
        "speed": float(approach.speed[0]),
        "tip": away(path, truth, time),
        "miss": abs(float(np.linalg.norm(truth(nearest) - place)) - float(approach.distance[0])),
        "largest": max(away(path, truth, t) for t in path.t[::10]),
        "oracle": float(np.linalg.norm(truth(time) - finite.curve(0)(time))),
    }
    if unit.number < TRACED:
        for key, spins in (("same_elements", True), *([("unspun", False)] if unit.joints == "rod" else [])):
            same = CosseratWhip(rod.profile, elements=unit.N, gravity=rod.gravity, spins=spins)
            result[key] = away(path, same.limit([hand], elements=False)[0].curve(0), time)
    return result


def in_space(places: np.ndarray) -> np.ndarray:
    """Places (..., 2) of the plane in space, (..., 3); those in space as they are."""
    return places if places.shape[-1] == 3 else np.insert(places, 1, 0.0, axis=-1)


def away(path: Trajectory, truth, time: float) -> float:
    """Distance of our tip from the rod's at a time [m]."""
    tip = np.array([np.interp(time, path.t, x) for x in in_space(path.tip).T])
    return float(np.linalg.norm(tip - truth(time)))


def results(todo: list[Unit], folder: Path | None) -> dict[Unit, dict]:
    """Every unit's result, read where it was kept."""
    found, count = {}, 1 + max(unit.number for unit in todo)
    with tqdm(todo, leave=False, unit=" strikes") as bar:
        for unit in bar:
            bar.set_postfix_str(unit.name)
            kept = folder / f"{unit.name}.json" if folder else None
            if kept is not None and kept.exists():
                found[unit] = json.loads(kept.read_text())
                continue
            found[unit] = compared(unit, count)
            if kept is not None:
                write_whole(kept, json.dumps(found[unit]))
    return found


def summary(found: dict[Unit, dict]) -> list[dict]:
    """A row for each chain: medians and 95th percentiles [m]."""
    rows = []
    for chain in dict.fromkeys(unit.chain for unit in found):
        mine = [x for unit, x in found.items() if unit.chain == chain]
        ended = [x for x in mine if not x["diverged"]]
        row = dict(zip(("arm", "whip", "joints", "N"), chain, strict=True))
        row |= {"strikes": len(ended), "diverged": len(mine) - len(ended)}
        for key in ("tip", "miss", "largest", "oracle", "same_elements", "unspun", "speed"):
            values = [x[key] for x in ended if key in x]
            row[key] = float(np.median(values)) if values else None
        row["tip_p95"] = float(np.percentile([x["tip"] for x in ended], 95)) if ended else None
        rows.append(row)
    return rows


def uniform_tip(found: dict[Unit, dict], N: int) -> float:
    """Median of `tip` over uniform whips of N nodes, on hinges or of rods [m]."""
    mine = (unit for unit in found if unit.whip == "uniform" and unit.joints != "universal" and unit.N == N)
    return float(np.median([found[unit]["tip"] for unit in mine if not found[unit]["diverged"]]))


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="one strike in the plane, of 12 nodes")
    parser.add_argument("--json", action="store_true", help="one JSON object instead of a table")
    parser.add_argument("--strikes", type=int, default=100, help="in all (default 100)")
    parser.add_argument("--folder", type=Path, help="keep each strike there, and go on where it was left")
    arguments = parser.parse_args()
    here = Path(__file__).resolve().parent
    sys.path[:] = [entry for entry in sys.path if Path(entry).resolve() != here]  # Numba would import `coverage` here
    todo = list(units(1, (12,)) if arguments.quick else units(arguments.strikes, NODES))
    if arguments.folder is None:
        found = results(todo, None)
    else:
        path = arguments.folder
        is_run = (path / "config.toml").exists()
        with RunFolder.open(path) if is_run else RunFolder.create(path, {"version": code_version()}) as run:
            found = results(todo, run.path)
    rows = summary(found)
    headline = {f"uniform_tip_{N}": uniform_tip(found, N) for N in sorted({unit.N for unit in found})}
    if arguments.json:
        print(json.dumps({**headline, "strikes": len({unit[:3] for unit in found}), "rows": rows}))
        return
    print("tips of our chains against a Cosserat rod, medians over strikes [mm]; 95 %: 95th percentile of `tip`")
    print("                                     strikes    tip   95 %   miss  largest  same elements  unspun  oracle")
    for row in rows:
        mm = {key: "   -  " if row[key] is None else f"{1e3 * row[key]:6.2f}" for key in row if key in KEYS}
        print(
            f"  {row['arm']:10s} {row['whip']:8s} {row['joints']:10s} {row['N']:3d} {row['strikes']:5d} {mm['tip']} "
            f"{mm['tip_p95']} {mm['miss']}   {mm['largest']}         {mm['same_elements']}  {mm['unspun']}  {mm['oracle']}"
        )
    print("  uniform, hinges and rods: " + ", ".join(f"{1e3 * x:.2f} mm ({key[12:]} nodes)" for key, x in headline.items()))


KEYS = ("tip", "tip_p95", "miss", "largest", "same_elements", "unspun", "oracle")

if __name__ == "__main__":
    main()
