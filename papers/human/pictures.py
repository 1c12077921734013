"""Figures of people and machines."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from papers.human.bullwhip import Cascade
from papers.human.cascade_fit import Measured
from papers.human.machine_strikes import Curve
from papers.human.reading import STYLES, People
from papers.human.tolerance_costs import SIZES, Costs, Tolerance
from whiptool.viz.style import COLORS, STYLE, legend_above

STYLE_COLORS = dict(zip(STYLES, (COLORS["blue"], COLORS["vermilion"]), strict=True))
_MARKS = ("o", "s", "^", "D", "v", "P")
_METHOD_COLORS = ("blue", "vermilion", "green", "orange", "black")


def blocks_picture(people: People) -> Figure:
    """Return every person's median miss distance and share of hits, block by block, with the medians over people."""
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(9.0, 3.8), layout="constrained")
        for ax, (column, words) in zip(
            figure.subplots(1, 2), (("min_distance", "minimal distance [m]"), ("hit", "share of hits [1]")), strict=True
        ):
            for i, style in enumerate(STYLES):
                throws = people.throws[people.throws["style"] == style]
                table = (
                    throws.groupby(["person", "block"])[column].agg("mean" if column == "hit" else "median").unstack()
                )
                shift = 0.12 * (2 * i - 1)
                ax.plot(
                    table.columns + shift, table.T, ".", color=STYLE_COLORS[style], alpha=0.35, markersize=5, zorder=1
                )
                ax.plot(
                    table.columns + shift,
                    table.median(),
                    "-" + _MARKS[i],
                    color=STYLE_COLORS[style],
                    label=style,
                )
            ax.set(xlabel="block", ylabel=words, xticks=sorted(people.throws["block"].unique()), ylim=(0, None))
        for ax in figure.axes:
            legend_above(ax, ncols=2)
        return figure


def cascade_picture(seen: Mapping[str, Measured], models: Mapping[str, Mapping[str, Cascade]]) -> Figure:
    """Return measured and modelled peaks and their times along the whip.

    Args:
        seen: By style.
        models: By style, and by name.
    """
    from papers.human.bullwhip import PLACES

    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(9.0, 6.0), layout="constrained")
        axes = figure.subplots(2, len(seen), sharex=True, sharey="row")
        for column, (style, of) in enumerate(seen.items()):
            top, below = axes[:, column]
            for ax, values, half in ((top, of.peaks, 0.1 * of.peaks), (below, of.times, np.full(len(of.times), 0.05))):
                ax.fill_between(
                    PLACES, values - half, values + half, color="0.85", label="10 %" if ax is top else "0.05"
                )
                ax.plot(PLACES, values, "o", color=COLORS["black"], label="people")
            for i, (name, cascade) in enumerate(models[style].items()):
                look = {"color": list(COLORS.values())[i], "marker": _MARKS[i + 1], "markersize": 4, "label": name}
                top.plot(PLACES, cascade.peaks, "-", **look)
                below.plot(PLACES, cascade.times, "-", **look)
            top.set_title(style + (", fitted" if style == STYLES[0] else ", predicted"))
            below.set_xlabel("from the thong's beginning [m]")
        axes[0, 0].set(ylabel="largest mean speed [m/s]", ylim=(0, None))
        axes[1, 0].set(ylabel="time of it [onset 0, closest 1]")
        for ax in axes[:, 0]:
            ax.legend()
        return figure


def throw_picture(cascades: Mapping[str, Cascade], seen: Mapping[str, Measured]) -> Figure:
    """Return the modelled speeds of all markers over each style's throw."""
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(9.0, 3.6), layout="constrained")
        for ax, (style, cascade) in zip(figure.subplots(1, len(cascades), sharey=True), cascades.items(), strict=True):
            count = cascade.speeds.shape[1]
            t = np.linspace(0, 1, len(cascade.speeds))
            shades = matplotlib.colormaps["viridis"](np.linspace(0.88, 0, count))
            for i in reversed(range(count)):
                label = {0: "tip", count - 1: "at the handle"}.get(i)
                ax.plot(t, cascade.speeds[:, i], color=shades[i], linewidth=1.4, label=label)
            ax.plot(
                seen[style].times, seen[style].peaks, "o", color=COLORS["black"], markersize=4, label="people's peaks"
            )
            ax.set(title=style, xlabel="time [onset 0, closest 1]")
        figure.axes[0].set_ylabel("speed of markers [m/s]")
        figure.axes[0].legend()
        return figure


def tolerance_picture(found: Mapping[str, Tolerance], shares: Mapping[str, float]) -> Figure:
    """Return the share of hits over the size of noise, by method, with people's shares."""
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(6.6, 4.2), layout="constrained")
        ax = figure.subplots()
        for i, (method, of) in enumerate(found.items()):
            ax.plot(
                SIZES, of.shares, "-", marker=_MARKS[i], markersize=4, color=COLORS[_METHOD_COLORS[i]], label=method
            )
        for style, share in shares.items():
            ax.axhline(share, color="0.4", linestyle=":", linewidth=1.2)
            ax.annotate(f"people, {style}", (SIZES[0], share), xytext=(0, 3), textcoords="offset points", fontsize=9)
        ax.set(
            xscale="log",
            xlabel="noise on every number of the strike [rad, s]",
            ylabel="share of hits [1]",
            ylim=(0, 1.02),
        )
        ax.legend()
        return figure


def costs_picture(found: Mapping[str, Sequence[Costs]]) -> Figure:
    """Return the costs of tolerance, noise and covariation by method; every strike is a point, bars are means."""
    parts = ("tolerance", "noise", "covariation")
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(7.2, 3.8), layout="constrained")
        ax = figure.subplots()
        width = 0.8 / len(found)
        for i, (method, of) in enumerate(found.items()):
            at = np.arange(len(parts)) + (i - (len(found) - 1) / 2) * width
            values = 100 * np.array([[getattr(one, part) for part in parts] for one in of])
            color = COLORS[_METHOD_COLORS[i]]
            ax.bar(at, values.mean(axis=0), 0.9 * width, color=color, alpha=0.75, label=method)
            ax.plot(np.tile(at, (len(of), 1)).T, values.T, "o", color="white", markeredgecolor="black", markersize=4)
        ax.set(ylabel="cost of mean miss distance [cm]")
        ax.set_xticks(range(len(parts)), parts)
        ax.grid(visible=False, axis="x")
        ax.legend(ncols=2)
        return figure


def learning_picture(curves: Sequence[Curve]) -> Figure:
    """Return median miss distances over trials, with 95 % intervals."""
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(7.2, 4.4), layout="constrained")
        ax = figure.subplots()
        for i, one in enumerate(curves):
            color = COLORS[("blue", "vermilion", "green", "black")[i % 4]]
            ax.fill_between(one.trial, one.low, one.high, color=color, alpha=0.18, linewidth=0)
            ax.plot(one.trial, one.median, "-", marker=_MARKS[i], markersize=5, color=color, label=one.label)
        ax.set(xscale="log", yscale="log", xlabel="trial", ylabel="median miss distance [m]")
        ax.legend()
        return figure
