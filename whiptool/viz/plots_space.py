"""Figures of a strike in space: three projections, and in perspective."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure, SubFigure
from mpl_toolkits.mplot3d.art3d import Line3DCollection

from whiptool.models.parameters import Model
from whiptool.rollout.trajectory import Trajectory
from whiptool.target import Target
from whiptool.viz.plots import COLORS, StrikeDrawing, add_time_bar, draw_projection, strike_drawing

_TITLES = {"side": "from the right", "top": "from above", "front": "from the front"}


def plot_strike_views(
    figure: Figure | SubFigure, trajectory: Trajectory, model: Model, target: Target | Sequence[float]
) -> None:
    """Fill a figure with a strike in space: seen from the right, from above, from the front, and in perspective.

    Args:
        figure: Of constrained layout, some 11 by 9.6 inches.
        trajectory: The strike.
        model: The model that it was rolled out with.
        target: What was to be hit, or (x, y, z) [m].
    """
    drawing = strike_drawing(trajectory, model, target)
    grid = figure.add_gridspec(2, 3, width_ratios=(1, 1, 0.04))
    places = {"side": (0, 0), "front": (0, 1), "top": (1, 0)}
    axes = {view: figure.add_subplot(grid[place]) for view, place in places.items()}
    for view, ax in axes.items():
        draw_projection(ax, drawing, view)  # type: ignore[arg-type]
        ax.set_title(_TITLES[view])
    _draw_perspective(figure.add_subplot(grid[1, 1], projection="3d"), drawing)
    add_time_bar(figure, figure.add_subplot(grid[:, 2]), drawing)
    handles, labels = axes["side"].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(handles), title=drawing.title)


def _draw_perspective(ax: Any, drawing: StrikeDrawing) -> None:
    """Draw a strike in perspective, from the right, in front and above."""
    for x, width in ((drawing.arm, 2.6), (drawing.whip, 1.2)):
        ax.add_collection3d(Line3DCollection(list(x), colors=drawing.colors, linewidths=width, alpha=0.75))
    ax.plot(*drawing.before.T, color="0.45", linewidth=0.9)
    ax.plot(*drawing.near_arm.T, color=COLORS["black"], linewidth=4)
    ax.plot(*drawing.near_whip.T, color=COLORS["black"], linewidth=2)
    ax.plot(*drawing.near[-1:].T, "o", color=COLORS["vermilion"], markersize=5)
    ax.plot_surface(*_ball(drawing.place, drawing.hit_radius), color=COLORS["orange"], alpha=0.4, linewidth=0)
    every = np.concatenate([drawing.arm.reshape(-1, 3), drawing.whip.reshape(-1, 3), drawing.place[None]])
    middle, half = (every.max(axis=0) + every.min(axis=0)) / 2, np.ptp(every, axis=0).max() / 2
    for name, centre in zip("xyz", middle, strict=True):
        ax.set(**{f"{name}lim": (centre - half, centre + half), f"{name}label": f"{name} [m]"})
    ax.locator_params(nbins=5)
    ax.set_box_aspect((1, 1, 1))
    ax.view_init(elev=20, azim=-50)
    ax.set_title("in perspective")


def _ball(centre: np.ndarray, radius: float) -> np.ndarray:
    """Grid of points of a sphere, (3, 13, 25)."""
    polar, around = np.meshgrid(np.linspace(0, np.pi, 13), np.linspace(0, 2 * np.pi, 25), indexing="ij")
    unit = np.stack([np.sin(polar) * np.cos(around), np.sin(polar) * np.sin(around), np.cos(polar)])
    return centre[:, None, None] + radius * unit
