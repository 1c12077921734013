"""The report of this reproduction: what is worked on, and what it says."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from papers.context import Context
from papers.nah2023 import claims, pictures, published
from papers.nah2023.claims import Share
from papers.nah2023.nearest import FAR, BesideUnit, EvolutionUnit, ReferenceUnit, TrialsUnit, how_near
from papers.nah2023.units import (
    BOUNDS,
    STAY,
    TIMESTEP,
    DirectUnit,
    GradientUnit,
    PublishedUnit,
    SolutionsUnit,
)
from whiptool.models.presets import NAH2023
from whiptool.models.strike import strike_names
from whiptool.viz.report import Claims, Picture, Section, Table, Text

TITLE = "A person's arm, a whip, and six targets in space"
SUBTITLE = (
    "Nah, Krotov, Russo, Sternad and Hogan 2023 (iScience 26(8), 107395, doi:10.1016/j.isci.2023.107395), their claims "
    "and what was measured here. Verdicts are computed from the data."
)
GRADIENT_CAP = 200
FAR_STARTS = 64  # at full reach, where some lead to nothing
TRIAL_SEEDS, EVOLUTION_SEEDS = 1, 1
_TARGETS = range(len(published.TARGETS))
_FAR = FAR
Results = list[dict[str, Any]]


def sections(context: Context) -> list[Section]:
    """Evaluations, how near the tip comes, the claims on the hand's movement and on sensitivity, conventions."""
    quick = context.quick
    cap = 20 if quick else published.CAP
    by_rule = [DirectUnit(target=i, nodes=published.LAST_NODES, cap=cap) for i in _TARGETS]
    by_tip = [DirectUnit(target=i, nodes=1, cap=cap) for i in _TARGETS]
    gradient = [GradientUnit(target=i, cap=24 if quick else GRADIENT_CAP) for i in _TARGETS]
    solutions = [_solutions(i, quick=quick) for i in _TARGETS]
    known = PublishedUnit(perturbed=4 if quick else published.PERTURBED)
    trials = [_trials(i, quick=quick) for i in _FAR]
    evolution = [_evolution(i, quick=quick) for i in _FAR]
    far = [unit for of_target in [*evolution, *trials] for unit in of_target]
    units = [known, *by_rule, *by_tip, *gradient, *solutions, *far]
    results = context.results(units, "nah2023")
    rule, tip, slopes, found = ([results[u.key] for u in some] for some in (by_rule, by_tip, gradient, solutions))
    tried, evolved = ([[results[u.key] for u in of_target] for of_target in some] for some in (trials, evolution))
    nearest = nearest_strikes(found, tried, evolved)
    beside = [BesideUnit(target=i, strike=tuple(nearest[i]), cap=24 if quick else BesideUnit.cap) for i in _FAR]
    refined = context.results(beside, "nah2023 next to the nearest")
    for unit in beside:
        nearest[unit.target] = np.array(refined[unit.key]["strike"])
    replays = [] if quick else [ReferenceUnit(target=i, strike=tuple(strike)) for i, strike in enumerate(nearest)]
    replayed = context.results(replays, "nah2023 in MuJoCo")
    theirs = results[known.key]
    return [
        _evaluations(rule, tip, slopes),
        _agreement(theirs),
        how_near(found, tried, evolved, [refined[u.key] for u in beside], nearest, [replayed[u.key] for u in replays]),
        _hand(found, theirs),
        _sensitivity(found, theirs),
    ]


def _solutions(target: int, *, quick: bool) -> SolutionsUnit:
    if quick:
        return SolutionsUnit(target=target, random=32, starts=2, kept=2, perturbed=2)
    return SolutionsUnit(target=target, starts=FAR_STARTS) if target in _FAR else SolutionsUnit(target=target)


def _trials(target: int, *, quick: bool) -> list[TrialsUnit]:
    if quick:
        return [TrialsUnit(target=target, seed=0, trials=1, random=32)]
    return [TrialsUnit(target=target, seed=seed) for seed in range(TRIAL_SEEDS)]


def _evolution(target: int, *, quick: bool) -> list[EvolutionUnit]:
    if quick:
        return [EvolutionUnit(target=target, seed=0, cap=16)]
    return [EvolutionUnit(target=target, seed=seed) for seed in range(EVOLUTION_SEEDS)]


def nearest_strikes(found: Results, tried: Sequence[Results], evolved: Sequence[Results]) -> list[np.ndarray]:
    """Return the nearest strike at each target: of the solutions, at full reach also of the trials and CMA-ES."""
    nearest = []
    for i, solutions in enumerate(found):
        also = [] if i not in _FAR else [*tried[i - _FAR.start], *evolved[i - _FAR.start]]
        ends = [(solutions["misses"][0], solutions["strikes"][0]), *((r["ends"][0], r["strikes"][0]) for r in also)]
        nearest.append(np.array(min(ends)[1]))
    return nearest


