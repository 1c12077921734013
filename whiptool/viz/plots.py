"""Figures of a strike and of a search, drawn with matplotlib's objects.

Every `plot_...` function draws into axes that it is given and returns them, so that figures can be composed freely;
`matplotlib.rc_context(STYLE)` gives them the look of the saved ones. Where none are given, `plot_strike` and
`plot_distance` make a figure with pyplot, in that look; nothing else here knows of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, TypeAlias

import matplotlib
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.colors import LinearSegmentedColormap, Normalize
from matplotlib.figure import Figure, SubFigure
from matplotlib.patches import Circle
from matplotlib.ticker import MaxNLocator, MultipleLocator

from whiptool.models.parameters import Model
from whiptool.rollout.trajectory import Trajectory, joint_points
from whiptool.target import Target, as_target
from whiptool.whole_files import replacing

# Okabe and Ito's colour-blind safe palette
COLORS = {
    "blue": "#0072B2",
    "vermilion": "#D55E00",
    "green": "#009E73",
    "pink": "#CC79A7",
    "orange": "#E69F00",
    "sky": "#56B4E9",
    "black": "#222222",
    "yellow": "#F0E442",
}
_CYCLE = list(COLORS.values())[:7]  # yellow lines are hard to see on white
STYLE: dict[Any, Any] = {
    "figure.dpi": 110,
    "savefig.dpi": 200,
    "savefig.bbox": "tight",
    "font.size": 11,
    "axes.titlesize": 12,
    "axes.labelsize": 11,
    "xtick.labelsize": 10,
    "ytick.labelsize": 10,
    "legend.fontsize": 10,
    "legend.frameon": False,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "0.9",
    "grid.linewidth": 0.8,
    "lines.linewidth": 1.8,
    "lines.solid_capstyle": "round",
    "axes.titlelocation": "left",
    "axes.prop_cycle": matplotlib.cycler(color=_CYCLE),
}
# viridis without its yellow end, which fades into white
_TIME = LinearSegmentedColormap.from_list("time", matplotlib.colormaps["viridis"](np.linspace(0.0, 0.88, 128)))
_POSTURES = 12  # as in Fig. 10a
View: TypeAlias = Literal["side", "top", "front"]
VIEWS: dict[str, tuple[tuple[int, int], tuple[str, str]]] = {  # coordinates to the right and up, and their names
    "side": ((0, 2), ("x, forward [m]", "z, up [m]")),
    "top": ((0, 1), ("x, forward [m]", "y, left [m]")),
    "front": ((1, 2), ("y, left [m]", "z, up [m]")),
}
_STRIKE_SIZE, _DISTANCE_SIZE = (7.4, 6.6), (7.6, 4.0)  # [in]; the width of a strike follows its shape


def planned_end(trajectory: Trajectory) -> float | None:
    """Return D, the end of the planned movement [s]; None if the arm never moves or the trajectory ends earlier."""
    speed = np.abs(trajectory.v_d).max(axis=1)
    moving = np.flatnonzero(speed > 1e-9 * speed.max())
    return float(trajectory.t[moving[-1] + 1]) if len(moving) and moving[-1] + 1 < len(speed) else None


def plot_convergence(
    ax: Axes, miss_distance_per_trial: Sequence[float] | np.ndarray, hit_radius: float, *, label: str = ""
) -> Axes:
    """Draw the miss distance of every trial (T,) [m], in the order of the search, and the best so far."""
    miss = np.asarray(miss_distance_per_trial, float)
    trial = np.arange(1, len(miss) + 1)
    finite = np.where(np.isfinite(miss), miss, np.inf)
    best, lost = np.minimum.accumulate(finite), int(np.isinf(finite).sum())
    ax.plot(
        trial,
        miss,
        "o",
        color=COLORS["sky"],
        markersize=3.5,
        markeredgewidth=0,
        alpha=0.6,
        label=f"trial ({lost} diverged, not shown)" if lost else "trial",
        rasterized=len(miss) > 5000,
    )
    ax.step(
        trial,
        np.where(np.isfinite(best), best, np.nan),
        where="post",
        color=COLORS["blue"],
        linewidth=2.2,
        label="best so far",
    )
    ax.axhline(hit_radius, color=COLORS["orange"], linestyle="--", linewidth=1.8, label=f"hit radius {hit_radius:g} m")
    hits = np.flatnonzero(finite <= hit_radius)
    title = f"first hit in trial {hits[0] + 1}" if len(hits) else f"no hit in {len(miss)} trials"
    if len(miss) and np.isfinite(best[-1]):
        title += f", best {_length(best[-1])}"
    ax.set(yscale="log", xlabel="trial", ylabel="miss distance [m]", title=", ".join(filter(None, (label, title))))
    ax.set_xlim(0.5, max(len(miss), 1) + 0.5)
    ax.xaxis.set_major_locator(MaxNLocator(integer=True))
    legend_above(ax)
    return ax


def plot_strike(
    trajectory: Trajectory,
    model: Model,
    target: Target | Sequence[float],
    *,
    ax: Axes | None = None,
    view: View = "side",
) -> Axes:
    """Draw postures of arm and whip at equal intervals, the tip's path, and the posture at the closest approach.

    Args:
        trajectory: The strike.
        model: The model that it was rolled out with.
        target: What was to be hit, or (x, y) or (x, y, z) [m].
        ax: Where to draw; None: axes of a new figure of a size that fits. Of a figure with several axes,
            `layout="constrained"` keeps room for legend and colour bar.
        view: Of a model in space, from where: side, top or front.

    Returns:
        The axes.
    """
    if ax is None:
        with matplotlib.rc_context(STYLE):
            return _fit_width(plot_strike(trajectory, model, target, ax=_new_axes(_STRIKE_SIZE), view=view))
    drawing = strike_drawing(trajectory, model, target)
    draw_projection(ax, drawing, view)
    ax.set_title(drawing.title)
    figure = ax.get_figure()
    assert figure is not None
    add_time_bar(
        figure, ax.inset_axes((1.03, 0.15, 0.04, 0.7)), drawing
    )  # a bar beside ax would stand beside its legend
    legend_above(ax, ncols=2)
    return ax


@dataclass(frozen=True)
class StrikeDrawing:
    """What is drawn of a strike, in d dimensions, with a joints of the arm.

    Args:
        arm, whip: Postures at P times, from joint to joint, (P, a + 1, d), and from the hand to the tip, (P, N + 1, d).
        times: Of the postures [s], (P,).
        near: Posture at the closest approach, (a + 1 + N, d).
        before, after: The tip's path until the last posture, and from then on, (T, d).
        place, hit_radius: Of the target [m].
        label: Of the closest approach.
        title: What the strike came to.
    """

    arm: np.ndarray
    whip: np.ndarray
    times: np.ndarray
    near: np.ndarray
    before: np.ndarray
    after: np.ndarray
    place: np.ndarray
    hit_radius: float
    label: str
    title: str

    @property
    def near_arm(self) -> np.ndarray:
        """The arm at the closest approach, (a + 1, d)."""
        return self.near[: self.arm.shape[1]]

    @property
    def near_whip(self) -> np.ndarray:
        """The whip at the closest approach, (N + 1, d)."""
        return self.near[self.arm.shape[1] - 1 :]

    @property
    def norm(self) -> Normalize:
        """From the postures' times to colours."""
        return Normalize(self.times[0], max(self.times[-1], self.times[0] + 1e-3))

    @property
    def colors(self) -> np.ndarray:
        """Of the postures, (P, 4)."""
        return _TIME(self.norm(self.times))


