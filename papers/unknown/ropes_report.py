"""Unknown ropes on a UR5e: how often the first strike after one wiggle hits, family by family."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from papers.context import Context
from papers.unknown.rope_swings import IN_SPACE, ROPE, families
from papers.unknown.ropes import MATERIALS, RopeStudy, RopeUnit, UnseenRopeUnit, WiggleUnit
from papers.unknown.trials import reliability
from whiptool.viz.plots import COLORS, STYLE
from whiptool.viz.report import Picture, Section, Table, Text
from whiptool.words import counted, fixed, rounded

NEAR, CONE = 0.05, math.radians(10)  # [m], [rad] of a hit
FURTHER = 20  # goals at which the first rope of each family is struck in addition
UNSEEN, FILMED = 10, 10  # ropes of each family that are struck without a wiggle, and whose wiggle is filmed
_FILMED = (
    "The wiggle in rendered images: two cameras of 848 x 480 pixels at 60 frames a second, 3 m away, follow a bright "
    "ball at the tip at the same instants; its places come from both views."
)
POINT_GOAL, AIMED_GOAL, MISS_GOAL, CALIBRATION_GOAL, TIME_GOAL, FURTHER_GOAL = 0.99, 0.90, 0.01, 0.1, 5.0, 0.98
_LINES: dict[str, str] = dict(zip(IN_SPACE, ("blue", "orange", "vermilion", "black"), strict=True))
Struck = Sequence[Mapping[str, Any]]
ByFamily = Mapping[str, Sequence[Mapping[str, Any]]]


def sections(context: Context) -> list[Section]:
    """What was run, hits, misses, goals."""
    study = RopeStudy(thorough=not context.quick)
    tried = families(("kin", ROPE) if context.quick else IN_SPACE)
    ropes, count = (1, 1) if context.quick else (context.whips, context.whip_targets)
    further, unseen, films = (0, 1, 0) if context.quick else (FURTHER, min(ropes, UNSEEN), min(ropes, FILMED))
    used = sorted({MATERIALS[seed % len(MATERIALS)] for seed in range(ropes)})
    wiggles = {material: WiggleUnit(study=study, material=material) for material in used}
    known = context.results([*wiggles.values()], "wiggles")

    def unit(family: str, seed: int, **how: Any) -> RopeUnit:
        wiggle = known[wiggles[study.rope(family, seed).material].key]["strike"]
        return RopeUnit(study=study, family=family, seed=seed, wiggle=tuple(wiggle), **how)

    def results(what: str, number: int, make: Callable[..., Any], **how: Any) -> ByFamily:
        # a killed run has about as many of each family
        work = [make(family, seed, **how) for seed in range(number) for family in tried]
        found = context.results(work, what)
        return {f: [found[u.key] for u in work if u.family == f] for f in tried}

    by_family = results("unknown ropes", ropes, unit, count=count)
    again = results("further goals", 1 if further else 0, unit, first=count, count=further)
    filmed = results("filmed ropes", films, unit, count=count, films=True)
    alone = results("without a wiggle", unseen, lambda f, s: UnseenRopeUnit(study=study, family=f, seed=s))
    first = {f: [x for r in found for x in r["struck"]] for f, found in by_family.items()}
    tables = [Table(_hits(by_family), "The first strike at each goal; medians, and 95th percentiles in brackets.")]
    for found, words in (
        (again, "Further goals, with the same knowledge."),
        (filmed, _FILMED),
        (_first_strikes(alone), "Without a wiggle: the first strike at a goal, of the material alone."),
        (alone, "Without a wiggle: the second strike at the same goal, after motion capture saw the first."),
    ):
        if any(found.values()):
            tables.append(Table(_hits(found), words))
    return [
        Section(
            "Unknown ropes in space, one wiggle, then one strike a goal",
            [
                Text(_about(ropes, count, tried)),
                tables[0],
                Picture(_misses(first), "Share of first strikes that miss by no more; dashed: the hit radius."),
                *tables[1:],
            ],
        ),
        Section("Goals", [Table(_goals(by_family, again, filmed, alone), judges=True)]),
    ]


def _struck(found: Sequence[Mapping[str, Any]]) -> Struck:
    """All strikes of some ropes."""
    return [x for r in found for x in r["struck"]]


def _first_strikes(alone: ByFamily) -> ByFamily:
    """The first strikes at ropes without a wiggle, from which nothing had been learned."""
    return {f: [{"look": None, "struck": [r["first"]]} for r in found] for f, found in alone.items()}


def _about(ropes: int, count: int, tried: Sequence[str]) -> str:
    missing = " rope is left out: PyElastica is not installed (pip install 'whiptool[oracle]')."
    left_out = "" if ROPE in tried else missing
    return (
        f"{counted(ropes, 'rope')} of each family on a UR5e with a stick of 0.65 m, of {', '.join(MATERIALS)} in turn, "
        "drawn by seed from what data sheets say of each (whiptool.adaptation.materials); the prior is that of the "
        "material. kin: uniform, in rods. strange: 36 rods, a cone with random deviations, a bead, a soft joint, "
        "springs that stiffen, less drag along than across, uneven friction, a late clock. stranger: twice that. rope: "
        "a Cosserat rod in PyElastica, tapered, that stretches and twists, with drag, a knot at its end and a late "
        "clock. Motion capture sees the tip 100 times a second with 2 mm noise in one wiggle, and nothing else; then "
        f"one strike at each of {counted(count, 'goal')} of “Point It, Strike It” (2026) that lie within reach: within "
        "5 cm, within 10 degrees, at 1 m/s or more, all limits of the robot kept, arm, rope and floor clear of each "
        "other."
        f"{left_out} For comparison, on real ropes after eight calibration swings: 87 % within 5 cm, 52 % within 5 cm "
        "and 10 degrees."
    )


def _hits(by_family: ByFamily) -> list[list[str]]:
    head = ["family", "ropes", "strikes", "within 5 cm", "and 10 degrees", "miss [cm]", "angle [deg]"]
    rows = [[*head, "stated", "calibration error", "not reached on the mean, or not allowed", "learn [s]", "plan [s]"]]
    for family, found in by_family.items():
        strikes = _struck(found)
        if not strikes:
            continue
        miss, angle = column(strikes, "miss"), np.degrees(column(strikes, "angle"))
        stated = np.array([x["probability"] for x in strikes])
        error = reliability(stated, np.array([x["hit"] for x in strikes]))[1]
        seconds = [r["look"]["seconds"] for r in found if r["look"]]
        rows.append(
            [
                family,
                str(len(found)),
                str(len(strikes)),
                f"{100 * np.mean(miss <= NEAR):.0f} %",
                f"{100 * np.mean([x['hit'] for x in strikes]):.0f} %",
                _spread(100 * miss),
                _spread(angle),
                f"{100 * stated.mean():.0f} %",
                f"{error:.3f}",
                str(sum(x["mean_miss"] is None or x["mean_miss"] > NEAR or not x["allowed"] for x in strikes)),
                _spread(np.array(seconds)) if seconds else "",
                _spread(column(strikes, "seconds")),
            ]
        )
    return rows


def column(strikes: Struck, name: str) -> np.ndarray:
    """Return a number of each strike; infinite where it is not known."""
    return np.array([np.inf if x[name] is None else x[name] for x in strikes], float)


def _spread(values: np.ndarray) -> str:
    middle, high = np.median(values), np.percentile(values, 95, method="higher")
    return " ".join(
        form.format(rounded(x, 2) if x < 99.5 else fixed(x, 0)) for x, form in ((middle, "{}"), (high, "({})"))
    )


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


def _goals(by_family: ByFamily, again: ByFamily, filmed: ByFamily, alone: ByFamily) -> list[list[str]]:
    rows = [["", "goal", "seen", "met"]]

    def add(what: str, goal: float, value: float, *, least: bool = False) -> None:
        met = value >= goal if least else value <= goal
        rows.append([what, f"{'>=' if least else '<='} {goal:g}", rounded(value), "yes" if met else "no"])

    def add_hits(family: str, found: ByFamily, when: str) -> None:
        if strikes := _struck(found.get(family, [])):
            near = float(np.mean(column(strikes, "miss") <= NEAR))
            add(f"{family}: within 5 cm {when}", POINT_GOAL, near, least=True)
            hits = float(np.mean([x["hit"] for x in strikes]))
            add(f"{family}: within 5 cm and 10 degrees {when}", AIMED_GOAL, hits, least=True)

    for family, found in by_family.items():
        if not (strikes := _struck(found)):
            continue
        add_hits(family, by_family, "at the first strike")
        add(f"{family}: median miss [m]", MISS_GOAL, float(np.median(column(strikes, "miss"))))
        stated, hits = (np.array([x[name] for x in strikes]) for name in ("probability", "hit"))
        add(f"{family}: calibration error", CALIBRATION_GOAL, reliability(stated, hits)[1])
        if more := _struck(again.get(family, [])):
            add(
                f"{family}: within 5 cm at further goals",
                FURTHER_GOAL,
                float(np.mean(column(more, "miss") <= NEAR)),
                least=True,
            )
        add_hits(family, filmed, "at the first strike, filmed")
        add_hits(family, alone, "at the second strike, without a wiggle")
    learn = [r["look"]["seconds"] for found in by_family.values() for r in found if r["look"]]
    plan = [x["seconds"] for found in by_family.values() for x in _struck(found)]
    add("median time to learn and plan [s]", TIME_GOAL, float(np.median(learn) + np.median(plan)))
    return rows
