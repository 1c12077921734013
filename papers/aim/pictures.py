"""Where goals are missed."""

from __future__ import annotations

from typing import Any

import matplotlib
import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from papers.aim.aimed import Aimed
from whiptool.viz.plots import COLORS, STYLE


def misses(aimed: Aimed) -> Figure:
    """Goals in space by height over distance from the base, and over the arrival angle: hit, missed, never reached.

    Left in one shot, right after refinement.
    """
    height = aimed.positions[:, 2]
    across = {
        "distance from the base [m]": np.linalg.norm(aimed.positions, axis=1),
        "arrival angle [degrees]": np.degrees(aimed.angles),
    }
    shots = {"in one shot": aimed.one_shot.hit, "after refinement": aimed.refined.hit}
    with matplotlib.rc_context(STYLE):
        figure = Figure((11, 8.6), layout="constrained")
        axes = figure.subplots(2, 2, sharey=True, sharex="row")
        for row, (name, x) in zip(axes, across.items(), strict=True):
            for ax, (shot, hit) in zip(row, shots.items(), strict=True):
                _draw(ax, x, height, hit, aimed.reached)
                ax.set(xlabel=name, title=f"{shot}: {hit.sum():,} of {len(hit):,} hit")
            row[0].set_ylabel("height above the base [m]")
        for ax in axes[1]:
            ax.set_xticks([-180, -90, 0, 90, 180])
        figure.legend(_handles(), ["hit", "missed", "never reached by any search"], loc="outside upper center", ncols=3)
    return figure


def _draw(ax: Any, x: np.ndarray, y: np.ndarray, hit: np.ndarray, reached: np.ndarray) -> None:
    ax.plot(x[hit], y[hit], ".", color="0.8", markersize=3, zorder=1)
    ax.plot(x[~hit], y[~hit], "x", color=COLORS["vermilion"], markersize=5, markeredgewidth=1.3, zorder=2)
    ax.plot(x[~reached], y[~reached], "o", color=COLORS["black"], markersize=10, markerfacecolor="none", zorder=3)


def _handles() -> list[Line2D]:
    """Return what stands in the legend."""
    return [
        Line2D([], [], color="0.7", marker=".", markersize=8, linestyle="none"),
        Line2D([], [], color=COLORS["vermilion"], marker="x", linestyle="none"),
        Line2D([], [], color=COLORS["black"], marker="o", markersize=9, markerfacecolor="none", linestyle="none"),
    ]
