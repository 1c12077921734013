"""Tables of a comparison: CSV for programs, Markdown for people."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence

from whiptool.comparison.learner_unit import MAIN_CONVENTION
from whiptool.comparison.series import Series


def as_csv(series: Sequence[Series]) -> str:
    """Every series as a line, at full precision."""
    text = io.StringIO()
    rows = [one.row() for one in series]
    writer = csv.DictWriter(text, list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()


def main_table(series: Sequence[Series]) -> list[list[str]]:
    """Header and rows: every method at the widest hit radius, learners with the mean action first."""
    header = [
        "method",
        "mean trials",
        "95 % interval",
        "median",
        "largest",
        "hit",
        "seeds",
        "training trials",
        "time [s]",
    ]
    radius = series[0].hit_radius
    return [header, *(_row(one) for one in series if one.main and one.hit_radius == radius)]


def _row(one: Series) -> list[str]:
    low, high = one.interval
    row = one.row()
    return [
        one.label,
        figure(one.mean),
        f"{figure(low)} to {figure(high)}",
        f"{row['median_trials']:g}",
        f"{row['largest']}",
        percent(row["share_hit"]),
        f"{row['seeds']}",
        f"{one.training_trials:,.0f}",
        f"{one.wall_time:.1f}",
    ]


def radius_table(series: Sequence[Series]) -> list[list[str]]:
    """Header and rows: mean trials and share of targets hit at every hit radius."""
    radii = list(dict.fromkeys(one.hit_radius for one in series))
    rows: dict[str, list[str]] = {}
    for one in series:
        if one.main:
            rows.setdefault(one.label, [one.label]).append(f"{figure(one.mean)} ({percent(one.hit.mean())})")
    return [["mean trials (hit)", *(f"{radius:g} m" for radius in radii)], *rows.values()]


def convention_table(series: Sequence[Series]) -> list[list[str]]:
    """Header and rows: mean trials and share of targets hit of the learners, by what the policy does after a miss."""
    learned = [one for one in series if one.learned and one.hit_radius == series[0].hit_radius]
    conventions = list(dict.fromkeys(one.convention for one in learned))
    rows: dict[str, list[str]] = {}
    for one in learned:
        rows.setdefault(one.label, [one.label]).append(f"{figure(one.mean)} ({percent(one.hit.mean())})")
    return [["mean trials (hit)", *conventions], *rows.values()]


def as_markdown(table: Sequence[Sequence[str]]) -> str:
    """A table in Markdown, its columns aligned."""
    widths = [max(len(row[i]) for row in table) for i in range(len(table[0]))]
    lines = [
        "| " + " | ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)) + " |" for row in table
    ]
    lines.insert(1, "|" + "|".join("-" * (width + 2) for width in widths) + "|")
    return "\n".join(lines)


def figure(value: float) -> str:
    """A mean number of trials for people; 1 only where every target was hit at the first strike."""
    value = round(value, 9)  # a mean of ones may not be one
    return f"{value:.4f}" if 1 < value < 1.01 else f"{value:.3g}" if value < 10 else f"{value:.1f}"


def percent(share: float) -> str:
    """A share for people; 100 % only where it is all."""
    return "100 %" if share == 1 else f"{min(100 * share, 99.9):.1f} %"


CONVENTION_NOTE = f"Learners strike with the policy's mean action first, after a miss with samples ({MAIN_CONVENTION})."
