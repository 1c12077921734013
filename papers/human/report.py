"""The report on people and machines: what is worked on, and what it says."""

from __future__ import annotations

from typing import Any

from papers.human.findings import PUBLISHED, agrees, all_styles
from papers.human.machine_sections import Effort, machine_sections
from papers.human.mixed_models import chosen_mixed, fit_hits
from papers.human.people_sections import (
    correlation_rows,
    correlations_section,
    effect_table,
    figures_section,
    model_table,
    models_section,
)
from papers.human.reading import STYLES, People
from papers.human.whip_section import whip_section
from whiptool.comparison.units import Store
from whiptool.viz.report import Section

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
