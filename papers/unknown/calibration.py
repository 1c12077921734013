"""What was stated of strikes with unknown whips, and what came: reliability, scores, tables and plots."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from papers.unknown.scores import Forecast, Scores
from papers.unknown.trials import hits, reliability
from whiptool.adaptation.twins import FAMILIES
from whiptool.goals.target import HIT_RADIUS
from whiptool.viz.plots import COLORS, STYLE
from whiptool.viz.report import Picture, Table, Text
from whiptool.words import counted


def forecasts(results: Sequence[dict[str, Any]], *, first: bool = False) -> list[Forecast]:
    """What was stated of all strikes that were struck, or of first ones, and what came."""
    struck = [x for r in results for x in _strikes(r, first=first)]
    return [Forecast(p, misses, x, x is not None and bool(hits(np.array(x), HIT_RADIUS))) for p, misses, x in struck]


def _strikes(result: dict[str, Any], *, first: bool) -> list[tuple[float, Sequence[float | None], float | None]]:
    """Stated probability, predictive sample and true miss of the strikes with one whip."""
    found = []
    for trial in result["trials"]:
        struck = list(zip(trial["probability"], trial["predicted"], trial["miss"], strict=False))
        found += struck[:1] if first else struck
    if not first:
        found += [(x["probability"], x["predicted"], x["miss"]) for x in result["transferred"]]
    return found


def stated(results: Sequence[dict[str, Any]], *, first: bool = False) -> tuple[np.ndarray, np.ndarray]:
    """Stated probabilities, and whether the strikes hit."""
    known = forecasts(results, first=first)
    return np.array([f.probability for f in known]), np.array([f.hit for f in known])


def _scores(learned: dict[str, list[dict[str, Any]]], whole: dict[str, list[dict[str, Any]]]) -> list[list[str]]:
    """Scores by family, of first strikes and of all."""
    header = ["through", "family", "strikes", "number", "hit", "Brier", "constant", "log", "constant"]
    rows = [[*header, "miss within 50 %", "within 90 %", "beyond all samples"]]
    for through, by_family in (("tip seen", learned), ("whole chain", whole)):
        groups = by_family | {"all": [r for results in by_family.values() for r in results]}
        for family, results in groups.items():
            for first in (True, False):
                known = forecasts(results, first=first)
                if not known:
                    continue
                x = Scores.of(known)
                said = [through, family, "first" if first else "all", str(x.count), f"{100 * x.hits:.1f} %"]
                proper = [f"{value:.4f}" for value in (x.brier, x.brier_constant, x.log, x.log_constant)]
                rows.append([*said, *proper, *(f"{100 * value:.1f} %" for value in (*x.within, x.beyond))])
    return rows


def calibration(
    learned: dict[str, list[dict[str, Any]]], whole: dict[str, list[dict[str, Any]]]
) -> list[Text | Table | Picture]:
    groups = {"tip seen": learned, "whole chain": whole}
    tried = {through: by_family for through, by_family in groups.items() if any(by_family.values())}
    if not tried:
        return [Text("None of the ways to strike that were tried states probabilities.")]
    parts: list[Text | Table | Picture] = [
        Text(
            "The planner states the probability of a hit for every strike. Of all strikes with about the same stated "
            "probability, this share hit. The expected calibration error is the mean distance between the two "
            "(Naeini et al. 2015). Where nearly all strikes hit it says little. The Brier and the log score say more, "
            "next to those of the best constant forecast (the share of hits, known afterwards), and so does where the "
            "true miss lies in the predictive sample: of 64 samples, 1.5 % of true misses should be beyond all."
        ),
        Table(_scores(learned, whole), "Scores of stated probabilities, and true misses within predicted quantiles."),
    ]
    with matplotlib.rc_context(STYLE):
        figure = Figure((11, 3.5 * len(tried)), layout="constrained")
        axes = figure.subplots(len(tried), len(FAMILIES), sharey=True, sharex=True, squeeze=False)
        for row, (through, by_family) in zip(axes, tried.items(), strict=True):
            for ax, (family, results) in zip(row, by_family.items(), strict=True):
                if results:
                    plot_reliability(ax, *stated(results), title=f"{family}, {through}")
                else:
                    ax.set_visible(False)
                ax.label_outer()
    return [*parts, Picture(figure, "Stated against observed; the area of a dot grows with the number of strikes.")]


def plot_reliability(ax: Axes, stated: np.ndarray, observed: np.ndarray, *, title: str = "") -> Axes:
    """Observed share of hits against the stated probability; arguments as for `reliability`."""
    bins, error = reliability(stated, observed)
    ax.plot([0, 100], [0, 100], color="0.6", linestyle="--", linewidth=1.2)
    ax.plot(*100 * bins[:, :2].T, color=COLORS["blue"], linewidth=1.2)
    ax.scatter(*100 * bins[:, :2].T, s=30 + 300 * bins[:, 2] / len(stated), color=COLORS["blue"], alpha=0.7, zorder=3)
    ax.set(xlabel="stated probability of a hit [%]", ylabel="strikes that hit [%]", xlim=(-4, 104), ylim=(-4, 104))
    ax.set_title(f"{title}\n{counted(len(stated), 'strike')}, calibration error {error:.3f}", fontsize=10)
    return ax