def strike_drawing(trajectory: Trajectory, model: Model, target: Target | Sequence[float]) -> StrikeDrawing:
    """Return what is drawn of a strike."""
    goal = as_target(target)
    place = np.array(goal.position)
    near, t, n = trajectory.approach(place), trajectory.t, model.arm.n
    t_near = float(near.time[0])
    # What comes after the closest approach would cover what led to it
    until = t_near if t_near > 0.3 * t[-1] else t[-1]
    times = np.linspace(t[0], until, _POSTURES)
    points = joint_points(model, _at(times, t, trajectory.q))
    title = f"closest approach {_length(near.distance[0])} at {near.speed[0]:.1f} m/s"
    if trajectory.diverged:
        title = f"diverged at {t[-1]:.4f} s" + (f", {title}" if np.isfinite(near.distance[0]) else "")
    return StrikeDrawing(
        arm=points[:, : n + 1],
        whip=points[:, n:],
        times=times,
        near=joint_points(model, _at(np.array([t_near]), t, trajectory.q))[0],
        before=trajectory.tip[t <= until],
        after=trajectory.tip[t >= until],
        place=place,
        hit_radius=goal.hit_radius,
        label=f"closest approach, {t_near:.3f} s",
        title=title,
    )


def draw_projection(ax: Axes, drawing: StrikeDrawing, view: View = "side") -> None:
    """Draw a strike as seen in the plane, or in space from one direction."""
    flat = len(drawing.place) == 2
    (i, j), labels = ((0, 1), ("x, forward [m]", "y, up [m]")) if flat else VIEWS[view]
    pair = [i, j]
    for x, width in ((drawing.arm, 3.2), (drawing.whip, 1.5)):
        ax.add_collection(
            LineCollection(
                list(x[..., pair]),
                colors=drawing.colors,
                linewidths=width,
                alpha=0.75,
                capstyle="round",
                joinstyle="round",
                zorder=2,
            )
        )
    ax.plot(*drawing.before[:, pair].T, color="0.45", linewidth=0.9, zorder=1.5, label="path of the tip")
    ax.plot(*drawing.after[:, pair].T, color="0.6", linewidth=0.9, linestyle=(0, (1, 2)), zorder=1.5)
    place, radius = (drawing.place[i], drawing.place[j]), drawing.hit_radius
    ax.add_patch(Circle(place, radius, facecolor=COLORS["orange"], alpha=0.35, edgecolor="none", zorder=1))
    ax.add_patch(Circle(place, radius, fill=False, edgecolor=COLORS["orange"], linewidth=1.6, zorder=3))
    ax.plot(
        [],
        [],
        "o",
        color="#F8E1B0",
        markeredgecolor=COLORS["orange"],
        markersize=9,
        label=f"target, hit radius {radius:g} m",
    )
    arm, whip = drawing.near_arm[:, pair], drawing.near_whip[:, pair]
    ax.plot(*arm.T, color=COLORS["black"], linewidth=5, zorder=4)
    ax.plot(*whip.T, color=COLORS["black"], linewidth=2.4, zorder=4, label=drawing.label)
    ax.plot(*arm.T, "o", color="white", markeredgecolor=COLORS["black"], markersize=5, zorder=5)
    ax.plot(*whip[-1], "o", color=COLORS["vermilion"], markersize=6, zorder=6, label="tip")
    ax.set(xlabel=labels[0], ylabel=labels[1])
    ax.set_aspect("equal", adjustable="datalim")  # a box that shrinks would leave a blank
    ax.margins(0.06)
    extent = np.ptp([ax.get_xlim(), ax.get_ylim()], axis=1).max()
    for axis in (ax.xaxis, ax.yaxis):
        axis.set_major_locator(MultipleLocator(0.25 if extent < 2 else 0.5 if extent < 5 else 1.0))


