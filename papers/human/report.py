"""The report on people and machines: what is worked on, and what it says of people and of the whip."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from papers.human import pictures
from papers.human.bullwhip import Cascade
from papers.human.cascade_fit import (
    DISCRETE,
    Explained,
    Measured,
    fit_cascade,
    measured,
    predicted,
    resampled,
)
from papers.human.findings import PAIRS, PUBLISHED, agrees, all_styles, correlations, in_order
from papers.human.machine_sections import Effort, machine_sections
from papers.human.mixed_models import Effect, MixedModel, chosen_mixed, fit_hits
from papers.human.reading import STYLES, People
from whiptool.comparison.units import Store
from whiptool.viz.report import NOT_REPRODUCED, REPRODUCED, Claim, Claims, Picture, Section, Table, Text

RHYTHMIC = STYLES[1]
UNITS = {
    "min_distance": "m", "peak_hand_speed": "m/s", "peak_tip_speed": "m/s", "duration": "s", "interval": "s",
    "extension": "m", "duration_mean": "s", "min_distance_median": "m", "peak_hand_speed_median": "m/s",
    "peak_tip_speed_median": "m/s", "hit_share": "1",
}  # fmt: skip


def figures_section(people: People, styles: dict[str, dict[str, Any]]) -> Section:
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


def models_section(models: Sequence[MixedModel], hits: Sequence[Effect]) -> Section:
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
        "generalised estimating equations. Mean: discrete style, first block. Style: rhythmic less discrete. Block: "
        "one block later. Their coefficients stand in the paper's text, which this report does not hold."
    )
    return Section("Style and block", [Text(said), Table(rows)])


def _cells(effect: Effect) -> list[str]:
    return [effect.name, f"{effect.value:+.4g}", f"{effect.low:+.4g} to {effect.high:+.4g}", f"{effect.p:.1e}"]


def effect_table(effect: Effect) -> dict[str, Any]:
    return {"effect": effect.name, "value": effect.value, "low": effect.low, "high": effect.high, "p": effect.p}


def model_table(model: MixedModel) -> dict[str, Any]:
    return {
        "quantity": model.quantity,
        "random": list(model.random),
        "between": list(model.between),
        "within": model.within,
        "throws": model.throws,
        "effects": [effect_table(effect) for effect in model.effects],
    }


def correlation_rows(people: People) -> list[dict[str, Any]]:
    rows = []
    for style in STYLES:
        for x, y in PAIRS:
            for kind, one in zip(("between", "within"), correlations(people, style, x, y), strict=True):
                rows.append(
                    {"style": style, "x": x, "y": y, "people": kind, "r": one.r, "low": one.low, "high": one.high}
                )
    return rows


def correlations_section(people: People) -> Section:
    rows = [["style", "of", "with", "people", "r", "95 %"]]
    for one in correlation_rows(people):
        names = [one[name].replace("_", " ") for name in ("x", "y")]
        rows.append(
            [one["style"], *names, one["people"], f"{one['r']:+.2f}", f"{one['low']:+.2f} to {one['high']:+.2f}"]
        )
    return Section("Correlations between people and within them", [Table(rows)])


def whip_section(people: People, resamples: int) -> tuple[dict[str, Any], Section]:
    seen = {style: measured(people, style) for style in STYLES}
    best = fit_cascade(seen[DISCRETE])
    refitted = fit_cascade(seen[DISCRETE], first=best.x, uniform=True)
    bare = best.x.copy()
    bare[-3] = 0.0  # the same path and whip, without the taper
    intervals = resampled(people, best, resamples) if resamples else {}
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
            "A thong clamped to a handle whose end moves with people's mean hand speed. Assumed: one vertical plane, "
            "in which the directions of hand and handle are smooth splines through seven instants. They are fitted "
            "with the whip to the discrete style's peaks and times, its speeds at both ends, the whip's mean shape at "
            "peak hand speed and the target's place. The rhythmic throw repeats the same path with its own speed: "
            "nothing of it is fitted."
        ),
        _numbers_table(best, refitted, intervals),
        Picture(pictures.cascade_picture(seen, models), "Peaks and their times along the whip."),
        Picture(pictures.throw_picture(tapered, seen), "Speeds of the markers of the tapered whip."),
        _off_table(seen, models),
    ]
    return result, Section("The whip of the task", parts)


def _cascades(names: dict[str, np.ndarray], seen: Measured) -> dict[str, Cascade]:
    found = {name: predicted(x, seen.hand) for name, x in names.items()}
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
    rows = [["number", "tapered", "95 % (people resampled)", "uniform, own throw"]]
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


TITLE = "People and machines strike with a whip"
SUBTITLE = (
    "Throws of Krotov, Russo, Nah, Hogan and Sternad 2022 (Royal Society Open Science, doi:10.1098/rsos.220581), a "
    "model of their whip, and strikes that are planned."
)
MODELLED = ("min_distance", "peak_hand_speed", "peak_tip_speed", "duration", "interval", "extension")


def report(people: People, resamples: int, effort: Effort, store: Store) -> tuple[dict[str, Any], list[Section]]:
    """Return the figures as plain data, and the sections of the report.

    Args:
        people: Their data.
        resamples: Number of bootstrap samples of people for the intervals of the whip's numbers.
        effort: Effort of the machines' part.
        store: Where what takes long is kept.
    """
    styles = all_styles(people)
    models, hits = [chosen_mixed(people.throws, quantity) for quantity in MODELLED], fit_hits(people.throws)
    whip, of_whip = whip_section(people, resamples)
    machines, of_machines = machine_sections(people, styles, effort, store)
    same = {style: {name: agrees(style, name, styles[style][name]) for name in PUBLISHED[style]} for style in STYLES}
    result = {
        **styles,
        "agrees": same,
        "mixed_models": [model_table(model) for model in models],
        "hit_odds": [effect_table(effect) for effect in hits],
        "correlations": correlation_rows(people),
        "whip": whip,
        **machines,
    }
    about_people = [figures_section(people, styles), models_section(models, hits), correlations_section(people)]
    return result, [*about_people, of_whip, *of_machines]
