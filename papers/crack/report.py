"""The report on wave and crack: what is worked on, and what it says."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from papers.context import Context
from papers.crack import pictures, published
from papers.crack.closed_forms import (
    folded_speed,
    folded_time,
    hanging_frequencies,
    loop_speed,
    lumped_frequencies,
)
from papers.crack.units import GRAVITY, FastestUnit, FoldedUnit, LoopUnit
from whiptool import Controller, WhipParameters, WhipProfile, preset
from whiptool.dynamics.modes import hanging_modes
from whiptool.models.parameters import Model
from whiptool.rollout.trust import BEND, MACH, SOUND, trust_table
from whiptool.viz.report import NO_VERDICT, Claim, Claims, Picture, Section, Table, Text, verdict_over

MODEL, CONTROLLER = preset("lemon2024"), Controller()
TITLE = "Wave and crack of a whip"
SUBTITLE = (
    "A loop that travels along a tapered whip (Goriely and McMillen 2002, doi:10.1103/PhysRevLett.88.244301), chains "
    "whose motion has a closed form, what tips reach, and how far a simulation may be trusted. Verdicts are computed."
)
FILM = "crack.mp4"
MODES, START = 3, 0.3
TAPERS = (1.0, 0.3, 0.1)
CORD = {"stiffness": 1e-3, "damping_time": 0.01}  # a cord of some millimetres, whose damping keeps the loop round
AIR = 0.008  # [N s^2/m^3], drag per length of a thong of 12 mm
BULLWHIP = {"taper": 0.175, "stiffness": 0.108, "damping_time": 0.57, "drag": AIR}  # fitted to people, docs/human.md
ROBOTS = (("lemon2024", None), ("ur5e", None), ("ur5e", 0.3), ("panda", None))
Found = Mapping[str, Mapping[str, Any]]


def facts() -> dict[str, str]:
    """What was run, for the report's head."""
    from whiptool.runs import code_version

    loop = LoopUnit()
    return {
        "code": f"whiptool {code_version()}",
        "loop": f"whip of {loop.length:g} m, {loop.density:g} kg/m at the handle, round and of one material; the "
        f"handle rests, the part beyond {START:g} of the length moves at {loop.speed:g} m/s at first; no gravity",
        "folded chain": "1 m, folded in the middle to a half circle of 2 cm, one end is let go",
        "crack": f"a loop at {SOUND:g} m/s, half as fast as the tip, which is then at {published.CRACK * SOUND:g} m/s",
    }


def sections(context: Context) -> list[Section]:
    """Closed forms, the loop and what changes its speed, the range of trust, and what is reached."""
    nodes = (8, 12) if context.quick else (20, 40, 80, 120)
    falls = [FoldedUnit(nodes=n) for n in (nodes if context.quick else (*nodes, 160))]
    tapers = [LoopUnit(nodes=n, taper=taper) for taper in TAPERS for n in nodes]
    cords = [LoopUnit(nodes=n, taper=1.0, **CORD) for n in (nodes if context.quick else (20, 40, 60, 80, 120))]
    base = LoopUnit(nodes=nodes[-2])
    others = {
        "as it is": base,
        "begins at 0.1 of the length": LoopUnit(nodes=base.nodes, start=0.1),
        "begins at 0.5 of the length": LoopUnit(nodes=base.nodes, start=0.5),
        "with drag": LoopUnit(nodes=base.nodes, drag=AIR),
        "with drag, taper 0.1": LoopUnit(nodes=base.nodes, drag=AIR, taper=0.1),
        "with stiffness and damping": LoopUnit(nodes=base.nodes, **CORD),
        "with stiffness, damping and drag": LoopUnit(nodes=base.nodes, drag=AIR, **CORD),
        "the bullwhip fitted to people's throws": LoopUnit(nodes=base.nodes, speed=published.PEOPLE_HAND, **BULLWHIP),
    }
    robots = [
        FastestUnit(name=n, taper=t, trials=40 if context.quick else 600)
        for n, t in ROBOTS[: 1 if context.quick else 4]
    ]
    found = context.results([*falls, *tapers, *cords, *others.values(), *robots], "crack")
    title = f"A loop in a whip of taper {TAPERS[1]:g}, no drag"
    pictures.write_loop_film(context.store.units.parent / FILM, base.motion(), title)
    return [
        _closed_forms(found, falls, tapers),
        _loops(found, tapers, others),
        _trust(found, cords),
        _reached(found, robots),
    ]


