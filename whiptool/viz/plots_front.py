"""Figures of Pareto fronts."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from whiptool.viz.style import COLORS, STYLE, save_figure, verbatim


def plot_front(ax: Axes, front: np.ndarray, tried: np.ndarray, *, labels: Sequence[str]) -> Axes:
    """Draw a Pareto front as steps from hit to hit, over all hits of the search.

    The axes are limited to the front and its surroundings, so that hits far behind do not compress it.

    Args:
        ax: Axes to draw into.
        front: Values of the two criteria of the front's hits, in order, (P, 2).
        tried: Values of the two criteria of all hits, (Q, 2).
        labels: Labels of the two criteria, with units.
    """
    ax.plot(*tried.T, linestyle="", marker="o", markersize=2.4, color="0.6", label="other hits", rasterized=True)
    line = {"drawstyle": "steps-post", "linewidth": 1.4, "color": COLORS["blue"]}
    ax.plot(*front.T, marker="o", markersize=4.5, **line, label="Pareto front")
    ax.set(xlabel=labels[0], ylabel=labels[1])
    for axis, column in (("x", 0), ("y", 1)):
        low, high = front[:, column].min(), front[:, column].max()
        around = max(high - low, 1e-3 * abs(high), 1e-12) * np.array([-0.25, 0.25])
        ax.set(**{f"{axis}lim": np.array([low, high]) + around})
    ax.legend(loc="best")
    return ax


def save_front(
    folder: Path | str, front: np.ndarray, tried: np.ndarray, *, labels: Sequence[str], title: str = ""
) -> Path:
    """Write `front.png` (see `plot_front`) into a folder; return the file."""
    with matplotlib.rc_context(STYLE):
        figure = Figure((6.4, 4.4), layout="constrained")
        plot_front(figure.subplots(), front, tried, labels=labels).set_title(verbatim(title))
        return save_figure(figure, Path(folder) / "front.png")
