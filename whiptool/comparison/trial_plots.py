"""Figures of a comparison of methods (Figs. 5-7), drawn into given axes as in `whiptool.viz.plots`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from whiptool.comparison.series import NAMES, Series
from whiptool.viz.plots_search import mark_random, running_mean
from whiptool.viz.style import COLORS, STYLE
from whiptool.whole_files import replacing

OBSERVATION_COLORS = {"tip": COLORS["vermilion"], "relative": COLORS["orange"], "goal": COLORS["blue"]}
_LEGEND_ENTRY = 1.45  # [in], width of an entry of a legend
_SEARCH, _RANDOM = COLORS["green"], "0.55"
LEARNER_COLORS = {"sac": COLORS["blue"], "td3": COLORS["vermilion"], "ddpg": COLORS["green"], "ppo": COLORS["pink"]}
_SEARCH_COLORS = {
    "directl": COLORS["black"],
    "ga": COLORS["orange"],
    "cmaes": COLORS["sky"],
    "gradient": COLORS["brown"],
    "random": _RANDOM,
}


_DASHES = {  # by which searches differ for those who do not see the colours
    "directl": (0, (5, 1.5)),
    "ga": (0, (1.2, 1.2)),
    "cmaes": (0, (5, 1.5, 1.2, 1.5)),
    "gradient": (0, (2.5, 1.2)),
    "random": (0, (1, 2.5)),
}


def _color(one: Series) -> str:
    if one.learned:
        return OBSERVATION_COLORS[one.observation]
    return _RANDOM if one.method == "random" else _SEARCH


def plot_bars(ax: Axes, series: Sequence[Series], *, title: str = "") -> Axes:
    """Draw mean trials to the first hit with 95 % intervals (Fig. 6), the fewest at the top; all series of one hit
    radius.
    """
    ordered = sorted(series, key=lambda one: -one.mean)
    means = np.array([one.mean for one in ordered])
    low, high = np.array([one.interval for one in ordered]).T
    y = np.arange(len(ordered))
    ax.barh(y, means - 0.9, left=0.9, color=[_color(one) for one in ordered], height=0.72)
    ax.errorbar(
        means,
        y,
        xerr=[np.maximum(means - low, 0), np.maximum(high - means, 0)],
        fmt="none",
        ecolor=COLORS["black"],
        elinewidth=1.2,
        capsize=2.5,
    )
    for i, one in enumerate(ordered):
        share = one.hit.mean()
        text = f"{one.mean:.3g}" + ("" if share == 1 else f"   ({min(100 * share, 99.9):.1f} % hit)")
        ax.annotate(
            text, (max(high[i], means[i]), i), xytext=(5, 0), textcoords="offset points", va="center", fontsize=9
        )
    ax.set(
        xscale="log",
        xlim=(0.9, 7 * high.max()),  # room for the words
        yticks=y,
        yticklabels=[one.label for one in ordered],
        xlabel="mean trials to the first hit, with 95 % interval",
        title=title,
    )
    ax.xaxis.set_major_formatter("{x:g}")
    ax.grid(axis="y", visible=False)
    return ax


def _bar_legend(figure: Figure, series: Sequence[Series]) -> None:
    """What the bars' colours mean, above the axes."""
    kinds = {_color(one): f"learner, observation {one.observation}" if one.learned else "search" for one in series}
    kinds = {color: "random" if color == _RANDOM else text for color, text in kinds.items()}
    figure.legend(
        handles=[Patch(color=color, label=text) for color, text in kinds.items()], loc="outside upper left", ncols=3
    )