def add_time_bar(figure: Figure | SubFigure, cax: Axes, drawing: StrikeDrawing) -> None:
    """Put the scale of the postures' colours into axes of its own."""
    apart = drawing.times[1] - drawing.times[0]
    figure.colorbar(ScalarMappable(drawing.norm, _TIME), cax=cax, label=f"time [s], a posture every {apart:.3f} s")


def _new_axes(size: tuple[float, float]) -> Axes:
    """Axes of a new figure of this size [in]."""
    from matplotlib import pyplot

    return pyplot.figure(figsize=size, layout="constrained").subplots()


def _fit_width(ax: Axes) -> Axes:
    """Make a figure with one strike as wide as the strike asks for at the figure's height."""
    figure = ax.get_figure(root=True)
    assert figure is not None
    figure.set_figwidth(1.9 + 5.4 * float(np.clip(np.ptp(ax.get_xlim()) / np.ptp(ax.get_ylim()), 0.75, 2)))
    return ax


def plot_tracking(axes: np.ndarray, trajectory: Trajectory, joint_names: Sequence[str]) -> np.ndarray:
    """Draw positions [deg] and velocities [deg/s] of the arm's joints beside their references; axes of shape (2,)."""
    pairs = ((trajectory.q, trajectory.q_d, "position [deg]"), (trajectory.v, trajectory.v_d, "velocity [deg/s]"))
    for ax, (actual, desired, label) in zip(axes, pairs, strict=True):
        for i, name in enumerate(joint_names):
            color = _CYCLE[i % len(_CYCLE)]
            error = np.rad2deg(np.abs(desired[:, i] - actual[:, i]).max())
            unit = label[label.index("[") + 1 : -1]
            ax.plot(
                trajectory.t,
                np.rad2deg(actual[:, i]),
                color=color,
                linewidth=3,
                alpha=0.75,
                label=f"{name}, error up to {error:.3g} {unit}",
            )
            ax.plot(
                trajectory.t,
                np.rad2deg(desired[:, i]),
                color=COLORS["black"],
                linestyle=(0, (4, 2.5)),
                linewidth=1.1,
                label="desired" if i == len(joint_names) - 1 else "",
            )
        ax.set_ylabel(label)
        _time_axis(ax, trajectory)
        legend_above(ax, ncols=3 if len(joint_names) <= 3 else 2)
    return axes


