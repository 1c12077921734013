"""The report's sections on machines: how much noise their strikes bear, and how they learn compared with people."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from papers.human import pictures
from papers.human.machine_strikes import (
    METHODS,
    NOISE,
    ROBUST,
    AdaptUnit,
    Curve,
    StrikeUnit,
    by_method,
    curve,
    machine,
    people_misses,
    target_of,
)
from papers.human.reading import STYLES, People
from papers.human.tolerance_costs import EXECUTIONS, Costs, Tolerance, costs, tolerance
from whiptool.comparison.units import Store
from whiptool.viz.report import Claim, Claims, Picture, Section, Table, Text, verdict_over

DISCRETE = STYLES[0]
SURE, SURE_SHARE = "sure", 0.95  # noise up to which this share still hits


@dataclass(frozen=True)
class Effort:
    """How much is worked on.

    Args:
        seeds: Seeds of every method that strikes.
        trials: Strikes at most of each search.
        whips: Unknown whips that are adapted to.
        draws: Noisy strikes of each size.
    """

    seeds: int
    trials: int
    whips: int
    draws: int


def hit_radius(people: People) -> float:
    """Return the distance within which as many throws pass as hit [m]."""
    return float(people.throws["min_distance"].quantile(float(people.throws["hit"].mean())))


def machine_sections(
    people: People, styles: dict[str, dict[str, Any]], effort: Effort, store: Store
) -> tuple[dict[str, Any], list[Section]]:
    radius = hit_radius(people)
    units = [
        StrikeUnit(method=method, seed=seed, hit_radius=radius, trials=effort.trials)
        for method, search in METHODS.items()
        for seed in range(1 if search == "directl" else effort.seeds)
    ]
    adapted = [AdaptUnit(seed=seed, hit_radius=radius) for seed in range(effort.whips)]
    results = store.results([*units, *adapted], desc="human")
    found = [results[unit.key] for unit in units]
    strikes, rollout, target = by_method(found), machine(), target_of(radius)
    tolerances = {method: tolerance(rollout, target, of, draws=effort.draws) for method, of in strikes.items()}
    shares = {style: styles[style]["hit_share"] for style in STYLES}
    executions = min(effort.draws, EXECUTIONS)
    size = _common_noise(tolerances, shares[DISCRETE])
    places = [strike for of in strikes.values() for strike in of]
    lost = {
        method: [costs(rollout, target, one, places, size=size, executions=executions) for one in of]
        for method, of in strikes.items()
    }
    rows = [_tolerance_row(method, tolerances[method], lost[method], found, shares) for method in tolerances]
    curves = [curve(f"people, {style}", people_misses(people, style)) for style in STYLES]
    curves.append(curve("SAC", [one["misses"] for one in found if one["method"] == "SAC"]))
    if adapted:
        curves.append(curve("adapt, unknown whips", [results[unit.key]["misses"] for unit in adapted]))
    result = {"hit_radius": radius, "noise": size, "tolerance": rows, "learning": [_curve_row(one) for one in curves]}
    sections = [_tolerance_section(tolerances, lost, rows, shares, radius, size), _learning_section(curves)]
    return result, sections


def _common_noise(found: dict[str, Tolerance], share: float) -> float:
    """Return the noise at which costs are compared: the median of what methods bear."""
    return float(np.median([of.equivalent_noise(share) for of in found.values()]))


def _tolerance_row(
    method: str, of: Tolerance, lost: Sequence[Costs], found: Sequence[dict[str, Any]], shares: dict[str, float]
) -> dict[str, Any]:
    mine = [one for one in found if one["method"] == method]
    row: dict[str, Any] = {"method": method, "strikes": [one["strike"] for one in mine]}
    row["miss_distance"] = [one["miss_distance"] for one in mine]
    row["tip_speed"] = [one["tip_speed"] for one in mine]
    row["sensitivity"] = of.sensitivity.mean(axis=0).tolist()
    for name, share in {**shares, SURE: SURE_SHARE}.items():
        row[f"equivalent_noise_{name}"] = of.equivalent_noise(share)
        row[f"equivalent_noise_{name}_interval"] = list(of.interval(share))
    for part in ("miss", "tolerance", "noise", "covariation"):
        row[f"{part}_cost" if part != "miss" else "noisy_miss"] = float(np.mean([getattr(one, part) for one in lost]))
    return row


def _tolerance_section(
    found: dict[str, Tolerance],
    lost: dict[str, list[Costs]],
    rows: Sequence[dict[str, Any]],
    shares: dict[str, float],
    radius: float,
    size: float,
) -> Section:
    said = (
        f"Each method strikes at one target with the paper's arm and whip and keeps the best of its trials; a hit is "
        f"within {100 * radius:.1f} cm, the distance within which as many of people's throws pass as hit. Independent "
        f"normal noise of one size is put on every number of the strike [rad, s]; the robust planner minimises the "
        f"root mean square miss under {NOISE:g}. Costs as in Cohen and Sternad 2009, at noise {size:.3f}. "
        "In this plane a path comes near a point far more often than in space, where people throw: equivalent noise "
        "orders the machine's strikes, and is no measure of people's noise. A strike that diverges counts as the "
        "farthest miss that there is."
    )
    table = [["method", "strikes", "discrete", "95 %", "rhythmic", "95 %", "95 % hit", "95 %", "tip speed [m/s]"]]
    sensitivity = [["method", "q_si [m/rad]", "q_ei [m/rad]", "q_sf [m/rad]", "q_ef [m/rad]", "D [m/s]"]]
    parts = [["method", "mean miss [cm]", "tolerance [cm]", "noise [cm]", "covariation [cm]"]]
    places = [["method", "q_si [rad]", "q_ei [rad]", "q_sf [rad]", "q_ef [rad]", "D [s]"]]
    for row in rows:
        cells = [row["method"], str(len(row["strikes"]))]
        for name in (*shares, SURE):
            low, high = row[f"equivalent_noise_{name}_interval"]
            cells += [f"{row[f'equivalent_noise_{name}']:.3f}", f"{low:.3f} to {high:.3f}"]
        speeds = row["tip_speed"]
        table.append([*cells, f"{min(speeds):.1f} to {max(speeds):.1f}"])
        sensitivity.append([row["method"], *(f"{x:.2f}" for x in row["sensitivity"])])
        costs_of = [row["noisy_miss"], row["tolerance_cost"], row["noise_cost"], row["covariation_cost"]]
        parts.append([row["method"], *(f"{100 * x:.1f}" for x in costs_of)])
        both = zip(np.min(row["strikes"], axis=0), np.max(row["strikes"], axis=0), strict=True)
        places.append([row["method"], *(f"{low:.2f} to {high:.2f}" for low, high in both)])
    return Section(
        "Tolerance, noise, covariation",
        [
            Text(said),
            Claims([robust_claim(rows)]),
            Table(
                table,
                "Noise [rad, s] at which the machine hits as rarely as people in a style, and at which 95 % hit.",
            ),
            Picture(pictures.tolerance_picture(found, shares), "Share of hits under noise."),
            Table(sensitivity, "Root mean square miss per noise in one number alone."),
            Table(parts, "What is lost of the mean miss distance."),
            Picture(pictures.costs_picture(lost), "Costs; points are strikes."),
            Table(places, "Where the strikes lie."),
        ],
    )


def robust_claim(rows: Sequence[dict[str, Any]]) -> Claim:
    """Return whether the robust planner's strikes bear the most noise, by each way of telling it."""
    said, holds, apart = [], {}, {}
    for name, words in ((SURE, "95 % hit"), (DISCRETE, "as rarely as people, discrete")):
        key = f"equivalent_noise_{name}"
        robust = next(row for row in rows if row["method"] == ROBUST)
        next_best = max((row for row in rows if row["method"] != ROBUST), key=lambda row: row[key])
        holds[words] = robust[key] > next_best[key]
        apart[words] = robust[f"{key}_interval"][0] > next_best[f"{key}_interval"][1]
        said.append(f"{words}: robust {robust[key]:.3f}, best other {next_best['method']} {next_best[key]:.3f}")
    beyond = [words for words, clear in apart.items() if clear]
    return Claim(
        "The robust planner's strikes are the most tolerant",
        "expected",
        "; ".join(said),
        verdict_over(holds),
        "The intervals lie apart where " + " and ".join(beyond) if beyond else "The intervals overlap.",
    )


def _learning_section(curves: Sequence[Curve]) -> Section:
    rows = [["who", "learners", "first bin [m]", "last bin [m]", "last over first"]]
    for one in curves:
        ends = [f"{one.median[i]:.3f} ({one.low[i]:.3f} to {one.high[i]:.3f})" for i in (0, -1)]
        rows.append([one.label, str(one.learners), *ends, f"{one.median[-1] / one.median[0]:.2f}"])
    said = (
        "People throw at their target with a whip that they never held; SAC knows nothing and strikes at the machine's "
        "target; adaptation begins with a model of whips, looks at the hanging whip and plans each strike."
    )
    return Section(
        "Learning", [Text(said), Table(rows), Picture(pictures.learning_picture(curves), "Median miss distance.")]
    )


def _curve_row(one: Curve) -> dict[str, Any]:
    return {
        "label": one.label,
        "learners": one.learners,
        "trial": one.trial.tolist(),
        "median": one.median.tolist(),
        "low": one.low.tolist(),
        "high": one.high.tolist(),
    }
