"""Unknown ropes on a UR5e: how often the first strike after one wiggle hits, family by family."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from whiptool.studies.reproduction.context import Context
from whiptool.studies.reproduction.rope_swings import IN_SPACE, ROPE, families
from whiptool.studies.reproduction.ropes import MATERIALS, RopeStudy, RopeUnit, WiggleUnit
from whiptool.studies.reproduction.trials import reliability
from whiptool.viz.plots import COLORS, STYLE
from whiptool.viz.report import Picture, Section, Table, Text

NEAR, CONE = 0.05, math.radians(10)  # [m], [rad] of a hit
FURTHER = 20  # goals at which the first rope of each family is struck beside
POINT_GOAL, AIMED_GOAL, MISS_GOAL, CALIBRATION_GOAL, TIME_GOAL, FURTHER_GOAL = 0.99, 0.90, 0.01, 0.1, 5.0, 0.98
_LINES: dict[str, str] = dict(zip(IN_SPACE, ("blue", "orange", "vermilion", "black"), strict=True))
Struck = Sequence[Mapping[str, Any]]


def sections(context: Context) -> list[Section]:
    """What was run, hits, misses, goals."""
    study = RopeStudy(thorough=not context.quick)
    tried = families(("kin", ROPE) if context.quick else IN_SPACE)
    ropes, count, further = (1, 1, 0) if context.quick else (context.whips, context.whip_targets, FURTHER)
    used = sorted({MATERIALS[seed % len(MATERIALS)] for seed in range(ropes)})
    wiggles = {material: WiggleUnit(study=study, material=material) for material in used}
    known = context.results([*wiggles.values()], "wiggles")

    def unit(family: str, seed: int, **goals: int) -> RopeUnit:
        wiggle = known[wiggles[study.rope(family, seed).material].name]["strike"]
        return RopeUnit(study=study, family=family, seed=seed, wiggle=tuple(wiggle), **goals)

    # a killed run has about as many of each family
    work = [unit(family, seed, count=count) for seed in range(ropes) for family in tried]
    results = context.results(work, "unknown ropes")
    again = [unit(family, 0, first=count, count=further) for family in tried if further]
    later = context.results(again, "further goals")
    by_family = {f: [results[u.name] for u in work if u.family == f] for f in tried}
    first = {f: [x for r in found for x in r["struck"]] for f, found in by_family.items()}
    others = {u.family: later[u.name]["struck"] for u in again}
    return [
        Section(
            "Unknown ropes in space, one wiggle, then one strike a goal",
            [
                Text(_about(ropes, count, tried)),
                Table(
                    _hits(first, by_family), "The first strike at each goal; medians, and 95th percentiles in brackets."
                ),
                Picture(_misses(first), "Share of first strikes that miss by no more; dashed: the hit radius."),
                *(
                    [Table(_hits(others, {}), "Further goals, with the same knowledge.")]
                    if any(others.values())
                    else []
                ),
            ],
        ),
        Section("Goals", [Table(_goals(first, others, by_family))]),
    ]


def _about(ropes: int, count: int, tried: Sequence[str]) -> str:
    left_out = "" if ROPE in tried else " rope is left out: PyElastica is not installed (pip install whiptool[oracle])."
    return (
        f"{ropes} ropes of each family on a UR5e with a stick of 0.65 m, of {', '.join(MATERIALS)} in turn, drawn by "
        "seed from what data sheets say of each (whiptool.adaptation.materials); the prior is that of the material. "
        "kin: uniform, in rods. strange: 36 rods, a cone with random deviations, a bead, a soft joint, springs that "
        "stiffen, less drag along than across, uneven friction, a late clock. stranger: twice that. rope: a Cosserat "
        "rod in PyElastica, tapered, that stretches and twists, with drag, a knot at its end and a late clock. Motion "
        "capture sees the tip 100 times a second with 2 mm noise in one wiggle, and nothing else; then one strike at "
        f"each of {count} goals of “Point It, Strike It” (2026) that lie within reach: within 5 cm, within 10 degrees, "
        "at 1 m/s or more, all limits of the robot kept, arm, rope and floor clear of each other. No camera images."
        f"{left_out} For comparison, on real ropes after eight calibration swings: 87 % within 5 cm, 52 % within 5 cm "
        "and 10 degrees."
    )


def _hits(struck: Mapping[str, Struck], looks: Mapping[str, Sequence[Mapping[str, Any]]]) -> list[list[str]]:
    head = ["family", "ropes", "strikes", "within 5 cm", "and 10 degrees", "miss [cm]", "angle [deg]"]
    rows = [[*head, "stated", "calibration error", "not reached on the mean", "learn [s]", "plan [s]"]]
    for family, strikes in struck.items():
        if not strikes:
            continue
        miss, angle = column(strikes, "miss"), np.degrees(column(strikes, "angle"))
        stated = np.array([x["probability"] for x in strikes])
        error = reliability(stated, np.array([x["hit"] for x in strikes]))[1]
        seconds = [r["look"]["seconds"] for r in looks.get(family, []) if r["look"]]
        rows.append(
            [
                family,
                str(len(looks[family])) if family in looks else "1",
                str(len(strikes)),
                f"{100 * np.mean(miss <= NEAR):.0f} %",
                f"{100 * np.mean([x['hit'] for x in strikes]):.0f} %",
                _spread(100 * miss),
                _spread(angle),
                f"{100 * stated.mean():.0f} %",
                f"{error:.3f}",
                str(sum(x["mean_miss"] > NEAR or not x["allowed"] for x in strikes)),
                _spread(np.array(seconds)) if seconds else "",
                _spread(column(strikes, "seconds")),
            ]
        )
    return rows


def column(strikes: Struck, name: str) -> np.ndarray:
    """Return a number of each strike; infinite where it is not known."""
    return np.array([np.inf if x[name] is None else x[name] for x in strikes], float)


def _spread(values: np.ndarray) -> str:
    return f"{np.median(values):.2g} ({np.percentile(values, 95, method='higher'):.2g})"


def _misses(struck: Mapping[str, Struck]) -> Figure:
    with matplotlib.rc_context(STYLE):
        figure = Figure((6.5, 3.8), layout="constrained")
        ax = figure.subplots()
        for family, strikes in struck.items():
            miss = np.sort(100 * column(strikes, "miss"))
            share = 100 * np.arange(1, len(miss) + 1) / max(len(miss), 1)
            ax.step(np.maximum(miss, 1e-3), share, where="post", color=COLORS[_LINES[family]], label=family)
        ax.axvline(100 * NEAR, color="0.4", linestyle="--", linewidth=1.2)
        ax.set(xscale="log", xlabel="miss [cm]", ylabel="first strikes [%]", ylim=(0, 102))
        ax.xaxis.set_major_formatter("{x:g}")
        ax.legend()
    return figure


def _goals(
    first: Mapping[str, Struck], others: Mapping[str, Struck], looks: Mapping[str, Sequence[Mapping[str, Any]]]
) -> list[list[str]]:
    rows = [["", "goal", "seen", "met"]]

    def add(what: str, goal: float, value: float, *, least: bool = False) -> None:
        met = value >= goal if least else value <= goal
        rows.append([what, f"{'>=' if least else '<='} {goal:g}", f"{value:.3g}", "yes" if met else "no"])

    for family, strikes in first.items():
        if not strikes:
            continue
        miss, hits = column(strikes, "miss"), np.array([x["hit"] for x in strikes])
        add(f"{family}: within 5 cm at the first strike", POINT_GOAL, float(np.mean(miss <= NEAR)), least=True)
        add(f"{family}: within 5 cm and 10 degrees", AIMED_GOAL, float(hits.mean()), least=True)
        add(f"{family}: median miss [m]", MISS_GOAL, float(np.median(miss)))
        stated = np.array([x["probability"] for x in strikes])
        add(f"{family}: calibration error", CALIBRATION_GOAL, reliability(stated, hits)[1])
        if others.get(family):
            again = column(others[family], "miss")
            add(f"{family}: within 5 cm at further goals", FURTHER_GOAL, float(np.mean(again <= NEAR)), least=True)
    learn = [r["look"]["seconds"] for found in looks.values() for r in found if r["look"]]
    plan = [x["seconds"] for strikes in first.values() for x in strikes]
    add("median time to learn and plan [s]", TIME_GOAL, float(np.median(learn) + np.median(plan)))
    return rows