def facts() -> dict[str, str]:
    """What was run, for the report's head."""
    from whiptool.runs import code_version

    limits = ", ".join(
        f"{name} {low:.3f} to {high:.3f} {'s' if name == 'D' else 'rad'}"
        for name, low, high in zip(strike_names(NAH2023.arm), BOUNDS.lower, BOUNDS.upper, strict=True)
    )
    return {
        "code": f"whiptool {code_version()}",
        "model": f"nah2023: arm of 4 joints, whip of {NAH2023.whip.N} nodes on universal joints; constant impedance "
        "with gravity compensation",
        "bounds of a strike": limits,
        "hit, by their rule": f"any of the last {published.LAST_NODES} nodes within {100 * published.HIT_RADIUS:g} cm "
        f"of the target, until {published.UNTIL:g} s after the movement began",
        "hit, by our convention": f"the tip within {100 * published.HIT_RADIUS:g} cm, until {STAY:g} s after the "
        "movement ended",
        "step": f"{1e3 * TIMESTEP:g} ms",
    }


def _evaluations(rule: Results, tip: Results, gradient: Results) -> Section:
    header = ["target [m]", "published", "any of the last 15 nodes", "smallest distance [m]", "the tip alone"]
    rows = [[*header, "smallest distance [m]", "gradient, tip to 1 mm", "smallest distance [m]"]]
    for i, place in enumerate(published.TARGETS):
        row = [f"{i + 1}: " + " ".join(f"{x:g}" for x in place), _published(i)]
        for result in (rule[i], tip[i], gradient[i]):
            row += [f"{result['evaluations']}" + ("" if result["hit"] else ", no hit"), f"{result['best']:.4f}"]
        rows.append(row)
    about = (
        "DIRECT-L of NLopt from the middle of the box, until the first hit within 5 cm. Their code counts a hit "
        "where any of the last 15 of the 25 nodes comes near enough; by our convention the tip has to. A search that "
        "counts the tip alone minimises another distance, and so tries other strikes. The search by exact gradients "
        f"(random strikes, the best of them followed down) goes on until the tip is within 1 mm, for {GRADIENT_CAP} "
        "rollouts at most."
    )
    caption = "Evaluations until the first hit; a search that does not hit ends at its cap."
    return Section(
        "Evaluations until a target is hit",
        [
            Text(about),
            Table(rows, caption),
            Picture(pictures.convergence(rule, tip), "Smallest distance over the evaluations of DIRECT-L."),
            Claims(claims.evaluations(rule)),
        ],
    )


def _published(i: int) -> str:
    best = published.BEST[i]
    return f"{published.EVALUATIONS[i]}" + (f", no hit ({best:g} m)" if best else "")


def _agreement(theirs: dict[str, Any]) -> Section:
    rows = [["target", *(f"{i + 1}" for i in _TARGETS)]]
    rows.append(["distance of the published strike, by their rule [mm]", *(f"{1e3 * x:.1f}" for x in theirs["misses"])])
    hits = theirs["hit_share"]
    names = {"initial": "initial posture", "final": "final posture", "D": "duration"}
    rows += [[f"hits with noise on the {names[g]}", *(f"{100 * x:.0f} %" for x in hits[g])] for g in names]
    logged, expected = np.array(theirs["logged"]), published.LOGGED - np.array(published.LOGGED_OFFSET)[:, None]
    apart = np.abs(logged - expected)
    log_rows = [["target [m]", "nodes", "median difference [mm]", "within 1 cm", "largest [mm]"]]
    for place, nodes, row in zip(published.LOGGED_TARGETS, published.LOGGED_NODES, apart, strict=True):
        said = [f"{1e3 * np.median(row):.1f}", f"{(row < 0.01).sum()} of {len(row)}", f"{1e3 * row.max():.0f}"]
        log_rows.append([" ".join(f"{x:g}" for x in place), str(nodes), *said])
    about = (
        "The best strikes that the authors publish in their code, to four decimals, in our simulation. A hit is "
        f"within 50 mm; at target 6 they report 101.8 mm. Around each, {published.PERTURBED} strikes with uniform "
        "noise of 5 % of the bounds' width to either side, on the initial posture, the final posture, or the "
        "duration (their cases A, B, C)."
    )
    logs = (
        "Their repository also holds logs of 2021, in which other rules counted: the last 6 nodes at targets 1 to 3, "
        "the tip at targets beyond, these 1 cm farther away. Distances of DIRECT-L's first 19 strikes there and in "
        "our simulation:"
    )
    return Section("The published strikes in our simulation", [Text(about), Table(rows), Text(logs), Table(log_rows)])


def _hits(r: dict[str, Any]) -> np.ndarray:
    """Which of the solutions hit."""
    return np.array(r["misses"]) <= published.HIT_RADIUS


