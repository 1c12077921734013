"""Figures of a strike: postures of arm and whip, and the tip's path, drawn with matplotlib's objects.

A planar strike has one view; a strike in space has three projections and a perspective. As in `whiptool.viz.plots`,
functions draw into given axes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.gridspec import GridSpec
from matplotlib.patches import Circle
from mpl_toolkits.mplot3d.art3d import Line3DCollection
from mpl_toolkits.mplot3d.axes3d import Axes3D

from whiptool.errors import expect
from whiptool.goals.target import Target, as_target
from whiptool.models.parameters import Model
from whiptool.models.trajectory import Trajectory
from whiptool.viz.drawn_posture import arm_and_whip, at_times, box_around
from whiptool.viz.style import (
    AXES,
    COLORS,
    LOOK,
    SPEED,
    STYLE,
    asked_of,
    draw_direction,
    draw_direction_in_space,
    legend_above,
    length_text,
    plot_ball,
    set_up_perspective,
    ticks,
)

VIEWS = {"side": (0, 2), "top": (0, 1), "front": (1, 2)}  # coordinates to the right and up
_POSTURES = 10
_SEGMENTS = 600  # of the tip's path
_LONGEST = 4.3  # [in], the widest side of what is shown in four views
_AFTER: dict[str, Any] = {"color": "0.45", "linewidth": 1.2, "linestyle": (0, (1, 1.6)), "zorder": 1.5}
_HEIGHT = 6.6  # [in] of a figure with one view, whose shape sets its width


@dataclass(frozen=True)
class Drawn:
    """Data of the drawing of a strike; positions have d coordinates [m] in the base's axes.

    Args:
        arms, whips: P postures, at equal intervals of time up to `until`, then that at the closest approach: points of
            the arm, (P, ..., d), and of the whip from hand to tip, (P, N + 1, d), see `arm_and_whip`.
        path: Path of the tip, (S, d).
        path_times: Times of the path [s], (S,).
        speed: Speed of the tip [m/s], (S,).
        until: Time of the closest approach [s], or the end time if that is in the first 30 % of the time.
        target: Target of the strike.
        title: Title with the miss distance.
        when: Time of the last posture [s]: that of the closest approach, or of the release of a throw.
        followed: What moves along the path, in words.
    """

    arms: np.ndarray
    whips: np.ndarray
    path: np.ndarray
    path_times: np.ndarray
    speed: np.ndarray
    until: float
    target: Target
    title: str
    when: float
    followed: str = "tip"

    @property
    def dimension(self) -> int:
        """2 in the plane, 3 in space."""
        return self.path.shape[1]

    @property
    def box(self) -> tuple[np.ndarray, np.ndarray]:
        """Lowest and highest corner of the visible region [m], (d,) each, with no side much shorter than the
        longest."""
        moved = [self.arms.reshape(-1, self.dimension), self.whips.reshape(-1, self.dimension), self.path]
        return box_around(np.concatenate(moved), self.target)

    @property
    def norm(self) -> Normalize:
        """Mapping from the tip's speed to colours, up to the largest speed that is drawn in colour."""
        return Normalize(0, max(float(np.nanmax(self.before[1])), 1e-3))

    @property
    def before(self) -> tuple[np.ndarray, np.ndarray]:
        """Path of the tip up to the closest approach [m], (S', d), and its speed [m/s], (S',)."""
        seen = self.path_times <= self.until
        return self.path[seen], self.speed[seen]

    @property
    def after(self) -> np.ndarray:
        """Path of the tip from the closest approach on [m], (S'', d)."""
        return self.path[self.path_times >= self.until]