def modes_of(nodes: int, *, hats: bool) -> np.ndarray:
    """Return the first angular frequencies of a hanging chain of 1 m [rad/s] by the model's linearisation, lumped to
    equal nodes or, with `hats`, as a profile is."""
    if hats:
        whip = WhipProfile(length=1.0, linear_density=1.0, bending_stiffness=1e-12, bending_damping=0.0).lump(nodes)
    else:
        whip = WhipParameters(N=nodes, l=1 / nodes, m=1 / nodes, k=0.0, b=0.0)
    model = Model(whip, MODEL.arm, gravity=GRAVITY)
    return 2 * np.pi * hanging_modes(model, count=MODES).frequencies


def _closed_forms(found: Found, falls: list[FoldedUnit], loops: list[LoopUnit]) -> Section:
    exact, nodes = hanging_frequencies(1.0, GRAVITY, MODES), [unit.nodes for unit in falls]
    head = ["nodes", "hanging, equal nodes", "... against Laguerre", "hanging, a profile's nodes"]
    rows = [[*head, "time to fall by 0.9", "speed half down", "largest pull [weights]"]]
    errors: dict[str, float] = {}
    pulls = []
    for n, unit in zip(nodes, falls, strict=True):
        one = found[unit.key]
        equal, hats = modes_of(n, hats=False), modes_of(n, hats=True)
        own = np.abs(equal / lumped_frequencies(n, 1.0, GRAVITY, MODES) - 1).max()
        ratio = one["time"] / np.sqrt(2 * one["fall"] / GRAVITY)
        errors = {
            "hanging chain": np.abs(hats / exact - 1).max(),
            "time to fall by 0.9": abs(one["times"][-1] / folded_time(one["depths"][-1], 1.0, GRAVITY) - 1),
            "speed half down": abs(np.interp(0.5, one["depths"], one["speeds"]) / folded_speed(0.5, 1.0, GRAVITY) - 1),
        }
        shares = [np.abs(equal / exact - 1).max(), own, *list(errors.values())]
        pulls.append(f"{one['pull']:.0f}")
        rows.append([str(n), *(f"{x:.2%}" if x > 1e-5 else "below 0.001%" for x in shares), pulls[-1]])
    fall = ratio  # with the most nodes
    loop_rows = [["taper", "tip speed", "closed form", "momentum left", "closed form"]]
    for taper, unit in {unit.taper: unit for unit in loops}.items():  # the last of each taper is the finest
        found_speed, left = unit.over_first(found[unit.key]["half_speed"]), found[unit.key]["half_momentum"]
        speed = loop_speed((1 + START) / 2, START, taper)
        loop_rows.append([f"{taper:g}", *(f"{x:.3f}" for x in (found_speed, speed, left, 1 / speed))])
        errors[f"loop's speed, taper {taper:g}"] = abs(found_speed / speed - 1)
        errors[f"its momentum, taper {taper:g}"] = abs(left * speed - 1)
    said = "; ".join(f"{name} {error:.2%}" for name, error in errors.items())
    claims = [
        Claim(
            "Each closed form is met to 1 %",
            "closed forms",
            f"{nodes[-1]} nodes: {said}",
            verdict_over({name: bool(error < 0.01) for name, error in errors.items()}),
            "The error of each with the most nodes.",
        ),
        Claim(
            "A folded chain falls faster than a free body",
            f"in {published.FALL_SHARE:.0%} of the time of free fall",
            f"in {fall:.1%}",
            verdict_over({"all": bool(abs(fall - published.FALL_SHARE) < 0.01)}),
            "Within 0.01 of the published share.",
        ),
        Claim(
            "It pulls at its support with many times its weight",
            f"about {published.LARGEST_PULL:g} weights at most, measured",
            f"{', '.join(pulls)} weights with {', '.join(map(str, nodes))} nodes",
            NO_VERDICT,
            "The pull grows with the number of links, and that of the measured chain is not known here.",
        ),
    ]
    about = (
        "The frequencies of a hanging chain are zeros of the Bessel function J0; those of equal lumped nodes are "
        "zeros of a Laguerre polynomial, and err by 1 / (4 N); nodes of a profile, which share a link's mass between "
        "its ends, err by the square. Columns of the hanging chain are the largest error of three modes. A folded "
        "chain conserves energy in the part that falls; so does a whip along which a loop runs, half the tip's speed "
        "fast, with the tension of a quarter of the density times the square of the tip's speed on both sides, which "
        "the hand's impulse takes up."
    )
    falls_by = {n: found[unit.key] for n, unit in zip(nodes, falls, strict=True)}
    return Section("Closed forms", [
        Text(about), Claims(claims), Table(rows, "Errors, chain of 1 m."),
        Picture(pictures.fall_picture(falls_by, GRAVITY), "The tip of a folded chain."),
        Table(loop_rows, f"When an ideal loop is halfway to the tip, over what was at first, {loops[-1].nodes} nodes."),
    ])  # fmt: skip