def _by_measure(measures: list[dict[str, Any]]) -> dict[str, np.ndarray]:
    """Values by measure: of the axes, the share along the most compliant."""
    values = {"outside": [m["outside"] for m in measures], "rms": [m["rms"] for m in measures]}
    values |= {name: [m[name][0] for m in measures] for name in ("task", "joint")}
    return {name: np.array(x) for name, x in values.items()}


def _hand(found: Results, theirs: dict[str, Any]) -> Section:
    solutions = [_by_measure([m for m, hit in zip(r["measures"], _hits(r), strict=True) if hit]) for r in found]
    random = [_by_measure(r["random_measures"]) for r in found]
    published_ones = [{name: x[0] for name, x in _by_measure([m]).items()} for m in theirs["measures"]]
    rows = [["target", "solutions", "from the plane [mm]", "random strikes [mm]", "published strike [mm]"]]
    rows[0] += ["random strikes that are planar", "... along the hand's axis", "... along the joints' axis"]
    for i, (s, r, p) in enumerate(zip(solutions, random, published_ones, strict=True)):
        held = (r["outside"] <= claims.PLANAR, r["task"] > claims.HALF, r["joint"] > claims.HALF)
        distances = (s["rms"], r["rms"], p["rms"])
        medians = [f"{1e3 * np.median(x):.1f}" if np.size(x) else "-" for x in distances]
        rows.append([str(i + 1), str(len(s["rms"])), *medians, *(str(Share(int(x.sum()), len(x))) for x in held)])
    about = (
        "Solutions are what the descents led to, where the tip hits within 5 cm. Until D, the hand's places, 60 a "
        "second, are fitted by a plane (least squares), as in the authors' code. The compliance at the hand is J "
        "inv(K) J', with the hand's Jacobian J and the joint stiffness K; its largest principal axis is where the "
        "hand is softest. The share of the hand's squared velocity along it, over the movement, is 1/3 without a "
        "preference. In the joints it is the share of the squared deviation q - q0 from the reference along the "
        "eigenvector of K with the smallest eigenvalue, 1/4 without a preference. The authors show both over time, "
        "and name no number; more than half is what we call predominant. Random strikes from the whole box stand "
        "next to them: what holds of these too, is not owed to the target."
    )
    caption = "Root mean square distance of the hand from the nearest plane, medians; and of random strikes the claims."
    drawn = pictures.distributions(solutions, random, published_ones)
    return Section(
        "The hand's movement",
        [
            Text(about),
            Table(rows, caption),
            Picture(drawn, "Each strike a dot."),
            Claims([claims.planar(solutions), *claims.compliant(solutions)]),
        ],
    )


def _sensitivity(found: Results, theirs: dict[str, Any]) -> Section:
    lower, upper = BOUNDS.box
    raw = [np.array(r["sensitivity"])[_hits(r)] for r in found]
    scaled = [x * (upper - lower) for x in raw]
    noise = [{name: np.array(x)[_hits(r)] for name, x in r["perturbed"].items()} for r in found]
    names = [pictures.short_name(name) for name in strike_names(NAH2023.arm)]
    rows = [["target", *names, "noise: initial", "final", "D [mm]"]]
    for i, (x, n) in enumerate(zip(scaled, noise, strict=True)):
        means = [f"{1e3 * np.median(n[g]):.0f}" if len(n[g]) else "-" for g in ("initial", "final", "D")]
        moved = [f"{v:.2f}" for v in np.median(x, axis=0)] if len(x) else ["-"] * x.shape[1]
        rows.append([str(i + 1), *moved, *means])
    mean = theirs["mean_miss"]
    theirs_said = "; ".join(
        f"target {i + 1}: {1e3 * mean['initial'][i]:.0f}, {1e3 * mean['final'][i]:.0f}, {1e3 * mean['D'][i]:.0f}"
        for i in _TARGETS
    )
    about = (
        "Where a strike hits, the miss distance has a kink, and no derivative. What is taken instead is exact, too: "
        "how far the tip's path moves across its velocity where it passes the target, by each of the nine parameters "
        "(forward mode of CasADi over the whole strike). Per width of the box, as the authors scale their noise, and "
        "per rad and s. Next to it their own experiment: the mean miss under uniform noise of 5 % of the box's width "
        "to either side on the initial posture, on the final posture, and on D."
    )
    after = (
        f"Of the published strikes, by their rule, mean distance [mm] under noise on initial, final, D: {theirs_said}."
    )
    return Section(
        "What a strike is most sensitive to",
        [
            Text(about),
            Table(rows, "How far the path moves [m per width of the box], and mean misses under noise [mm]; medians."),
            Picture(pictures.sensitivities(scaled), "Medians and quartiles over solutions; D is the last."),
            Text(after),
            Claims([claims.sensitive(scaled, raw, noise)]),
        ],
    )