def plot_ecdf(ax: Axes, series: Sequence[Series], *, cap: int | None = None, title: str = "") -> Axes:
    """Draw the fraction of targets hit over the number of trials; all series of one hit radius and observation."""
    largest = cap or max(int(one.trials.max()) for one in series)
    for one in series:
        hits = np.sort(one.trials[one.hit])
        x = np.r_[1, hits, largest]
        share = np.r_[np.sum(hits <= 1), np.arange(1, len(hits) + 1), len(hits)] / one.trials.size
        color = LEARNER_COLORS[one.method] if one.learned else _SEARCH_COLORS.get(one.method, "0.3")
        ax.step(
            x,
            100 * share,
            where="post",
            color=color,
            linestyle="-" if one.learned else _DASHES.get(one.method, (0, (4, 1.5))),
            label=NAMES.get(one.method, one.method),
        )
    ax.set(xscale="log", ylim=(0, 102), xlabel="trials", ylabel="targets hit [%]", title=title)
    ax.set_xlim(1, max(largest, 2))
    ax.xaxis.set_major_formatter("{x:g}")
    return ax


def plot_rewards(
    ax: Axes, rewards: Mapping[str, np.ndarray], *, random_episodes: int, window: int, title: str = ""
) -> Axes:
    """Draw the mean reward of every episode (Fig. 7): the running mean over seeds, the range over seeds, and the raw
    values behind it.

    Args:
        ax: Axes to draw into.
        rewards: Rewards of each method, S seeds by E episodes, (S, E).
        random_episodes: Number of initial episodes with random strikes, which are marked.
        window: Episodes of the running mean.
        title: Title of the axes.
    """
    for method, values in rewards.items():
        color, episode = LEARNER_COLORS[method], np.arange(1, values.shape[1] + 1)
        ax.plot(episode, values.mean(axis=0), color=color, linewidth=0.6, alpha=0.35)
        smooth = np.array([running_mean(row, window) for row in values])
        ax.fill_between(episode, smooth.min(axis=0), smooth.max(axis=0), color=color, alpha=0.18, linewidth=0)
        ax.plot(episode, smooth.mean(axis=0), color=color, linewidth=2, label=NAMES[method])
    mark_random(ax, random_episodes)
    ax.set(xlabel="episode", ylabel="mean reward", title=title)
    ax.margins(x=0)
    return ax


def comparison_figures(series: Sequence[Series]) -> dict[str, Figure]:
    """Return the figures `bars` (see `plot_bars`), with one panel per hit radius, and `ecdf` (see `plot_ecdf`), with
    one per hit radius and observation. Series that are not `main` are left out.
    """
    radii = list(dict.fromkeys(one.hit_radius for one in series))
    main = [one for one in series if one.main]
    observations = list(dict.fromkeys(one.observation for one in main if one.learned)) or [""]
    with matplotlib.rc_context(STYLE):
        bars = Figure((5.6 * len(radii), 2.4 + 0.32 * len(main) / len(radii)), layout="constrained")
        for ax, radius in zip(bars.subplots(1, len(radii), squeeze=False)[0], radii, strict=True):
            plot_bars(ax, [one for one in main if one.hit_radius == radius], title=f"hit radius {radius:g} m")
        _bar_legend(bars, main)
        ecdf = Figure((3.9 * len(observations) + 0.6, 3.0 * len(radii) + 0.8), layout="constrained")
        axes = ecdf.subplots(len(radii), len(observations), squeeze=False, sharex=True, sharey=True)
        for (i, j), ax in np.ndenumerate(axes):
            shown = [o for o in main if o.hit_radius == radii[i] and o.observation in ("", observations[j])]
            where = f", observation {observations[j]}" if observations[j] else ""
            title = f"hit radius {radii[i]:g} m{where}"
            plot_ecdf(ax, shown, cap=int(max(o.trials.max() for o in main)), title=title)
            ax.label_outer()
        columns = int(ecdf.get_figwidth() / _LEGEND_ENTRY)
        ecdf.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside upper left", ncols=columns)
    return {"bars": bars, "ecdf": ecdf}


def save_comparison(folder: Path, series: Sequence[Series]) -> None:
    """Write figures of a comparison into a folder: `bars.png`, mean trials by method, and `ecdf.png`, the fraction of
    targets hit over the trials."""
    for name, figure in comparison_figures(series).items():
        with matplotlib.rc_context(STYLE), replacing(folder / f"{name}.png") as unfinished:
            figure.savefig(unfinished)
