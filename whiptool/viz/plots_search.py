"""Figures of searches and trainings: convergence, miss distance over two coordinates, Pareto fronts, learning curves.

As in `whiptool.viz.plots`, every function draws into given axes and returns them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from whiptool.errors import InputError
from whiptool.goals.target import Target, as_target
from whiptool.models.trajectory import Approach
from whiptool.objective import Trial, why_lost
from whiptool.viz.style import COLORS, STYLE, head, legend_above, length_text, save_figure
from whiptool.words import counted

_COLORMAP = "cividis"  # made for readers with and without a colour vision deficiency; dark is near
_HIT, _LOST = COLORS["vermilion"], "0.75"


def axis_label(name: str, slides: Sequence[str] = ()) -> str:
    """Return the axis label of a strike's coordinate with its unit, such as `$q_{sf}$ [rad]`.

    Args:
        name: Name of the coordinate; names such as `x_f` are coordinates of the hand.
        slides: Names of the coordinates that are positions of prismatic joints, see
            `whiptool.models.strike.sliding_names`.
    """
    if name == "D":
        return "$D$ [s]"
    symbol, _, subscript = name.partition("_")
    unit = "m" if symbol in ("x", "y", "z") or name in slides else "rad"
    return f"${symbol}_{{{subscript}}}$ [{unit}]"


def plot_landscape(
    ax: Axes,
    x: np.ndarray,
    y: np.ndarray,
    near: Approach,
    target: Target | Sequence[float],
    *,
    names: Sequence[str],
    slides: Sequence[str] = (),
) -> Axes:
    """Draw the miss distance over two coordinates of a strike, with all others fixed, and a contour around the
    hits.

    Args:
        ax: Axes to draw into; a colour bar is set next to it.
        x: Values of the first coordinate [rad or m; D: s], (X,).
        y: Values of the second coordinate, (Y,).
        near: Closest approaches of the Y times X strikes, row by row of `y`; strikes that diverged are grey.
        target: Target of the strike, or its position [m].
        names: Names of the two coordinates, as `whiptool.models.strike.strike_names` has them.
        slides: Names of all coordinates that are positions of prismatic joints, whose unit is m instead of rad.

    Raises:
        InputError: The number of strikes does not fit the axes, or all strikes diverged.
    """
    x, y, goal = np.asarray(x, float), np.asarray(y, float), as_target(target)
    if near.distance.shape != (len(y) * len(x),):
        raise InputError("strikes", len(near.distance), f"{len(y)} times {len(x)}, one for each pair of parameters")
    known = ~near.diverged & np.isfinite(near.distance)
    if not known.any():
        raise InputError("miss distance", "no finite value", "at least one strike that did not diverge")
    miss, hit = np.where(known, near.distance, np.nan).reshape(len(y), len(x)), goal.goals.hit_by(near)
    # what is far closer than a hit needs no more shades
    nearest = max(float(np.nanmin(miss)), goal.hit_radius / 10)
    farthest = max(float(np.nanmax(miss)), goal.hit_radius)
    norm = LogNorm(nearest, farthest)
    ax.set_facecolor(_LOST)
    ax.pcolormesh(x, y, np.maximum(miss, nearest), cmap=_COLORMAP, norm=norm, shading="nearest", rasterized=True)
    if hit.any() and not hit[known].all():
        around, level, label = miss, goal.hit_radius, f"hit radius {goal.hit_radius:g} m"
        if not goal.goals.only_points:
            around, level, label = hit.reshape(miss.shape).astype(float), 0.5, "edge of the hits"
        ax.contour(x, y, around, levels=[level], colors=_HIT, linewidths=1.6)
        ax.plot([], [], color=_HIT, linewidth=1.6, label=label)
    ax.set(xlabel=axis_label(names[0], slides), ylabel=axis_label(names[1], slides))
    ax.grid(visible=False)
    figure = ax.get_figure()
    assert figure is not None
    figure.colorbar(ScalarMappable(norm, _COLORMAP), ax=ax, label="miss distance [m]")
    return ax


def plot_trials(
    ax: Axes,
    trials: Sequence[Trial],
    columns: tuple[int, int],
    *,
    names: Sequence[str],
    slides: Sequence[str] = (),
) -> Axes:
    """Draw the trials of a search as points over two coordinates of their strikes: hits filled, misses as rings.

    The axes may be empty, or hold the picture of `plot_landscape`. Hits and misses have labels for a legend, which the
    caller adds.

    Args:
        ax: Axes to draw into.
        trials: Trials of the search.
        columns: Indices of the two coordinates in the strike vector.
        names: Names of these two coordinates, as `whiptool.models.strike.strike_names` has them.
        slides: Names of all coordinates that are positions of prismatic joints, whose unit is m instead of rad.
    """
    at = np.array([trial.strike for trial in trials]).reshape(len(trials), -1)
    hit = np.array([trial.outcome.hit for trial in trials], bool)
    i, j = columns
    style = {"linestyle": "", "marker": "o", "markeredgewidth": 0.9, "zorder": 3}
    misses, hits = at[~hit][:, [i, j]].T, at[hit][:, [i, j]].T
    ax.plot(*misses, markerfacecolor="none", markeredgecolor="white", markersize=4.6, **style)  # seen on the dark
    ax.plot(*misses, markerfacecolor="none", markeredgecolor=COLORS["black"], markersize=3.2, label="miss", **style)
    ax.plot(*hits, markerfacecolor=_HIT, markeredgecolor="white", markersize=5.5, label="hit", **style)
    ax.set(xlabel=axis_label(names[0], slides), ylabel=axis_label(names[1], slides))
    return ax


def plot_convergence(ax: Axes, trials: Sequence[Trial], target: Target | Sequence[float]) -> Axes:
    """Draw the miss distance of every trial [m], in the order of the search, and the smallest so far.

    Hits are those of the trials' outcomes, so a required direction and speed count as well. Trials without a miss
    distance, such as strikes that were refused, are crosses at the top, and the legend has their numbers by reason.

    Args:
        ax: Axes to draw into.
        trials: Trials, such as the `trace` of a `Result`.
        target: Target of the strike, or its position [m].
    """
    hit_radius = as_target(target).hit_radius
    miss = np.array([np.nan if one.outcome.lost else one.outcome.miss_distance for one in trials])
    trial = np.arange(1, len(miss) + 1)
    best = np.minimum.accumulate(np.where(np.isfinite(miss), miss, np.inf))
    hit = np.array([one.outcome.hit for one in trials], bool)
    dots = {"linestyle": "", "markeredgewidth": 0, "rasterized": len(miss) > 5000}
    if np.isfinite(miss).any():
        ax.plot(trial, miss, marker="o", color=COLORS["sky"], markersize=3.5, alpha=0.6, label="trial", **dots)
        nearest = np.where(np.isfinite(best), best, np.nan)
        ax.step(trial, nearest, where="post", color=COLORS["blue"], linewidth=2.2, label="nearest so far")
    ax.axhline(hit_radius, color=COLORS["orange"], linestyle="--", linewidth=1.8, label=f"hit radius {hit_radius:g} m")
    if hit.any():
        edge = {"markeredgecolor": "white", "markeredgewidth": 0.6, "linestyle": "", "zorder": 3}
        ax.plot(trial[hit], miss[hit], "*", color=COLORS["green"], markersize=11, label="hit", **edge)
    _plot_lost(ax, trials)
    title = f"first hit in trial {trial[hit][0]}" if hit.any() else f"no hit in {counted(len(miss), 'trial')}"
    if len(miss) and np.isfinite(best[-1]):
        title += f", nearest {length_text(best[-1])}"
    ax.set(yscale="log", xlabel="trial", ylabel="miss distance [m]", title=title)
    ax.set_xlim(0.5, max(len(miss), 1) + 0.5)
    ax.xaxis.set_major_locator(MaxNLocator(integer=True))
    legend_above(ax)
    return ax


def _plot_lost(ax: Axes, trials: Sequence[Trial]) -> None:
    """Mark trials that have no miss distance at the top of the axes, with their numbers by reason in the legend."""
    lost = [(i, one) for i, one in enumerate(trials, start=1) if one.outcome.lost]
    for refused, marker, color in ((True, "x", COLORS["vermilion"]), (False, "+", COLORS["black"])):
        of_kind = [(i, one) for i, one in lost if (one.outcome.refused is not None) == refused]
        if not of_kind:
            continue
        reasons = ", ".join(f"{n} {why}" for why, n in why_lost([one for _, one in of_kind]).items())
        ax.plot(
            [i for i, _ in of_kind],
            np.full(len(of_kind), 0.98),
            marker,
            transform=ax.get_xaxis_transform(),
            color=color,
            markersize=4.5,
            markeredgewidth=1,
            rasterized=len(of_kind) > 5000,
            label=f"refused: {reasons}" if refused else f"no result: {reasons}",
        )


def save_convergence(
    folder: str | Path, trials: Sequence[Trial], target: Target | Sequence[float], *, label: str = ""
) -> Path:
    """Write `convergence.png` (see `plot_convergence`) into a folder, which is made if missing; return the file.

    Its heading is `label`.
    """
    with matplotlib.rc_context(STYLE):
        figure = Figure((7.6, 4.4), layout="constrained")
        plot_convergence(figure.subplots(), trials, target)
        head(figure, label)
        return save_figure(figure, Path(folder) / "convergence.png")


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
        limits = np.array([low, high]) + around
        ax.set(**{f"{axis}lim": np.maximum(limits, -0.04 * high) if low >= 0 else limits})  # none where nothing can be
    ax.legend(loc="best")
    return ax


def save_front(
    folder: Path | str, front: np.ndarray, tried: np.ndarray, *, labels: Sequence[str], title: str = ""
) -> Path:
    """Write `front.png` (see `plot_front`) into a folder; return the file."""
    with matplotlib.rc_context(STYLE):
        figure = Figure((6.4, 4.4), layout="constrained")
        plot_front(figure.subplots(), front, tried, labels=labels)
        head(figure, title)
        return save_figure(figure, Path(folder) / "front.png")


_WINDOW = 0.04  # of the running mean, in lengths of the training
_TRAINING, _HELD_OUT = COLORS["blue"], COLORS["vermilion"]


def plot_learning(
    reward: Axes, hits: Axes, columns: Mapping[str, np.ndarray], *, trials: int, best: int | None
) -> None:
    """Draw the mean reward of every episode's strikes, and the fractions of strikes and of held-out goals that hit.

    Args:
        reward, hits: Axes to draw into.
        columns: Columns of `whiptool.rl.training_log.EpisodeTable` by name, (E,) each.
        trials: Number of strikes in an episode.
        best: Number of the episode of the best policy, which is marked; None: no mark.
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
    """Return the mean of each value (E,) and the `window` - 1 values before it, or as many as there are, (E,)."""
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
        head(figure, title)
        reward.margins(x=0.02)
        legend_above(hits, ncols=2)
        return save_figure(figure, path)
