"""What Krotov et al. 2022 found, computed again: figures by style and block, correlations, the order of peaks."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.stats import norm

from papers.human.reading import STYLES, People

WITHIN = 0.06  # [m]: the share of throws within this is given, too

# what they print, to the digits that they print
PUBLISHED: dict[str, dict[str, tuple[float, int]]] = {
    "discrete": {
        "min_distance_median": (0.068, 3),
        "hit_share": (0.278, 3),
        "peak_hand_speed_median": (6.0, 1),
        "peak_tip_speed_median": (28.9, 1),
        "duration_mean": (0.579, 3),
    },
    "rhythmic": {
        "min_distance_median": (0.112, 3),
        "hit_share": (0.196, 3),
        "peak_hand_speed_median": (4.5, 1),
        "peak_tip_speed_median": (23.9, 1),
        "duration_mean": (0.490, 3),
    },
}
PAIRS = (
    ("peak_hand_speed", "min_distance"),
    ("peak_tip_speed", "min_distance"),
    ("extension", "min_distance"),
    ("whip_azimuth", "min_distance"),
    ("hand_azimuth", "min_distance"),
    ("peak_hand_speed", "peak_tip_speed"),
)


def summary(people: People, style: str) -> dict[str, Any]:
    """Return the figures of one style; durations are means over people, as theirs.

    Returns:
        Plain data, see the page on JSON output.
    """
    throws = people.throws[people.throws["style"] == style]
    durations = [one.t[-1] for one in people.of_style(style)]
    return {
        "throws": len(throws),
        "people": int(throws["person"].nunique()),
        "min_distance_median": float(throws["min_distance"].median()),
        "hit_share": float(throws["hit"].mean()),
        "within_share": float((throws["min_distance"] <= WITHIN).mean()),
        "peak_hand_speed_median": float(throws["peak_hand_speed"].median()),
        "peak_tip_speed_median": float(throws["peak_tip_speed"].median()),
        "duration_mean": float(np.mean(durations)),
        "interval_median": float(throws["interval"].median()),
        "peak_speeds": np.mean([one.peaks for one in people.of_style(style)], axis=0).tolist(),
        "peak_times": np.mean([one.peak_times for one in people.of_style(style)], axis=0).tolist(),
        "blocks": [
            {
                "block": int(block),
                "min_distance_median": float(rows["min_distance"].median()),
                "hit_share": float(rows["hit"].mean()),
                "peak_hand_speed_median": float(rows["peak_hand_speed"].median()),
                "peak_tip_speed_median": float(rows["peak_tip_speed"].median()),
                "duration_mean": float(rows["duration"].mean()),
            }
            for block, rows in throws.groupby("block")
        ],
    }


def agrees(style: str, name: str, value: float) -> bool:
    """Return whether a figure is what they print, to the last digit that they print."""
    printed, digits = PUBLISHED[style][name]
    return f"{value:.{digits}f}" == f"{printed:.{digits}f}"


@dataclass(frozen=True)
class Correlation:
    """A coefficient of correlation with its 95 % interval (Fisher 1921), of `n` degrees of freedom."""

    r: float
    low: float
    high: float
    n: int


def correlations(people: People, style: str, x: str, y: str) -> tuple[Correlation, Correlation]:
    """Return how two quantities go together between people and within them.

    Between: of people's means. Within: of what is left of each throw less its person's mean, of which each person
    takes a degree of freedom (Bland and Altman 1995, BMJ 310, 446).

    Args:
        people: Everybody's throws.
        style: One of them.
        x, y: Columns of the table of throws.
    """
    throws = people.throws[people.throws["style"] == style].dropna(subset=[x, y])
    by_person = throws.groupby("person")[[x, y]]
    means, rest = by_person.mean(), throws[[x, y]] - by_person.transform("mean")
    between = _correlation(means.to_numpy(), len(means) - 2)
    return between, _correlation(rest.to_numpy(), len(rest) - len(means) - 1)


def _correlation(xy: np.ndarray, freedom: int) -> Correlation:
    r = float(np.corrcoef(xy.T)[0, 1])
    half = float(norm.ppf(0.975)) / np.sqrt(max(freedom - 1, 1))
    low, high = np.tanh(np.arctanh(r) + np.array([-half, half])).tolist()
    return Correlation(r, low, high, freedom)


def in_order(people: People, style: str) -> tuple[int, int]:
    """Return in how many people each marker's largest speed is no smaller, and no earlier, than the next one's to the
    hand.

    A marker may be earlier by one of the instants that means were published at.
    """
    ones = people.of_style(style)
    instant = 1.5 / len(ones[0].t)
    faster = sum(bool((np.diff(one.peaks) <= 0).all()) for one in ones)
    later = sum(bool((np.diff(one.peak_times) <= instant).all()) for one in ones)
    return faster, later


def all_styles(people: People) -> dict[str, dict[str, Any]]:
    """Return `summary` by style."""
    return {style: summary(people, style) for style in STYLES}