def drawn(trajectory: Trajectory, model: Model, target: Target | Sequence[float]) -> Drawn:
    """Return the data of the drawing of a strike.

    Args:
        trajectory: Trajectory of the strike.
        model: Model with which it was simulated.
        target: Target of the strike, or (x, y) or (x, y, z) [m].

    Raises:
        InputError: The target has other coordinates than the model.
    """
    goal = as_target(target)
    goal.check_fits(model)
    near, t = trajectory.approach(goal), trajectory.t
    met, when = float(near.time[0]), trajectory.decisive(near)
    until = met if met > 0.3 * t[-1] else float(t[-1])  # what comes after would cover what led to it
    postures = np.r_[np.linspace(t[0], min(until, max(when, 0.3 * t[-1])), _POSTURES), when]
    arms, whips = arm_and_whip(model, at_times(postures, t, trajectory.q))
    path_times = np.unique(np.r_[np.linspace(t[0], t[-1], _SEGMENTS), until])
    title = f"{trajectory.MEETING} {length_text(near.distance[0])} at {near.speed[0]:.1f} m/s"
    if trajectory.diverged:
        title = f"diverged at {t[-1]:.4f} s" + (f", {title}" if np.isfinite(near.distance[0]) else "")
    return Drawn(
        arms=arms,
        whips=whips,
        path=at_times(path_times, t, trajectory.tip),
        path_times=path_times,
        speed=np.interp(path_times, t, trajectory.tip_speed),
        until=until,
        target=goal,
        title=title,
        when=when,
        followed=trajectory.FOLLOWED,
    )


def plot_projection(ax: Axes, strike: Drawn, seen: tuple[int, int]) -> Axes:
    """Draw a strike projected on the two coordinates with the indices `seen`: the first to the right, the second up."""
    (i, j), axes = seen, AXES[strike.dimension]
    shown, place, radius = [i, j], np.array(strike.target.position), strike.target.hit_radius
    for posture, style in _posture_styles(strike):
        ax.plot(*posture[:, shown].T, **style)
    before = _segments(strike.before[0])[..., shown]
    ax.add_collection(LineCollection(list(before), **_path_style(strike)), autolim=False)
    ax.plot(*strike.after[:, shown].T, **_AFTER)
    centre = (place[i], place[j])
    ax.add_patch(Circle(centre, radius, facecolor=COLORS["orange"], alpha=0.3, edgecolor="none", zorder=1))
    ax.add_patch(Circle(centre, radius, fill=False, edgecolor=COLORS["orange"], linewidth=1.6, zorder=3))
    ax.plot(*centre, "+", color=COLORS["orange"], markersize=15, markeredgewidth=1.2, zorder=3.5)  # however small it is
    if strike.target.outline is not None:
        ax.plot(*strike.target.outline[:, shown].T, color=COLORS["black"], linewidth=1.4, zorder=3)
    draw_direction(ax, strike.target, shown)
    low, high = strike.box
    ax.set(xlabel=axes[i], ylabel=axes[j], aspect="equal")
    ax.set_xlim(low[i], high[i], auto=True)  # where the aspect widens them matplotlib warns of limits that are fixed
    ax.set_ylim(low[j], high[j], auto=True)
    for axis in (ax.xaxis, ax.yaxis):
        axis.set_major_locator(ticks(*_tick(strike)))
    return ax


def plot_perspective(ax: Axes3D, strike: Drawn) -> Axes3D:
    """Draw a strike in perspective, with the shadows of the path and of the last posture on the floor."""
    ax.computed_zorder = False  # what was drawn later lies above
    low, high = strike.box
    place = np.array(strike.target.position)
    floor = {"color": "0.78", "zorder": 1}
    for places, width in ((strike.before[0], 0.9), (strike.arms[-1], 3.0), (strike.whips[-1], 1.8)):
        ax.plot(places[:, 0], places[:, 1], low[2], linewidth=width, **floor)
    ax.plot(*np.transpose([place, [place[0], place[1], low[2]]]), color=COLORS["orange"], linewidth=0.9, linestyle=":")
    plot_ball(ax, strike.target)
    if strike.target.outline is not None:
        ax.plot(*strike.target.outline.T, color=COLORS["black"], linewidth=1.0, zorder=3)
    draw_direction_in_space(ax, strike.target)
    for posture, style in _posture_styles(strike):
        ax.plot(*posture.T, **style)
    before = _segments(strike.before[0])
    ax.add_collection3d(Line3DCollection(list(before), **_path_style(strike)), autolim=False)
    ax.plot(*strike.after.T, **_AFTER)
    set_up_perspective(ax, low, high)
    for axis in (ax.xaxis, ax.yaxis, ax.zaxis):
        axis.set_major_locator(ticks(2 * _tick(strike)[0], _tick(strike)[1]))
    return ax