def plot_gains(axes: np.ndarray, trajectory: Trajectory, joint_names: Sequence[str]) -> np.ndarray:
    """Draw the entries of the controller's stiffness and damping over time (Fig. 10c, d); axes of shape (2,).

    Of more than three joints, the entries beside the diagonal are thin and have one label.
    """
    letters = [name[0] for name in joint_names]
    marks = letters if len(set(letters)) == len(letters) else [str(i + 1) for i in range(len(letters))]
    a, dash = len(marks), (4, 4)
    for ax, gain, name, unit in ((axes[0], trajectory.K, "K", "N m/rad"), (axes[1], trajectory.B, "B", "N m s/rad")):
        entries = list(np.ndindex(a, a)) if a <= 3 else [(i, i) for i in range(a)]
        for k, (i, j) in enumerate(entries):
            ax.plot(
                trajectory.t,
                gain[:, i, j],
                color=_CYCLE[k % len(_CYCLE)],
                linestyle="-" if i == j else (4 * (i > j), dash),  # equal ones show in turn
                label=f"${name}_{{{marks[i]}{marks[j]}}}$",
            )
        if a > 3:
            i, j = np.nonzero(~np.eye(a, dtype=bool))
            lines = ax.plot(trajectory.t, gain[:, i, j], color="0.7", linewidth=0.8)
            lines[0].set_label(f"${name}_{{ij}}$, i not j")
        largest = np.abs(gain).max(axis=(1, 2))
        peak, usual = largest.max(), np.median(largest)
        if usual < peak / 10:  # gains of rank one rise and fall with the error by orders of magnitude
            ax.set_yscale("symlog", linthresh=10 ** np.floor(np.log10(max(usual, peak / 1e3))))
        ax.set_ylabel(f"{'stiffness' if name == 'K' else 'damping'} {name} [{unit}]")
        _time_axis(ax, trajectory)
        legend_above(ax, ncols=max(a * a, 4) if a <= 3 else 4)
    return axes


def plot_distance(trajectory: Trajectory, target: Target | Sequence[float], *, ax: Axes | None = None) -> Axes:
    """Draw the distance of the tip from the target over time (Fig. 10b), with the closest approach.

    Args:
        trajectory: The strike.
        target: What was to be hit, or (x, y) [m].
        ax: Where to draw; None: axes of a new figure.

    Returns:
        The axes.
    """
    if ax is None:
        with matplotlib.rc_context(STYLE):
            return plot_distance(trajectory, target, ax=_new_axes(_DISTANCE_SIZE))
    place, hit_radius = np.array(as_target(target).position), as_target(target).hit_radius
    near = trajectory.approach(place)
    ax.plot(trajectory.t, trajectory.distance(place), color=COLORS["blue"])
    ax.axhspan(0, hit_radius, color=COLORS["orange"], alpha=0.25, linewidth=0)
    ax.axhline(hit_radius, color=COLORS["orange"], linestyle="--", linewidth=1.5, label=f"hit radius {hit_radius:g} m")
    if np.isfinite(near.distance[0]):
        ax.plot(
            near.time,
            near.distance,
            "o",
            color=COLORS["vermilion"],
            markersize=7,
            zorder=3,
            clip_on=False,
            label=f"closest approach {_length(near.distance[0])} at {near.time[0]:.3f} s",
        )
    ax.set_ylabel("distance tip to target [m]")
    _time_axis(ax, trajectory)
    ax.set_ylim(bottom=0)
    legend_above(ax)
    return ax