def _loops(found: Found, tapers: list[LoopUnit], others: dict[str, LoopUnit]) -> Section:
    by = {
        (unit.taper, unit.nodes): {"gain": unit.over_first(found[unit.key]["peak"]), "most": unit.most}
        for unit in tapers
    }
    nodes = sorted({n for _, n in by})
    starts = [f"start for a tip at {SOUND:g} m/s", f"speed to crack at: a loop at {SOUND:g} m/s"]
    rows = [["taper", *(f"{n} nodes" for n in nodes), "most it could be", *starts]]
    for taper in TAPERS:
        gains, most = [by[taper, n]["gain"] for n in nodes], by[taper, nodes[-1]]["most"]
        speeds = [f"{mach * SOUND / gains[-1]:.0f} m/s" for mach in (1.0, published.CRACK)]
        rows.append([f"{taper:g}", *(f"{x:.1f}" for x in gains), f"{most:.1f}", *speeds])
    grows = {str(n): by[TAPERS[-1], n]["gain"] > by[TAPERS[1], n]["gain"] > by[TAPERS[0], n]["gain"] for n in nodes}
    table = [["whip", "largest tip speed over that at the start", "energy left then", "sharpest bend"]]
    for name, unit in others.items():
        one = found[unit.key]
        table.append(
            [
                name,
                f"{unit.over_first(one['peak']):.1f}",
                f"{one['energy']:.0%}",
                f"{np.degrees(one['bend']):.0f} degrees",
            ]
        )
    claim = Claim("The tip is faster the more the whip is tapered", "Goriely and McMillen 2002",
                  "; ".join(f"taper {row[0]}: {row[len(nodes)]}" for row in rows[1:]), verdict_over(grows),
                  "At each number of nodes.")  # fmt: skip
    about = (
        "A whip cracks when its loop is faster than sound (Goriely and McMillen 2002). The loop is half as fast as the "
        "tip, which is then at Mach 2; a tip at Mach 1 does not make a crack. Without drag all speeds grow with that "
        "of the start, so that the last columns say how fast the part beyond the loop has to move at first for tip "
        "and loop to reach the speed of sound with the most nodes. Most it could be: all energy in the last node. "
        "Without stiffness nothing ends the growth but the length of a link. Below: taper "
        f"{TAPERS[1]:g}, {others['as it is'].nodes} nodes, loop from {START:g} of the length, unless it says "
        "otherwise."
    )
    return Section("A loop that runs along a whip", [
        Text(about), Claims([claim]), Table(rows, "Largest tip speed over that at the start; no drag, no stiffness."),
        Picture(pictures.taper_picture(by), "Taper and number of nodes."), Table(table),
    ])  # fmt: skip


