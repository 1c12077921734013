"""The learning curve of a training: rewards, and fractions of strikes that hit, over its episodes."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from whiptool.viz.style import COLORS, STYLE, legend_above, save_figure

_WINDOW = 0.04  # of the running mean, in lengths of the training
_TRAINING, _HELD_OUT = COLORS["blue"], COLORS["vermilion"]


def plot_learning(
    reward: Axes, hits: Axes, columns: Mapping[str, np.ndarray], *, trials: int, best: int | None
) -> None:
    """Draw the mean reward of every episode's strikes, and the fractions of strikes and of held-out goals that hit.

    Args:
        reward, hits: Axes to draw into.
        columns: Columns of `whiptool.rl.training_log.EpisodeTable`.
        trials: Strikes in an episode.
        best: The episode of the best policy, which is marked.
    """
    episode = columns["number"]
    window = max(1, round(_WINDOW * len(episode)))
    smooth = {"color": _TRAINING, "linewidth": 2}
    raw = {"color": _TRAINING, "linewidth": 0.8, "alpha": 0.45}
    reward.plot(episode, columns["mean_reward"], **raw)
    reward.plot(episode, running_mean(columns["mean_reward"], window), **smooth)
    reward.set(ylabel="mean reward of a strike")
    share = 100 * columns["share_hit"]
    hits.plot(episode, share, **raw)
    hits.plot(episode, running_mean(share, window), label="exploring strikes, running mean", **smooth)
    scored = np.isfinite(columns["held_out_hit"])
    at, held_out = episode[scored], 100 * columns["held_out_hit"][scored]
    if len(at):
        line = {"marker": "o", "markersize": 3.5, "linewidth": 1.4, "color": _HELD_OUT}
        hits.plot(at, held_out, label="first strikes at held-out goals", **line)
    if best is not None:
        ring = {"marker": "o", "markersize": 10, "markerfacecolor": "none", "markeredgewidth": 1.8, "linestyle": ""}
        hits.plot([best], held_out[at == best], color=COLORS["black"], label=f"best policy, episode {best}", **ring)
    hits.set(xlabel=f"episode of {trials:,} strikes", ylabel="hits [%]", ylim=(-4, 104))
    hits.xaxis.set_major_locator(MaxNLocator(integer=True))


def mark_random(ax: Axes, random_episodes: int) -> None:
    """Mark the episodes at the beginning in which strikes are random and nothing is learned, if there are any."""
    if not random_episodes:
        return
    ax.axvline(random_episodes + 0.5, color="0.55", linestyle=":", linewidth=1.2)
    ax.annotate(
        "random before",
        (random_episodes + 0.5, 0.02),
        xycoords=ax.get_xaxis_transform(),
        xytext=(4, 0),
        textcoords="offset points",
        color="0.35",
        fontsize=9,
    )


def running_mean(values: np.ndarray, window: int) -> np.ndarray:
    """Return the mean of each value and the `window` - 1 values before it, (E,)."""
    total = np.concatenate([[0.0], np.cumsum(values)])
    last = np.arange(1, len(values) + 1)
    first = np.maximum(last - window, 0)
    return (total[last] - total[first]) / (last - first)


def save_learning(
    path: Path, columns: Mapping[str, np.ndarray], *, trials: int, random_episodes: int, best: int | None, title: str
) -> Path:
    """Write the learning curve (see `plot_learning`) as a picture; return the file."""
    with matplotlib.rc_context(STYLE):
        figure = Figure((7.2, 6.2), layout="constrained")
        reward, hits = figure.subplots(2, 1, sharex=True)
        plot_learning(reward, hits, columns, trials=trials, best=best)
        mark_random(reward, random_episodes)
        reward.set_title(title)
        reward.margins(x=0.02)
        legend_above(hits, ncols=2)
        return save_figure(figure, path)
