"""Figures of a search: the miss distance over two coordinates of a strike, and the trials.

As in `whiptool.viz.plots`, every function draws into given axes and returns them.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LogNorm

from whiptool.errors import InputError
from whiptool.goals.target import Target, as_target
from whiptool.models.trajectory import Approach
from whiptool.objective import Trial
from whiptool.viz.plots import COLORS

_COLORMAP = "cividis"  # made for readers with and without a colour vision deficiency; dark is near
_HIT, _LOST = COLORS["vermilion"], "0.75"


def axis_label(name: str, slides: Sequence[str] = ()) -> str:
    """Return the axis label of a strike's coordinate with its unit, such as `$q_{sf}$ [rad]`.

    Args:
        name: Name of the coordinate; `x_f` is a position of the hand.
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
        x: Values of the first coordinate, (X,), in its own unit.
        y: Values of the second coordinate, (Y,).
        near: Closest approaches of the Y X strikes, row by row of `y`; strikes that diverged are grey.
        target: Target of the strike, or its position [m].
        names: Names of the two parameters, as `whiptool.models.strike.strike_names` has them.
        slides: See `axis_label`.

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
    """Draw the trials of a search over two coordinates, on a landscape or alone; hits are filled.

    Hits and misses have labels for a legend, which the caller adds.

    Args:
        ax: Axes to draw into.
        trials: Trials of the search.
        columns: Indices of the two coordinates in the strike vector.
        names: Names of the two parameters.
        slides: See `axis_label`.
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