def save_strike_figures(
    folder: str | Path,
    trajectory: Trajectory,
    model: Model,
    target: np.ndarray,
    hit_radius: float,
    controller_label: str,
) -> list[Path]:
    """Write `strike.png`, `distance.png`, `tracking.png` and `gains.png` into a folder, which is made if missing.

    Args:
        folder: Where to.
        trajectory: The strike.
        model: The model that it was rolled out with.
        target: Position (2,) or (3,) [m].
        hit_radius: The tip hits within this distance [m].
        controller_label: What the figures call the controller.

    Returns:
        The files.
    """
    goal, joints = Target(tuple(target), hit_radius), model.arm.joints
    with matplotlib.rc_context(STYLE):
        strike, distance = (Figure(size, layout="constrained") for size in (_STRIKE_SIZE, _DISTANCE_SIZE))
        tracking, gains = (Figure((7.6, 6.4), layout="constrained") for _ in range(2))
        if model.dimension == 3:
            from whiptool.viz.plots_space import plot_strike_views

            strike = Figure((11.0, 9.6), layout="constrained")
            plot_strike_views(strike, trajectory, model, goal)
        else:
            _fit_width(plot_strike(trajectory, model, goal, ax=strike.subplots()))
        plot_distance(trajectory, goal, ax=distance.subplots())
        plot_tracking(tracking.subplots(2, sharex=True), trajectory, joints)
        plot_gains(gains.subplots(2, sharex=True), trajectory, joints)
        figures = {"strike": strike, "distance": distance, "tracking": tracking, "gains": gains}
        for figure in figures.values():
            figure.suptitle(f"{model.name}, {controller_label}", fontsize=12, fontweight="bold", x=0.02, ha="left")
        return [save_figure(figure, Path(folder) / f"{name}.png") for name, figure in figures.items()]


def save_convergence(
    folder: str | Path, miss_distance_per_trial: Sequence[float] | np.ndarray, hit_radius: float, *, label: str = ""
) -> Path:
    """Write `convergence.png` (see `plot_convergence`) into a folder, which is made if missing; return the file."""
    with matplotlib.rc_context(STYLE):
        figure = Figure((7.6, 4.4), layout="constrained")
        plot_convergence(figure.subplots(), miss_distance_per_trial, hit_radius, label=label)
        return save_figure(figure, Path(folder) / "convergence.png")


def save_figure(figure: Figure, path: Path) -> Path:
    """Write a figure as a whole file, into a folder that is made if missing; return the file."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with replacing(path) as unfinished:
        figure.savefig(unfinished)
    return path


def _at(times: np.ndarray, t: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Rows of x (T, n) between instants t (T,): (len(times), n)."""
    return np.stack([np.interp(times, t, column) for column in x.T], axis=1)


def _length(meters: float) -> str:
    return f"{1e3 * meters:.2g} mm" if meters < 0.0995 else f"{meters:.3f} m"


def _time_axis(ax: Axes, trajectory: Trajectory) -> None:
    """Label time, and mark D, the end of the planned movement."""
    ax.margins(y=0.12)  # room for the mark
    ax.set_xlim(trajectory.t[0], max(trajectory.t[-1], trajectory.t[0] + 1e-3))
    D = planned_end(trajectory)
    if D is not None:
        ax.axvline(D, color="0.55", linewidth=1, linestyle=":", zorder=1)
        ax.annotate(
            "D",
            (D, 1),
            xycoords=ax.get_xaxis_transform(),
            xytext=(3, -3),
            textcoords="offset points",
            va="top",
            color="0.35",
        )
    if ax.get_subplotspec() is None or ax.get_subplotspec().is_last_row():  # type: ignore[union-attr]
        ax.set_xlabel("time [s]")


def legend_above(ax: Axes, *, ncols: int = 3, handles: Sequence[Artist] | None = None) -> None:
    """Put a legend between title and axes, where it cannot cover data; of these handles, or of all with a label."""
    legend = ax.legend(
        handles=ax.get_legend_handles_labels()[0] if handles is None else handles,
        loc="lower left",
        bbox_to_anchor=(0, 1),
        ncols=ncols,
        borderaxespad=0.3,
        columnspacing=1.4,
        handlelength=1.8,
    )
    rows = -(-len(legend.get_texts()) // ncols)
    ax.set_title(ax.get_title(loc="left"), loc="left", pad=8 + 1.6 * rows * float(legend.get_texts()[0].get_fontsize()))
