"""The report on people and machines: what is worked on, and what it says."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from whiptool.studies.comparison.store import Store
from whiptool.studies.human import pictures
from whiptool.studies.human.bullwhip import Cascade
from whiptool.studies.human.cascade_fit import (
    DISCRETE,
    RHYTHMIC,
    Explained,
    Measured,
    fit_cascade,
    foretold,
    measured,
    resampled,
)
from whiptool.studies.human.findings import PAIRS, PUBLISHED, agrees, all_styles, correlations, in_order
from whiptool.studies.human.learning import AdaptUnit, Curve, curve, people_misses
from whiptool.studies.human.machine_strikes import METHODS, NOISE, ROBUST, StrikeUnit, by_method, machine, target_of
from whiptool.studies.human.mixed_models import Effect, MixedModel, chosen_mixed, fit_hits
from whiptool.studies.human.reading import STYLES, People
from whiptool.studies.human.tolerance import Costs, Tolerance, costs, tolerance
from whiptool.viz.report import NOT_REPRODUCED, REPRODUCED, Claim, Claims, Picture, Section, Table, Text, verdict_over

TITLE = "People and machines strike with a whip"
SUBTITLE = (
    "Throws of Krotov, Russo, Nah, Hogan and Sternad 2022 (Royal Society Open Science, doi:10.1098/rsos.220581), a model "
    "of their whip, and strikes that are planned."
)
SURE, SURE_SHARE = "sure", 0.95  # noise up to which this share still hits
MODELLED = ("min_distance", "peak_hand_speed", "peak_tip_speed", "duration", "interval", "extension")
UNITS = {
    "min_distance": "m", "peak_hand_speed": "m/s", "peak_tip_speed": "m/s", "duration": "s", "interval": "s",
    "extension": "m", "duration_mean": "s", "min_distance_median": "m", "peak_hand_speed_median": "m/s",
    "peak_tip_speed_median": "m/s", "hit_share": "1",
}  # fmt: skip


@dataclass(frozen=True)
class Plan:
    """How much is worked on.

    Args:
        resamples: People drawn anew for the intervals of the whip's numbers.
        seeds: Of every method that strikes.
        trials: Strikes at most of each search.
        whips: Unknown whips that are adapted to.
        draws: Noisy strikes of each size.
    """

    resamples: int
    seeds: int
    trials: int
    whips: int
    draws: int


def report(people: People, plan: Plan, store: Store) -> tuple[dict[str, Any], list[Section]]:
    """Return the figures as plain data, and the sections of the report.

    Args:
        people: Their data.
        plan: How much is worked on.
        store: Where what takes long is kept.
    """
    styles = all_styles(people)
    models, hits = [chosen_mixed(people.throws, quantity) for quantity in MODELLED], fit_hits(people.throws)
    whip, of_whip = _whip(people, plan)
    machines, of_machines = _machines(people, styles, plan, store)
    result = {
        **styles,
        "agrees": {
            style: {name: agrees(style, name, styles[style][name]) for name in PUBLISHED[style]} for style in STYLES
        },
        "mixed_models": [_model_table(model) for model in models],
        "hit_odds": [_effect_table(effect) for effect in hits],
        "correlations": _correlation_rows(people),
        "whip": whip,
        **machines,
    }
    sections = [_figures(people, styles), _models(models, hits), _correlations(people), *of_whip, *of_machines]
    return result, sections


def hit_radius(people: People) -> float:
    """Return the distance within which as many throws pass as hit [m]."""
    return float(people.throws["min_distance"].quantile(float(people.throws["hit"].mean())))


def _figures(people: People, styles: dict[str, dict[str, Any]]) -> Section:
    rows = [["figure", "style", "published", "ours", "same to the last digit"]]
    for style in STYLES:
        for name, (printed, digits) in PUBLISHED[style].items():
            value = styles[style][name]
            said = "yes" if agrees(style, name, value) else "no"
            unit = UNITS[name]
            rows.append([f"{name.replace('_', ' ')} [{unit}]", style, f"{printed:.{digits}f}", f"{value:.4g}", said])
    of_blocks = [["style", "block", "minimal distance [m]", "hits [%]", "hand [m/s]", "tip [m/s]", "duration [s]"]]
    for style in STYLES:
        for block in styles[style]["blocks"]:
            numbers = [f"{block['min_distance_median']:.3f}", f"{100 * block['hit_share']:.1f}"]
            numbers += [f"{block[f'peak_{who}_speed_median']:.1f}" for who in ("hand", "tip")]
            of_blocks.append([style, str(block["block"]), *numbers, f"{block['duration_mean']:.3f}"])
    return Section(
        "What they print",
        [
            Table(rows),
            Claims([_cascade_claim(people), _prediction_claim(people)]),
            Table(of_blocks, "Medians, shares and means of all throws of a block."),
            Picture(pictures.blocks_picture(people), "Block by block: people (points) and their medians."),
        ],
    )


def _cascade_claim(people: People) -> Claim:
    counts = {style: in_order(people, style) for style in STYLES}
    means = {style: np.mean([one.peaks for one in people.of_style(style)], axis=0) for style in STYLES}
    holds = all((np.diff(peaks) < 0).all() for peaks in means.values())
    said = "; ".join(
        f"{style} in {faster} people, and in {later} one after the other" for style, (faster, later) in counts.items()
    )
    return Claim(
        "In both styles the whip unfolds as a cascade",
        "abstract, Fig. 6",
        f"mean peaks fall from tip to hand in both styles; marker by marker: {said}, of 16",
        REPRODUCED if holds else NOT_REPRODUCED,
        "Means over people of the largest mean speed of each marker.",
    )


def _prediction_claim(people: People) -> Claim:
    found = {
        (style, x): correlations(people, style, x, "min_distance")[1]
        for style in STYLES
        for x in ("extension", "whip_azimuth")
    }
    rhythmic = [found[RHYTHMIC, x] for x in ("extension", "whip_azimuth")]
    holds = all(one.low > 0 or one.high < 0 for one in rhythmic)
    said = ", ".join(
        f"{style} {x.replace('_', ' ')} {one.r:+.2f} ({one.low:+.2f} to {one.high:+.2f})"
        for (style, x), one in found.items()
    )
    return Claim(
        "Extension and orientation of the whip at peak hand speed predict the error, at least in the rhythmic style",
        "abstract",
        f"correlations with the minimal distance within people: {said}",
        REPRODUCED if holds else NOT_REPRODUCED,
        "Both intervals of the rhythmic style leave out 0.",
    )


def _models(models: Sequence[MixedModel], hits: Sequence[Effect]) -> Section:
    rows = [["quantity", "people differ in", "effect", "value", "95 %", "p"]]
    for model in models:
        for effect in model.effects:
            rows.append(
                [
                    f"{model.quantity.replace('_', ' ')} [{UNITS[model.quantity]}]",
                    ", ".join(model.random),
                    *_cells(effect),
                ]
            )
    rows += [["hit [log odds]", "mean", *_cells(effect)] for effect in hits]
    said = (
        "Linear mixed models by maximum likelihood, their terms chosen by likelihood ratios as theirs were; of hits "
        "generalised estimating equations. Mean: discrete style, first block. Style: rhythmic less discrete. Block: one "
        "block later. Their coefficients stand in the paper's text, which this report does not hold."
    )
    return Section("Style and block", [Text(said), Table(rows)])


def _cells(effect: Effect) -> list[str]:
    return [effect.name, f"{effect.value:+.4g}", f"{effect.low:+.4g} to {effect.high:+.4g}", f"{effect.p:.1e}"]


def _effect_table(effect: Effect) -> dict[str, Any]:
    return {"effect": effect.name, "value": effect.value, "low": effect.low, "high": effect.high, "p": effect.p}


def _model_table(model: MixedModel) -> dict[str, Any]:
    return {
        "quantity": model.quantity,
        "random": list(model.random),
        "between": list(model.between),
        "within": model.within,
        "throws": model.throws,
        "effects": [_effect_table(effect) for effect in model.effects],
    }


def _correlation_rows(people: People) -> list[dict[str, Any]]:
    rows = []
    for style in STYLES:
        for x, y in PAIRS:
            for kind, one in zip(("between", "within"), correlations(people, style, x, y), strict=True):
                rows.append(
                    {"style": style, "x": x, "y": y, "people": kind, "r": one.r, "low": one.low, "high": one.high}
                )
    return rows


def _correlations(people: People) -> Section:
    rows = [["style", "of", "with", "people", "r", "95 %"]]
    for one in _correlation_rows(people):
        names = [one[name].replace("_", " ") for name in ("x", "y")]
        rows.append(
            [one["style"], *names, one["people"], f"{one['r']:+.2f}", f"{one['low']:+.2f} to {one['high']:+.2f}"]
        )
    return Section("Correlations between people and within them", [Table(rows)])


def _whip(people: People, plan: Plan) -> tuple[dict[str, Any], list[Section]]:
    seen = {style: measured(people, style) for style in STYLES}
    best = fit_cascade(seen[DISCRETE])
    refitted = fit_cascade(seen[DISCRETE], first=best.x, uniform=True)
    bare = best.x.copy()
    bare[-3] = 0.0  # the same path and whip, but for the taper
    intervals = resampled(people, best, plan.resamples) if plan.resamples else {}
    names = {"tapered": best.x, "uniform, same throw": bare, "uniform, own throw": refitted.x}
    models = {style: _cascades(names, seen[style]) for style in STYLES}
    result = {
        "numbers": best.numbers,
        "intervals": {name: list(interval) for name, interval in intervals.items()},
        "costs": {"tapered": best.cost, "uniform": refitted.cost},
        **{style: {name: _off(one, seen[style]) for name, one in models[style].items()} for style in STYLES},
    }
    tapered = {style: models[style]["tapered"] for style in STYLES if "tapered" in models[style]}
    parts = [
        Text(
            "A clamped thong on a handle whose end moves with people's mean hand speed. Assumed: one vertical plane, the "
            "directions of hand and handle smooth splines through seven instants; they are fitted with the whip to the "
            "discrete style's peaks and times, its speeds at both ends, the whip's mean shape at peak hand speed and the "
            "target's place. The rhythmic throw repeats the same path with its own speed: nothing of it is fitted."
        ),
        _numbers_table(best, refitted, intervals),
        Picture(pictures.cascade_picture(seen, models), "Peaks and their times along the whip."),
        Picture(pictures.throw_picture(tapered, seen), "Speeds of the markers of the tapered whip."),
        _off_table(seen, models),
    ]
    return result, [Section("The whip of the task", parts)]


def _cascades(names: dict[str, np.ndarray], seen: Measured) -> dict[str, Cascade]:
    found = {name: foretold(x, seen.hand) for name, x in names.items()}
    return {name: one for name, one in found.items() if one is not None}


def _off(one: Cascade, seen: Measured) -> dict[str, list[float]]:
    return {
        "peaks": one.peaks.tolist(),
        "peaks_off": (one.peaks / seen.peaks - 1).tolist(),
        "times": one.times.tolist(),
        "times_off": (one.times - seen.times).tolist(),
    }


def _numbers_table(best: Explained, uniform: Explained, intervals: dict[str, tuple[float, float]]) -> Table:
    words = {
        "stiffness": "EI at the handle, for 0.3 kg/m there [N m²]",
        "taper": "diameter at the tip over that at the handle",
        "damping_time": "damping over stiffness [s]",
        "grip": "from hand to thong [m]",
    }
    rows = [["number", "tapered", "95 % (people drawn anew)", "uniform, own throw"]]
    for name, said in words.items():
        interval = " to ".join(f"{x:.3g}" for x in intervals[name]) if intervals else "not computed"
        rows.append([said, f"{best.numbers[name]:.3g}", interval, f"{uniform.numbers[name]:.3g}"])
    rows.append(["half the sum of squared residuals", f"{best.cost:.1f}", "", f"{uniform.cost:.1f}"])
    return Table(rows)


def _off_table(seen: dict[str, Measured], models: dict[str, dict[str, Cascade]]) -> Table:
    rows = [["style", "whip", "peaks off, largest [%]", "peaks within 10 %", "times off, largest", "times within 0.05"]]
    for style, of in models.items():
        for name, one in of.items():
            off = _off(one, seen[style])
            peaks, times = np.abs(off["peaks_off"]), np.abs(off["times_off"])
            counts = [f"{int((x <= y).sum())} of {len(x)}" for x, y in ((peaks, 0.1), (times, 0.05))]
            rows.append([style, name, f"{100 * peaks.max():.1f}", counts[0], f"{times.max():.3f}", counts[1]])
    return Table(rows, "Ten markers; the eleventh is the hand, whose speed drives the whip.")


def _machines(
    people: People, styles: dict[str, dict[str, Any]], plan: Plan, store: Store
) -> tuple[dict[str, Any], list[Section]]:
    radius = hit_radius(people)
    units = [
        StrikeUnit(method=method, seed=seed, hit_radius=radius, trials=plan.trials)
        for method, search in METHODS.items()
        for seed in range(1 if search == "directl" else plan.seeds)
    ]
    adapted = [AdaptUnit(seed=seed, hit_radius=radius) for seed in range(plan.whips)]
    results = store.results([*units, *adapted], desc="human")
    found = [results[unit.name] for unit in units]
    strikes, rollout, target = by_method(found), machine(), target_of(radius)
    tolerances = {method: tolerance(rollout, target, of, draws=plan.draws) for method, of in strikes.items()}
    shares = {style: styles[style]["hit_share"] for style in STYLES}
    size = _common_noise(tolerances, shares[DISCRETE])
    places = [strike for of in strikes.values() for strike in of]
    lost = {method: [costs(rollout, target, one, places, size=size) for one in of] for method, of in strikes.items()}
    rows = [_tolerance_row(method, tolerances[method], lost[method], found, shares) for method in tolerances]
    curves = [curve(f"people, {style}", people_misses(people, style)) for style in STYLES]
    curves.append(curve("SAC", [one["misses"] for one in found if one["method"] == "SAC"]))
    if adapted:
        curves.append(curve("adapt, unknown whips", [results[unit.name]["misses"] for unit in adapted]))
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
        f"normal noise of one size is put on every number of the strike [rad, s]; the robust planner minimises the root "
        f"mean square miss under {NOISE:g}. Costs as in Cohen and Sternad 2009, at noise {size:.3f}. "
        "A person's throw also errs by what no number of a strike tells, so that equivalent noise is an upper bound of theirs."
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
                "Noise [rad, s] at which the machine hits as rarely as people do in a style, and at which 95 % still hit.",
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