def plot_strike(
    trajectory: Trajectory, model: Model, target: Target | Sequence[float], *, ax: Axes | None = None
) -> Axes:
    """Draw postures of arm and whip at equal intervals, the tip's path coloured by its speed, and the posture at the
    closest approach.

    A strike in space gets four views in a new figure: side, top, front and perspective.

    Args:
        trajectory: Trajectory of the strike.
        model: Model with which it was simulated.
        target: Target of the strike, or (x, y) or (x, y, z) [m].
        ax: Axes to draw into; None: axes of a new figure. In a figure with several axes, `layout="constrained"` keeps
            room for legend and colour bar. A strike in space is drawn in perspective into 3-D axes, and from the side
            into others.

    Returns:
        The axes; for four views the one in perspective.

    Raises:
        InputError: The target has a wrong number of coordinates.
    """
    expect(Trajectory, trajectory=trajectory)
    expect(Model, model=model)
    expect(Axes, type(None), ax=ax)
    if ax is None:
        from matplotlib import pyplot

        with matplotlib.rc_context(STYLE):
            return draw_strike(pyplot.figure(), trajectory, model, target)
    strike = drawn(trajectory, model, target)
    if isinstance(ax, Axes3D):
        plot_perspective(ax, strike)
        bar: dict[str, Any] = {"ax": ax, "shrink": 0.6, "pad": 0.1}
    else:
        plot_projection(ax, strike, (0, strike.dimension - 1))
        ax.set_aspect("equal", adjustable="datalim")  # a box that shrinks would leave a blank
        bar = {"cax": ax.inset_axes((1.03, 0.15, 0.04, 0.7))}  # with ax=ax it would lie next to a legend that is wider
    figure = ax.get_figure()
    assert figure is not None
    figure.colorbar(ScalarMappable(strike.norm, SPEED), label=f"speed of the {strike.followed} [m/s]", **bar)
    ax.set_title(strike.title)
    legend_above(ax, ncols=2)
    return ax


def draw_strike(figure: Figure, trajectory: Trajectory, model: Model, target: Target | Sequence[float]) -> Axes:
    """Draw a strike into a figure without axes, whose size is adapted to the strike; see `plot_strike`."""
    strike = drawn(trajectory, model, target)
    if strike.dimension == 3:
        return _draw_views(figure, strike)
    low, high = strike.box
    width = 1.9 + 5.4 * float(np.clip((high - low)[0] / (high - low)[1], 0.75, 2))
    figure.set_size_inches(width, _HEIGHT)
    figure.set_layout_engine("constrained")
    return plot_strike(trajectory, model, target, ax=figure.subplots())