def trust_errors(found: Found, cords: list[LoopUnit]) -> tuple[list[float], list[float]]:
    """Return the sharpest bends [degrees] of a loop with fewer and fewer nodes, and by how much of it the tip's largest
    speed is below that with the most."""
    peaks = np.array([unit.over_first(found[unit.key]["peak"]) for unit in cords])
    bends = np.degrees([found[unit.key]["bend"] for unit in cords])
    return bends[:-1].tolist(), (1 - peaks[:-1] / peaks[-1]).tolist()


def _trust(found: Found, cords: list[LoopUnit]) -> Section:
    bends, errors = trust_errors(found, cords)
    rows = [["nodes", "largest tip speed over that at the start", "sharpest bend", "below that of the most nodes"]]
    for unit, error in zip(cords, [*errors, None], strict=True):
        one = found[unit.key]
        below, gain = "-" if error is None else f"{error:.1%}", unit.over_first(one["peak"])
        rows.append([str(unit.nodes), f"{gain:.2f}", f"{np.degrees(one['bend']):.0f} degrees", below])
    about = (
        f"A uniform cord (EI {CORD['stiffness']:g} N m², damping over stiffness {CORD['damping_time']:g} s) whose "
        "damping keeps the loop round: its largest tip speed converges as the links become short against the loop, "
        "and the sharpest bend between links tells how far it has. simulate and optimize warn of strikes beyond "
        f"{BEND.limit:g} degrees or Mach {MACH.limit:g}. The law of bending of rods is a series, 0.8 % below a linear "
        "spring at 60 degrees; Cosserat rods stretch by the square of speed over wave speed."
    )
    return Section("How far to trust it", [
        Text(about), Table(trust_table()), Table(rows, "Convergence in the number of nodes."),
        Picture(pictures.trust_picture(bends, errors), "The error of the tip's largest speed."),
    ])  # fmt: skip


def _reached(found: Found, robots: list[FastestUnit]) -> Section:
    rows = [["who", "hand [m/s]", "tip [m/s]", "Mach", "beyond the range of trust"]]
    speeds = {"people, measured": published.PEOPLE_TIP, "a cracking whip, measured": published.CRACK_SPEED}
    rows.append([
        "people's discrete throws (Krotov et al. 2022)", f"{published.PEOPLE_HAND:g}", f"{published.PEOPLE_TIP:g}",
        f"{published.PEOPLE_TIP / SOUND:.2f}", "measured",
    ])  # fmt: skip
    for unit in robots:
        one = found[unit.key]
        name = unit.name if unit.taper is None else f"{unit.name}, taper {unit.taper:g}"
        speeds[name] = one["tip_speed"]
        rows.append([f"{name}: fastest strike of {unit.trials}", f"{one['hand_speed']:.1f}", f"{one['tip_speed']:.0f}",
                     f"{one['tip_speed'] / SOUND:.2f}", one["beyond"] or "no"])  # fmt: skip
    rows.append(["a whip that cracks (Krehl et al. 1998)", "-", f"{published.CRACK_SPEED:g}",
                 f"{published.CRACK_SPEED / SOUND:.2f}", "measured"])  # fmt: skip
    about = (
        "Robots strike within the limits of their makers (the planar arm has no limits); the search maximises the "
        "speed at a place near full reach, the table has the largest of the strike. None of these whips cracks."
    )
    picture = pictures.reached_picture(dict(sorted(speeds.items(), key=lambda x: x[1])))
    return Section("What is reached", [Text(about), Table(rows), Picture(picture, "Largest tip speeds.")])
