"""The report's sections on people: their figures next to those printed, style and block, correlations."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from papers.human import pictures
from papers.human.findings import PAIRS, PUBLISHED, agrees, correlations, in_order
from papers.human.mixed_models import Effect, MixedModel
from papers.human.reading import STYLES, People
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