def _draw_views(figure: Figure, strike: Drawn) -> Axes3D:
    """Draw a strike from the side, from above, from the front and in perspective, to one scale.

    Returns:
        The axes in perspective; the others are `figure.axes[:3]`: side, top, front.
    """
    low, high = strike.box
    wide, deep, tall = (high - low) * _LONGEST / (high - low).max()  # [in]
    left, right, top, bottom, beside, below = 0.75, 1.0, 1.22, 0.65, 0.75, 0.6  # [in]
    width, height = left + wide + beside + deep + right, top + tall + below + deep + bottom
    figure.set_size_inches(width, height)
    grid = GridSpec(
        2,
        2,
        figure,
        left=left / width,
        right=1 - right / width,
        top=1 - top / height,
        bottom=bottom / height,
        wspace=2 * beside / (wide + deep),
        hspace=2 * below / (tall + deep),
        width_ratios=[wide, deep],
        height_ratios=[tall, deep],
    )
    cells: dict[str, Any] = {"side": grid[0, 0], "top": grid[1, 0], "front": grid[0, 1]}
    views = {name: plot_projection(figure.add_subplot(cell), strike, VIEWS[name]) for name, cell in cells.items()}
    for name, ax in views.items():
        behind = {"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 1.5}
        look = {"va": "top", "color": "0.35", "fontweight": "bold", "zorder": 10, "bbox": behind}
        ax.text(0.03, 0.97, name, transform=ax.transAxes, **look)
    views["side"].set_title(strike.title)
    legend_above(views["side"], ncols=4, width=wide + beside + deep)
    rest = (left + wide + 0.1, 0.1, beside + deep + right - 0.2, bottom + deep + 0.05)  # [in]
    sides = np.array([width, height, width, height])
    perspective = figure.add_axes(tuple(rest / sides), projection="3d", facecolor="none", zorder=-1)
    figure.colorbar(
        ScalarMappable(strike.norm, SPEED),
        cax=views["front"].inset_axes((1.05, 0.12, 0.045, 0.76)),
        label=f"speed of the {strike.followed} [m/s]",
    )
    assert isinstance(perspective, Axes3D)
    return plot_perspective(perspective, strike)


def _posture_styles(strike: Drawn) -> list[tuple[np.ndarray, dict[str, Any]]]:
    """Lines with their looks: postures the paler the earlier, and the one at the closest approach."""
    arm_look: dict[str, Any] = {"color": COLORS["blue"]}
    whip_look: dict[str, Any] = {"color": COLORS["black"]}
    lines = []
    for arm, whip, share in zip(strike.arms[:-1], strike.whips, np.linspace(0.12, 0.5, _POSTURES), strict=False):
        lines.append((arm, {**arm_look, "alpha": share, "linewidth": 2.4, "zorder": 2}))
        lines.append((whip, {**whip_look, "alpha": share, "linewidth": 1.1, "zorder": 2}))
    arm, whip = strike.arms[-1], strike.whips[-1]
    lines.append((whip, {**whip_look, "linewidth": 2.3, "zorder": 4, "label": f"whip at {strike.when:.3f} s"}))
    lines.append((arm, {**arm_look, "linewidth": 4.5, "zorder": 5, "label": "arm, then"}))
    dots = {"linestyle": "", "marker": "o", "markersize": 5, "zorder": 6, "color": "white"}
    lines.append((arm[1:], {**dots, "markeredgecolor": COLORS["blue"]}))
    lines.append((whip[-1:], {**dots, "color": COLORS["vermilion"], "markersize": 6, "label": "tip"}))
    target = {**dots, "color": "#F8E1B0", "markeredgecolor": COLORS["orange"], "markersize": 9}
    label = f"target, hit radius {strike.target.hit_radius:g} m"
    lines.append((np.full((1, strike.dimension), np.nan), {**target, "label": label}))
    if len(strike.after) > 1:
        lines.append((np.full((1, strike.dimension), np.nan), {**_AFTER, "label": "path of the tip afterwards"}))
    if strike.target.direction is not None:
        lines.append((np.full((1, strike.dimension), np.nan), {**LOOK, "label": asked_of(strike.target)}))
    return lines


def _path_style(strike: Drawn) -> dict[str, Any]:
    _, speed = strike.before
    return {
        "array": (speed[1:] + speed[:-1]) / 2,
        "cmap": SPEED,
        "norm": strike.norm,
        "linewidths": 2.4,
        "capstyle": "round",
        "zorder": 3,
    }


def _segments(path: np.ndarray) -> np.ndarray:
    """Pairs of neighbours of a path (S, d): (S - 1, 2, d)."""
    return np.stack([path[:-1], path[1:]], axis=1)


def _tick(strike: Drawn) -> tuple[float, float]:
    """Distance between ticks, and extent of what is drawn [m]."""
    low, high = strike.box
    extent = (high - low).max()
    return 0.25 if extent < 1.5 else 0.5 if extent < 4 else 1.0, float(extent)
